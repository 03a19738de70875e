"""Trying the laws of an installed plugin without anybody writing a test: what drives them, and what comes of it."""

from __future__ import annotations

import importlib
import importlib.metadata
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

from mapgraft.contracts import MapType
from mapgraft.errors import ConfigError, PluginError
from mapgraft.plugins import GROUP, Offered, PluginKind, Plugins
from mapgraft.testing.conversions import ConversionLaws
from mapgraft.testing.fusers import FuserLaws
from mapgraft.testing.judging import AcceptorLaws, PolicyLaws, VerifierLaws
from mapgraft.testing.laws import Law, Laws, NotTriedError, Outcome, examine, laws_of
from mapgraft.testing.listing import PluginLaws
from mapgraft.testing.map_types import MapTypeLaws
from mapgraft.testing.matchers import MatcherLaws
from mapgraft.testing.metrics import MetricLaws
from mapgraft.testing.observing import READY_KINDS
from mapgraft.testing.ruled import Use, judged_in_rules
from mapgraft.testing.supply import Supply


@dataclass(frozen=True, slots=True)
class Case:
    """One thing to try, with the laws that it must keep; without any, ``reason`` says why it cannot be tried.

    Laws that are expected to fail are tried on ``thorough``, with as many examples as their author wants: with fewer,
    what must fail might not be met.
    """

    title: str
    laws: tuple[Law, ...] = ()
    subject: Laws | None = None
    reason: str = ""
    thorough: Laws | None = None

    def outcomes(self) -> Iterator[Outcome]:
        """What comes of each law, one by one."""
        if self.subject is not None:
            for one in self.laws:
                expected = one.name in self.subject.expected_failures
                yield examine(self.thorough if expected and self.thorough else self.subject, one)


def cases_of(plugins: Plugins, name: str, examples: int | None = None) -> Iterator[Case]:
    """What there is to try of a plugin (by its entry point), or of everything offered under a name.

    Raises PluginError when there is no such name.
    """
    things = [offered for _, offered in sorted(plugins.offered.items())]
    found = [offered for offered in things if name in (offered.descriptor.name, offered.origin.plugin)]
    modules = [point.module for point in importlib.metadata.entry_points(group=GROUP) if point.name == name]
    if not found and not modules:
        names = sorted({offered.origin.plugin for offered in things} | {offered.descriptor.name for offered in things})
        raise PluginError(f"nothing installed is called {name!r}: there are {', '.join(names)}")
    for module in modules[:1]:
        yield _whole(PluginLaws, f"plugin {name}", None, module=module)
    for offered in found:
        yield from _cases(plugins, offered, examples)


def _cases(plugins: Plugins, offered: Offered, examples: int | None) -> Iterator[Case]:
    title = f"{offered.kind} {offered.descriptor.name}"
    try:
        if offered.missing:
            raise NotTriedError(offered.remedy)
        if offered.descriptor.laws:
            for named in offered.descriptor.laws:
                kind = _named(named)
                yield _whole(kind, f"{title}, by {kind.__name__}", examples)
            return
        if (make := _DRIVERS.get(offered.kind)) is None:
            raise NotTriedError(f"there are no laws of {offered.kind}s")
        yield from make(plugins, offered, title, examples)
    except (NotTriedError, PluginError, ConfigError) as error:
        yield Case(title, reason=str(error))


def _whole(kind: type[Laws], title: str, examples: int | None, **attributes: Any) -> Case:
    """All laws of a class."""
    full = type(kind.__name__, (kind,), attributes)
    if examples is None:
        return Case(title, tuple(laws_of(full)), full())
    quick = type(kind.__name__, (full,), {"examples": examples})
    most = type(kind.__name__, (full,), {"examples": max(examples, kind.examples)})
    return Case(title, tuple(laws_of(full)), quick(), thorough=most())


