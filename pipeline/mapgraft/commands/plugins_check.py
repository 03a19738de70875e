"""``mapgraft plugins check``: whether an installed plugin keeps the laws, law by law."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import typer

from mapgraft.console import cell, print_json, results
from mapgraft.plugins import load_plugins

if TYPE_CHECKING:
    from mapgraft.testing.checking import Case
    from mapgraft.testing.laws import Outcome

_STYLES = {"kept": "green", "broken": "red", "kept unexpectedly": "red", "expected failure": "yellow"}
_ORDER = ("kept", "broken", "kept unexpectedly", "expected failure", "not tried")


def check_plugin(name: str, *, as_json: bool, examples: int | None) -> None:
    """Try every law of a plugin or of one of its things, print what came of it; exit code 1 when one is broken.

    Raises PluginError when there is no such plugin, or when what the laws need is not installed.
    """
    from mapgraft.testing.checking import broken, cases_of

    plugins = load_plugins()
    outcomes: list[Outcome] = []
    rows: list[dict[str, str]] = []
    for case in cases_of(plugins, name, examples):
        if not as_json:
            _head(case)
        if case.subject is None:
            rows.append({"thing": case.title, "law": "", "says": "", "status": "not tried", "why": case.reason})
        for outcome in case.outcomes():
            outcomes.append(outcome)
            rows.append(_row(case, outcome))
            if not as_json:
                _line(outcome)
    counts = Counter(row["status"] for row in rows)
    if as_json:
        print_json({"name": name, "outcomes": rows, "counts": {status: counts[status] for status in _ORDER}})
    else:
        results().print("\n" + ", ".join(f"{counts[status]} {status}" for status in _ORDER if counts[status]))
    if broken(outcomes):
        raise typer.Exit(1)


def _row(case: Case, outcome: Outcome) -> dict[str, str]:
    law = outcome.law
    return {
        "thing": case.title, "law": law.name, "says": law.sentence, "status": outcome.status, "why": outcome.sentence
    }  # fmt: skip


def _head(case: Case) -> None:
    console = results()
    console.print(cell(f"\n{case.title}"), style="bold")
    if case.subject is None:
        console.print(cell(f"  not tried        {case.reason}"), soft_wrap=True)


def _line(outcome: Outcome) -> None:
    for text, style in _texts(outcome):
        results().print(cell(text), style=style, soft_wrap=True)


def _texts(outcome: Outcome) -> Iterator[tuple[str, Any]]:
    yield f"  {outcome.status:<16} {outcome.law.sentence}", _STYLES.get(outcome.status)
    if outcome.sentence:
        yield f"  {'':<16} └ {outcome.law.name}: {outcome.sentence}", None
