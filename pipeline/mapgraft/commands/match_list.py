"""``mapgraft match --pairs``: a whole list of map pairs whose truth is known."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from mapgraft.commands.match import Asked, naming_options, options_for, pairer_of, print_remarks
from mapgraft.commands.match_text import shown
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.errors import UsageError
from mapgraft.evaluation.document import finite
from mapgraft.evaluation.scored import Placed
from mapgraft.evaluation.summary import Summary, Times
from mapgraft.evaluation.tables import Column, print_tables, wide
from mapgraft.job import as_config
from mapgraft.matching.document import document
from mapgraft.matching.judging import Judged, LeftOut, judge, summed_up
from mapgraft.matching.pair_list import MapFile, read_lists
from mapgraft.matching.ready_map import FORMAT, RESOLUTION, ReadyMap, Shelf
from mapgraft.plugins import load_plugins

PAIR = "pair"
LEAST_TELLING = ("s", "turned", "overlap", "margin", "error")  # left out first where the console is narrow
NAME_WIDTH = 24  # of a pair, at least: before names are shortened further, columns are left out
GAP = 2


@dataclass(frozen=True, slots=True)
class Lists:
    """Files of pairs with truth and of pairs that must not merge; ``across`` adds all maps of different places."""

    pairs: tuple[Path, ...]
    unrelated: tuple[Path, ...]
    across: bool
    right_px: float


def judge_and_show(lists: Lists, asked: Asked, out: Path | None, *, as_json: bool) -> None:
    """Match every pair of some lists, compare with the truth, print the table, and write a folder if one is given."""
    listed = read_lists(lists.pairs, lists.unrelated)
    pairs = [*listed.pairs, *(listed.across() if lists.across else ())]
    if not pairs:
        raise UsageError("the lists hold no pair: see 'mapgraft match --help'")
    plugins = load_plugins(asked.without)
    config = as_config(asked.config)
    pairer = pairer_of(plugins, config, asked)
    shelf = Shelf(plugins, config, pairer.workshop)

    seen: set[Path] = set()

    def read(file: MapFile, side: int) -> ReadyMap:
        with naming_options():
            map_ = shelf.read(file.path, _options(shelf, file, side, asked))
        if file.path not in seen:
            seen.add(file.path)
            print_remarks(map_)
        return map_

    console = remarks()
    bar = Progress(console=console, transient=True, disable=not console.is_terminal)
    with bar, pairer.workshop.guard.armed():
        task = bar.add_task("matching", total=len(pairs))
        judged, left = judge(pairs, listed, read, pairer, lists.right_px, lambda: bar.advance(task))
    summary, times = summed_up(judged)
    if as_json:
        print_json(as_document(judged, left, summary, times))
    else:
        _print(wide(results()), judged, left, summary, times)
    if out is not None:
        from mapgraft.matching.folder import write_judged

        written = write_judged(out, judged, pairer.workshop)
        if not as_json:
            results().print(cell(f"Written to {out}: {len(written)} files"), soft_wrap=True)


def _options(shelf: Shelf, file: MapFile, side: int, asked: Asked) -> dict[str, object]:
    """What a list says of a file goes before what the command line says of all."""
    told: dict[str, object] = {RESOLUTION: file.resolution_m, "origin": file.origin, FORMAT: file.format}
    asked = asked if file.format is None else dataclasses.replace(asked, resolution_m=None, other_format=file.format)
    form = file.format or (asked.other_format if side == 1 else None)
    given = {name: value for name, value in told.items() if value is not None and shelf.takes(file.path, name, form)}
    return {**options_for(shelf, file.path, side, asked), **given}


def _print(console: Console, judged: Sequence[Judged], left: Sequence[LeftOut], summary: Summary, times: Times) -> None:
    if judged:
        _print_pairs(console, judged)
    for one in judged:
        if one.pair.kind == "unrelated" and one.pairing.accepted:
            console.print(cell(f"FALSE MERGE  {one.pair.id}: {one.pairing.reason}"), style="red", soft_wrap=True)
    away = Counter(one.pairing.reason for one in judged if one.pairing.verdict == "rejected")
    for reason, count in away.most_common(1):
        said = f"turned away  {away.total()} of {len(judged)} pairs by the decision table; {count} of them: {reason}"
        console.print(cell(said), style="yellow", soft_wrap=True)
    for reason in dict.fromkeys(pair.reason for pair in left):
        ids = [pair.id for pair in left if pair.reason == reason]
        console.print(cell(f"left out     {', '.join(ids)}: {reason}"), style="yellow", soft_wrap=True)
    if judged and away.total() == len(judged):
        return  # there is nothing to count
    used = Counter(
        one.pairing.ruling.rule.match.use for one in judged if one.pairing.ruling.rule and one.pairing.ruling.rule.match
    )
    title = ", ".join(name for name, _ in used.most_common()) or "no rule applied"
    print_tables(console, [Column(title, summary, times)], ready_maps=True)


def _print_pairs(console: Console, judged: Sequence[Judged]) -> None:
    """One row for each pair, as far as the console is wide: names are shortened, what tells least is left out."""
    rows = [_row(one) for one in judged]
    widths = {name: max(len(name), *(len(row[name]) for row in rows)) for name in rows[0]}
    left = console.width - sum(width + GAP for width in widths.values())
    for name in LEAST_TELLING:
        if left >= min(0, NAME_WIDTH - widths[PAIR]):
            break
        left += widths.pop(name) + GAP
    widths[PAIR] = max(min(NAME_WIDTH, widths[PAIR]), widths[PAIR] + min(0, left))
    table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, GAP, 0, 0))
    for name in widths:
        table.add_column(name, justify="left" if name in (PAIR, "best", "verdict") else "right", no_wrap=True)
    for one, row in zip(judged, rows, strict=True):
        said = {**row, PAIR: shortened(row[PAIR], widths[PAIR])}
        table.add_row(*(cell(said[name]) for name in widths), style="red" if one.scored.merged_wrong else "")
    console.print(table)


def shortened(name: str, width: int) -> str:
    """The name with an ellipsis in its middle where it is longer than so many characters."""
    if len(name) <= width:
        return name
    tail = (width - 1) // 2
    return f"{name[: width - 1 - tail]}…{name[len(name) - tail :]}"


def _row(one: Judged) -> dict[str, str]:
    """A pair in words. Of unrelated ones nothing is right, so of these only what was found and decided."""
    scored, best, accepted = one.scored, one.scored.best, one.scored.accepted
    unrelated, numbers = one.pair.kind == "unrelated", scored.numbers
    return {
        PAIR: one.pair.id,
        "overlap": "" if scored.overlap is None else f"{scored.overlap:.2f}",
        "best": "unrelated" if unrelated else _word(best),
        "error": "" if best is None else _off(best),
        "turned": "" if best is None or best.error_deg is None else f"{best.error_deg:.1f}°",
        **{name: shown(numbers[name]) if name in numbers else "" for name in ("score", "margin")},
        "verdict": scored.verdict if accepted is None else f"{scored.verdict}, {_word(accepted)}",
        "s": "" if scored.match_s is None else f"{scored.match_s:.2f}",
    }


def _word(placed: Placed | None) -> str:
    return "none" if placed is None else "right" if placed.right else "wrong"


def _off(placed: Placed) -> str:
    if placed.error_px is not None:
        return f"{placed.error_px:.1f} px"
    return "" if placed.error_m is None else f"{placed.error_m:.3f} m"


def as_document(judged: Sequence[Judged], left: Sequence[LeftOut], summary: Summary, times: Times) -> dict[str, Any]:
    """The same for machines; the keys are documented with the command, those of the summary with ``evaluate``."""
    counted = dataclasses.asdict(summary)
    del counted["afterwards"], counted["covariance"]["inside"]  # of ready maps nothing is known of these
    content: dict[str, Any] = finite(
        {
            "format_version": 2,
            "pairs": [_pair(one) for one in judged],
            "left_out": [{"id": pair.id, "reason": pair.reason} for pair in left],
            "summary": counted,
            "times": {"match_ms": dataclasses.asdict(times.match_ms)},
        }
    )
    return content


def _pair(one: Judged) -> dict[str, Any]:
    """What ``mapgraft match`` tells of a pair, and how it holds against the truth."""
    scored = one.scored
    return {
        "id": one.pair.id,
        "kind": one.pair.kind,
        "overlap": scored.overlap,
        "best": _judgement(scored.best),
        "of_accepted": _judgement(scored.accepted),
        "sigma_max_m": scored.sigma_max_m,
        **document(one.pairing),
        "match_s": one.pairing.match_s,
        "elapsed_s": one.pairing.elapsed_s,
    }


def _judgement(placed: Placed | None) -> dict[str, Any] | None:
    if placed is None:
        return None
    return {name: getattr(placed, name) for name in ("right", "error_m", "error_deg", "error_px")}