def _mixed(supply: type[Supply], kind: type[Supply], examples: int | None, **attributes: Any) -> Supply:
    """The laws of one class, tried on what another one supplies."""
    most = kind.examples if examples is None else min(examples, kind.examples)
    fixed = {"expected_failures": {}, "examples": most, "shrinks": kind.shrinks, **attributes}
    return cast("Supply", type(kind.__name__, (supply, kind), fixed)())


def _named(name: str) -> type[Laws]:
    """The class that a descriptor's ``laws`` names; raises PluginError unless it is one of laws."""
    module, _, attribute = name.partition(":")
    try:
        found: object = getattr(importlib.import_module(module), attribute)
    except Exception as error:  # a stranger's module may fail in any way
        raise PluginError(f"the laws {name} cannot be loaded: {type(error).__name__}: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Laws)):
        raise PluginError(f"the laws {name} are no class that inherits from mapgraft.testing")
    return found


def supplies_of(plugins: Plugins, map_type: str) -> list[type[Supply]]:
    """How maps of a type can be made; raises NotTriedError when nobody says how."""
    offered = plugins.find("map type", map_type)
    if offered.missing:
        raise NotTriedError(offered.remedy)
    if named := [kind for kind in map(_named, offered.descriptor.laws) if issubclass(kind, Supply)]:
        return named
    kinds = [kind for kind in READY_KINDS if kind in offered.descriptor.observes]
    if not kinds:
        raise NotTriedError(
            f"{map_type} observes {', '.join(offered.descriptor.observes) or 'nothing'}, and the kit makes only "
            f"{', '.join(READY_KINDS)}: name classes of laws that make observations (Descriptor.laws)"
        )

    def make_map_type(self: Supply) -> MapType:
        return cast("MapType", plugins.make("map type", map_type))

    fusers = _accepting(plugins, "fuser", map_type)

    def make_fuser(self: Supply) -> Any:
        return plugins.make("fuser", fusers[0]) if fusers else None

    made = {"make_map_type": make_map_type, "make_fuser": make_fuser}
    return [type("Supply", (Supply,), {**made, "kind": kind}) for kind in kinds]


def _accepting(plugins: Plugins, kind: PluginKind, map_type: str) -> list[str]:
    """Names of the things that take maps of a type."""
    offered = [o for o in plugins.of_kind(kind) if set(o.descriptor.accepts) == {map_type} and not o.missing]
    return [o.descriptor.name for o in offered]


def _types(plugins: Plugins, offered: Offered) -> tuple[str, str]:
    """The receiver's and the donor's map type; of a thing that takes any, the one that most robots would have."""
    accepts = offered.descriptor.accepts
    if accepts:
        return accepts[0], accepts[-1]
    ranked = sorted(
        (-o.descriptor.observes[kind], o.descriptor.name)
        for o in plugins.of_kind("map type")
        for kind in READY_KINDS[:1]
        if kind in o.descriptor.observes and not o.missing
    )
    if not ranked:
        raise NotTriedError(f"no map type is installed that observes a {READY_KINDS[0]}")
    return ranked[0][1], ranked[0][1]


def _pair(plugins: Plugins, offered: Offered) -> tuple[type[Supply], dict[str, Any]]:
    """What supplies the maps for a thing that takes two of them."""
    own, other = _types(plugins, offered)
    supply = supplies_of(plugins, own)[0]
    if own == other:
        return supply, {}
    donor = supplies_of(plugins, other)[0]
    if "scenes" in vars(donor) or "observations" in vars(donor):
        raise NotTriedError(f"how {own} and {other} see one place nobody says: name classes of laws (Descriptor.laws)")
    donors = donor()
    return supply, {"donor_kind": donor.kind, "make_donor_map_type": lambda self: donors.make_map_type()}


def _map_types(plugins: Plugins, offered: Offered, title: str, examples: int | None) -> Iterator[Case]:
    for supply in supplies_of(plugins, offered.descriptor.name):
        subject = _mixed(supply, MapTypeLaws, examples)
        yield Case(f"{title}, from {supply.kind}", tuple(laws_of(MapTypeLaws)), subject)


def _matchers(plugins: Plugins, offered: Offered, title: str, examples: int | None) -> Iterator[Case]:
    descriptor = offered.descriptor
    supply, donor = _pair(plugins, offered)
    told = {
        "uses_prior": descriptor.uses_prior, "needs_prior": descriptor.needs_prior, "any_type": not descriptor.accepts
    }  # fmt: skip
    subject = _mixed(supply, MatcherLaws, examples, make_matcher=_maker(plugins, offered), **told, **donor)
    title += ", with a prior" if descriptor.needs_prior else ""
    yield Case(title, tuple(laws_of(MatcherLaws)), subject)


def _fusers(plugins: Plugins, offered: Offered, title: str, examples: int | None) -> Iterator[Case]:
    supply, donor = _pair(plugins, offered)
    subject = _mixed(supply, FuserLaws, examples, make_fuser=_maker(plugins, offered), **donor)
    yield Case(title, tuple(laws_of(FuserLaws)), subject)


def _metrics(plugins: Plugins, offered: Offered, title: str, examples: int | None) -> Iterator[Case]:
    supply, _ = _pair(plugins, offered)
    name, stream = offered.descriptor.name, offered.descriptor.stream
    subject = _mixed(
        supply, MetricLaws, examples, make_metric=_maker(plugins, offered), metric_name=name, stream=stream
    )
    title += ", as a count of what observations say" if stream else ""
    yield Case(title, tuple(laws_of(MetricLaws)), subject)


def _conversions(plugins: Plugins, offered: Offered, title: str, examples: int | None) -> Iterator[Case]:
    descriptor = offered.descriptor
    target = plugins.find("map type", descriptor.gives)
    if target.missing:
        raise NotTriedError(target.remedy)
    made = {
        "make_conversion": _maker(plugins, offered),
        "make_target": lambda self: plugins.make("map type", descriptor.gives),
    }
    for supply in supplies_of(plugins, descriptor.accepts[0]):
        subject = _mixed(supply, ConversionLaws, examples, **made)
        yield Case(f"{title}, from {supply.kind}", tuple(laws_of(ConversionLaws)), subject)


def _judges(plugins: Plugins, offered: Offered, title: str, examples: int | None) -> Iterator[Case]:
    kind: type[AcceptorLaws] | type[VerifierLaws] = AcceptorLaws if offered.kind == "acceptor" else VerifierLaws
    make = "make_acceptor" if offered.kind == "acceptor" else "make_verifier"
    name = offered.descriptor.name
    ruled = judged_in_rules(plugins, offered.kind, name, lambda map_type: supplies_of(plugins, map_type)[0]())
    for use in ruled or [Use("", {}, {})]:
        plugins.make(offered.kind, name, use.parameters)

        def made(self: Laws, use: Use = use) -> object:
            return plugins.make(offered.kind, name, use.parameters)

        given = {"measured": use.measured, "evidence": use.evidence, make: made}
        yield _whole(kind, f"{title}, as in {use.rule!r}" if use.rule else title, examples, **given)


def _policies(plugins: Plugins, offered: Offered, title: str, examples: int | None) -> Iterator[Case]:
    plugins.make("policy", offered.descriptor.name)
    yield _whole(PolicyLaws, title, examples, make_policy=_maker(plugins, offered))


def _maker(plugins: Plugins, offered: Offered) -> Callable[[Laws], object]:
    return lambda self: plugins.make(offered.kind, offered.descriptor.name)


_Driver = Callable[[Plugins, Offered, str, int | None], Iterator[Case]]
_DRIVERS: Final[dict[PluginKind, _Driver]] = {
    "map type": _map_types,
    "matcher": _matchers,
    "fuser": _fusers,
    "metric": _metrics,
    "conversion": _conversions,
    "acceptor": _judges,
    "verifier": _judges,
    "policy": _policies,
}


def broken(outcomes: Sequence[Outcome]) -> bool:
    """Whether anything is not as it should be."""
    return any(outcome.status in ("broken", "kept unexpectedly") for outcome in outcomes)
