"""Why the procedure of a rule cannot be used: what is not installed, and which map types it does not take."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from mapgraft.errors import PluginError
from mapgraft.plugins import PluginKind, Plugins

if TYPE_CHECKING:
    from mapgraft.decision import Rule

Check = Callable[[str, str], str | None]  # (receiver's type, donor's type) → why the procedure cannot take them


def lacking(rule: Rule, plugins: Plugins) -> str | None:
    """What the rule names that is not installed, as a sentence."""
    for kind, name in _named(rule):
        try:
            offered = plugins.find(kind, name)
        except PluginError as error:
            return str(error)
        if offered.missing:
            return f"the {kind} {name!r} {offered.remedy}"
    return None


def checked(rule: Rule, plugins: Plugins) -> tuple[str | None, Check]:
    """What the rule lacks, and what tells whether its procedure can take maps of two types."""
    lacks = lacking(rule, plugins)

    def check(own: str, other: str) -> str | None:
        if lacks is not None or rule.reject is not None:
            return lacks
        meeting = rule.via or own
        for source in (own, other):
            if plugins.way(source, meeting) is None:
                return f"there is no conversion from {source} to {meeting}"
        donated = own if meeting == own or plugins.way(other, own) is not None else other
        for kind, name in _named(rule):
            accepts = plugins.find(kind, name).descriptor.accepts
            pair = (own, donated) if kind == "fuser" else (meeting, meeting)
            if kind != "map type" and accepts and not _takes(accepts, pair, kind):
                return f"the {kind} {name!r} takes {' and '.join(accepts)}, not {' and '.join(dict.fromkeys(pair))}"
        return None

    return lacks, check


def _named(rule: Rule) -> list[tuple[PluginKind, str]]:
    if rule.reject is not None:
        return []
    procedure = rule.procedure
    named: list[tuple[PluginKind, str]] = [
        ("matcher", procedure.match.use),
        ("acceptor", procedure.accept.use),
        ("fuser", procedure.fuse.use),
        ("verifier", procedure.verify.use),
    ]
    named += [("metric", name) for name in procedure.metric_names]
    if rule.via:
        named.append(("map type", rule.via))
    return named


def _takes(accepts: tuple[str, ...], pair: tuple[str, str], kind: PluginKind) -> bool:
    if kind in ("matcher", "fuser") and len(accepts) == 2:
        return accepts == pair
    return all(map_type in accepts for map_type in pair)
