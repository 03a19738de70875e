"""``mapgraft match --pairs``: a whole list of map pairs whose truth is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from mapgraft.commands.match import Asked, options_for, pairer_of
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.errors import UsageError
from mapgraft.evaluation.statistics import Share
from mapgraft.job import as_config
from mapgraft.matching.document import document, number
from mapgraft.matching.judging import Error, Judged, LeftOut, judge
from mapgraft.matching.pair_list import MapFile, read_lists
from mapgraft.matching.ready_map import RESOLUTION, ReadyMap, Shelf
from mapgraft.matching.tally import EVIDENCE, Answers, Tally, tally
from mapgraft.plugins import load_plugins

_WIDTH = 140  # characters


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

    def read(file: MapFile, side: int) -> ReadyMap:
        return shelf.read(file.path, _options(shelf, file, side, asked))

    console = remarks()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("matching", total=len(pairs))
        judged, left = judge(pairs, listed, read, pairer, lists.right_px, lambda: bar.advance(task))
    counted = tally(judged)
    if as_json:
        print_json(as_document(judged, left, counted))
    else:
        _print(_wide(results()), judged, left, counted)
    if out is not None:
        from mapgraft.matching.folder import write_judged

        written = write_judged(out, judged, pairer.workshop)
        if not as_json:
            results().print(cell(f"Written to {out}: {len(written)} files"), soft_wrap=True)


def _options(shelf: Shelf, file: MapFile, side: int, asked: Asked) -> dict[str, object]:
    """What a list says of a file goes before what the command line says of all."""
    told = {RESOLUTION: file.resolution_m, "origin": file.origin}
    given = {name: value for name, value in told.items() if value is not None and shelf.takes(file.path, name)}
    return {**options_for(shelf, file.path, side, asked), **given}


def _wide(console: Console) -> Console:
    """Where nobody's terminal says how wide lines may be, wide enough for the tables."""
    if not console.is_terminal:
        console.width = _WIDTH
    return console


def _print(console: Console, judged: Sequence[Judged], left: Sequence[LeftOut], counted: Tally) -> None:
    _print_pairs(console, [j for j in judged if j.pair.kind != "unrelated"])
    for false in (j for j in judged if j.pair.kind == "unrelated" and j.merged):
        said = f"FALSE MERGE  {false.pair.id}: {false.pairing.reason}"
        console.print(cell(said), style="red", soft_wrap=True)
    for reason in dict.fromkeys(pair.reason for pair in left):
        ids = [pair.id for pair in left if pair.reason == reason]
        console.print(cell(f"left out     {', '.join(ids)}: {reason}"), style="yellow", soft_wrap=True)
    _print_tally(console, counted)


def _print_pairs(console: Console, judged: Sequence[Judged]) -> None:
    if not judged:
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in ("pair", "overlap", "first", "error", "turned", "score", "margin", "verdict", "s"):
        table.add_column(column, justify="left" if column in ("pair", "first", "verdict") else "right")
    for one in judged:
        first, best = one.first, one.pairing.hypotheses[0].match if one.pairing.hypotheses else None
        table.add_row(
            cell(one.pair.id),
            f"{one.overlap:.2f}" if one.overlap is not None else "",
            cell(
                _word(first),
            ),
            _off(first),
            "" if first is None or first.rotation_deg is None else f"{first.rotation_deg:.1f}°",
            "" if best is None else f"{best.score:.4g}",
            "" if best is None else f"{best.margin:.4g}",
            cell(f"{one.pairing.verdict}{', ' + _word(one.accepted) if one.merged else ''}"),
            f"{one.pairing.match_s:.2f}",
            style="red" if (one.accepted and not one.accepted.right) else "",
        )
    console.print(table)


def _print_tally(console: Console, counted: Tally) -> None:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in (f"{counted.pairs} pairs with truth", "right", "wrong", "no answer", "median error of the right"):
        table.add_column(column, justify="left" if column.endswith("truth") else "right")
    for name, answers in (("matcher's first hypothesis", counted.first), ("accepted by the rules", counted.accepted)):
        table.add_row(name, _share(answers.right), _share(answers.wrong), _share(answers.none), _median(answers))
    if counted.pairs:
        console.print(table)
    if counted.unrelated:
        merged = counted.merged
        console.print(
            f"{counted.unrelated} unrelated pairs: {_share(merged)} merged", style="red" if merged.count else "green"
        )
    shown = (name for name in counted.areas if not name.startswith(EVIDENCE))
    telling = {name: counted.areas[name] for name in shown if not math.isnan(counted.areas[name].value)}
    if telling:
        said = ", ".join(f"{name} {area.value:.3f}" for name, area in telling.items())
        console.print(cell(f"area under the curve, right against all other first hypotheses: {said}"), soft_wrap=True)
    console.print(f"matching took {counted.median_s:.3f} s (median), {counted.longest_s:.3f} s (longest)")


def _word(error: Error | None) -> str:
    return "none" if error is None else "right" if error.right else "wrong"


def _off(error: Error | None) -> str:
    if error is None:
        return ""
    return f"{error.keypoint_px:.1f} px" if error.keypoint_px is not None else f"{error.displacement_m:.3f} m"


def _share(share: Share) -> str:
    if not share.of:
        return "–"
    return f"{share.count} ({100 * share.value:.1f} %, {100 * share.low:.1f}–{100 * share.high:.1f})"


def _median(answers: Answers) -> str:
    parts = [(answers.median_m, "{:.3f} m"), (answers.median_px, "{:.1f} px"), (answers.median_deg, "{:.2f}°")]
    return ", ".join(form.format(value) for value, form in parts if not math.isnan(value))


def as_document(judged: Sequence[Judged], left: Sequence[LeftOut], counted: Tally) -> dict[str, Any]:
    """The same for machines; the keys are documented with the command."""
    return {
        "format_version": 1,
        "pairs": [_pair(one) for one in judged],
        "left_out": [{"id": pair.id, "reason": pair.reason} for pair in left],
        "summary": {
            "pairs": counted.pairs,
            "unrelated": counted.unrelated,
            "first": _answers(counted.first),
            "accepted": _answers(counted.accepted),
            "false_merges": _interval(counted.merged),
            "auc": {
                name: {"value": number(a.value), "low": number(a.low), "high": number(a.high)}
                for name, a in counted.areas.items()
            },
            "match_s": {"median": number(counted.median_s), "longest": number(counted.longest_s)},
        },
    }


def _pair(one: Judged) -> dict[str, Any]:
    times = {"match_s": one.pairing.match_s, "elapsed_s": one.pairing.elapsed_s}
    errors = {"first": _error(one.first), "of_accepted": _error(one.accepted)}
    return {
        "id": one.pair.id,
        "kind": one.pair.kind,
        "overlap": one.overlap,
        **errors,
        **document(one.pairing),
        **times,
    }


def _error(error: Error | None) -> dict[str, Any] | None:
    return None if error is None else error._asdict()


def _answers(answers: Answers) -> dict[str, Any]:
    return {
        "right": _interval(answers.right),
        "wrong": _interval(answers.wrong),
        "no_answer": _interval(answers.none),
        "median_m": number(answers.median_m),
        "median_deg": number(answers.median_deg),
        "median_px": number(answers.median_px),
    }


def _interval(share: Share) -> dict[str, Any]:
    return {
        "count": share.count,
        "of": share.of,
        "value": number(share.value),
        "low": number(share.low),
        "high": number(share.high),
    }
