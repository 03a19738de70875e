"""What was counted, as tables for persons: one column per procedure, plain text where no terminal is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from mapgraft.console import cell
from mapgraft.evaluation.statistics import Area, Share, Spread
from mapgraft.evaluation.summary import Summary, Times

_WIDTH = 160
MOST_NUMBERS = 30
LOWER = "↓"  # marks what should be low


@dataclass(frozen=True, slots=True)
class Column:
    """One procedure: its name for persons, and what was counted and timed of it."""

    title: str
    summary: Summary
    times: Times


@dataclass(frozen=True, slots=True)
class _Row:
    name: str
    text: Callable[[Column], str]


def print_tables(
    console: Console, columns: Sequence[Column], *, ready_maps: bool = False, most: int = MOST_NUMBERS
) -> None:
    """Print what was counted and how well each number tells right from wrong, at most ``most`` numbers.

    Of ``ready_maps`` rows that only further mapping could fill are left out, and those of covariances against a truth
    that is told in pixels.
    """
    table = _table(columns)
    for title, rows in _parts(columns, ready_maps).items():
        table.add_row(cell(title), style="bold")
        for row in rows:
            table.add_row(cell(f"  {row.name}"), *(cell(row.text(column)) for column in columns))
    names = _telling(columns)[:most]
    if names:
        title = f"area under the curve, right against wrong ({LOWER} lower is better)"
        table.add_row(cell(title), *(cell(f"of {_hypotheses_told(column)}") for column in columns), style="bold")
    for name in names:
        table.add_row(cell(f"  {name}"), *(cell(auc(column.summary.auc.get(name))) for column in columns))
    wide(console).print(table)


def wide(console: Console) -> Console:
    """Where nobody's window says how wide lines may be, wide enough for whole lines of a table."""
    if not console.is_terminal:
        console.width = max(console.width, _WIDTH)
    return console


def _table(columns: Sequence[Column]) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("")
    for column in columns:
        table.add_column(cell(column.title))
    return table


def _parts(columns: Sequence[Column], ready_maps: bool) -> Mapping[str, Sequence[_Row]]:
    across = "unrelated pairs" if ready_maps else "pairs across recordings"
    return {
        "pairs": [
            _Row("all", lambda c: f"{c.summary.pairs}"),
            _Row(across, lambda c: f"{c.summary.across}"),
            _Row("turned away by the decision table", lambda c: f"{c.summary.rejected}"),
            _Row("best hypothesis right / wrong / none", _hypotheses),
        ],
        "right hypothesis on top, by true overlap": [
            *(_recall_row(bin_.overlap, number) for number, bin_ in enumerate(columns[0].summary.recall)),
            _Row(">= .3", lambda c: percent(c.summary.recall_from_some_overlap)),
        ],
        "merged at once": _of_merges(across),
        **({} if ready_maps else {"after further mapping": _of_what_follows()}),
        "error of right hypotheses, median (95th percentile)": _of_errors(ready_maps),
        "covariance": _of_covariances(ready_maps),
        "time, median (95th percentile), longest": _of_times(ready_maps),
    }


def _of_merges(across: str) -> Sequence[_Row]:
    return [
        _Row("right, of all pairs", lambda c: percent(c.summary.acceptance.right)),
        _Row("right, of right hypotheses at overlap >= .5", lambda c: percent(c.summary.acceptance.right_of_right)),
        _Row("wrong, of all pairs", lambda c: percent(c.summary.acceptance.wrong)),
        _Row("wrong, of wrong hypotheses", lambda c: percent(c.summary.acceptance.wrong_of_wrong)),
        _Row(f"wrong, of {across}", lambda c: percent(c.summary.acceptance.wrong_across)),
        _Row("ambiguous", lambda c: f"{c.summary.acceptance.ambiguous}"),
    ]


def _of_what_follows() -> Sequence[_Row]:
    on_new_wall = "the same with >= 4 m of new wall"
    return [
        _Row("wrong and confirmed, of all pairs", lambda c: percent(c.summary.afterwards.wrong_confirmed)),
        _Row("wrong and provisional, of all pairs", lambda c: percent(c.summary.afterwards.wrong_provisional)),
        _Row("wrong merges reverted", lambda c: percent(c.summary.afterwards.wrong_reverted)),
        _Row("right merges reverted", lambda c: percent(c.summary.afterwards.right_reverted)),
        _Row("right merges confirmed", lambda c: percent(c.summary.afterwards.right_confirmed)),
        _Row(on_new_wall, lambda c: percent(c.summary.afterwards.right_confirmed_on_new_wall)),
    ]


def _of_errors(ready_maps: bool) -> Sequence[_Row]:
    rows = [
        _Row("walls", lambda c: measured(c.summary.errors.error_m, " m")),
        _Row("rotation", lambda c: measured(c.summary.errors.error_deg, "°")),
    ]
    return [*rows, _Row("keypoints", lambda c: measured(c.summary.errors.error_px, " px"))] if ready_maps else rows


def _of_covariances(ready_maps: bool) -> Sequence[_Row]:
    rows = [
        _Row("flagged degenerate, of right hypotheses", lambda c: percent(c.summary.covariance.degenerate)),
        _Row("flagged degenerate, of all best hypotheses", lambda c: percent(c.summary.covariance.degenerate_of_all)),
        _Row("right hypotheses without one", lambda c: f"{c.summary.covariance.without}"),
    ]
    inside = _Row("truth inside the 95 % ellipse, of right", lambda c: percent(c.summary.covariance.inside))
    return rows if ready_maps else [inside, *rows]


def _of_times(ready_maps: bool) -> Sequence[_Row]:
    match = _Row("match", lambda c: milliseconds(c.times.match_ms))
    if ready_maps:
        return [match]
    return [
        match,
        _Row("map a scan", lambda c: milliseconds(c.times.integrate_ms)),
        _Row("verify, per scan", lambda c: milliseconds(c.times.verify_ms)),
        _Row("register anew, each", lambda c: milliseconds(c.times.anew_ms)),
        _Row("how often", lambda c: f"{c.times.anew_ms.count}"),
        _Row("last look", lambda c: milliseconds(c.times.final_ms)),
    ]


def _recall_row(name: str, number: int) -> _Row:
    return _Row(name, lambda c: percent(c.summary.recall[number].recall))


def _hypotheses(column: Column) -> str:
    return f"{column.summary.right} / {column.summary.wrong} / {column.summary.without_hypothesis}"


def _hypotheses_told(column: Column) -> str:
    return f"{column.summary.right} right, {column.summary.wrong} wrong"


def _telling(columns: Sequence[Column]) -> list[str]:
    """The numbers by how well they tell, in the first column that has them; details of metrics left out."""
    tells: dict[str, float] = {}
    for column in columns:
        for name, area in column.summary.auc.items():
            if not math.isnan(area.value) and ("." not in name or name.startswith("evidence.")):
                tells.setdefault(name, max(area.value, 1.0 - area.value))
    return sorted(tells, key=lambda name: -tells[name])


def percent(share: Share) -> str:
    """``97.3 % (95.1–98.8) 110/113``; a dash where there is nothing to count."""
    if share.of == 0:
        return "-"
    decimals = 1 if min(share.value, 1.0 - share.value) >= 0.01 or share.count in (0, share.of) else 2
    value, low, high = (f"{100.0 * number:.{decimals}f}" for number in (share.value, share.low, share.high))
    return f"{value} % ({low}–{high}) {share.count}/{share.of}"


def auc(area: Area | None) -> str:
    """``0.963 (0.950–0.980)``, marked where lower is better; a dash where it cannot be told."""
    if area is None or math.isnan(area.value):
        return "-"
    mark = f" {LOWER}" if area.better == "lower" else ""
    return f"{area.value:.3f} ({area.low:.3f}–{area.high:.3f}){mark}"


def milliseconds(spread: Spread) -> str:
    """``12.3 ms (45.6), 78.9``; a dash where nothing was timed."""
    return "-" if spread.count == 0 else f"{measured(spread, ' ms')}, {spread.largest:.3g}"


def measured(spread: Spread, unit: str) -> str:
    """``0.12 m (0.34)``; a dash where there was nothing to measure."""
    return "-" if spread.count == 0 else f"{spread.median:.3g}{unit} ({spread.p95:.3g})"
