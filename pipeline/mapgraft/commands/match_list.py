"""``mapgraft match --pairs``: a whole list of map pairs whose truth is known."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from mapgraft.commands.match import Asked, options_for, pairer_of, print_remarks
from mapgraft.console import cell, print_json, remarks, results
from mapgraft.errors import UsageError
from mapgraft.evaluation.statistics import Area, Share, Spread
from mapgraft.evaluation.summary import BINS
from mapgraft.evaluation.tables import auc, percent
from mapgraft.job import as_config
from mapgraft.matching.document import document, number
from mapgraft.matching.judging import Error, Judged, LeftOut, judge
from mapgraft.matching.pair_list import MapFile, read_lists
from mapgraft.matching.ready_map import RESOLUTION, ReadyMap, Shelf
from mapgraft.matching.tally import EVIDENCE, Tally, tally
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

    seen: set[Path] = set()

    def read(file: MapFile, side: int) -> ReadyMap:
        map_ = shelf.read(file.path, _options(shelf, file, side, asked))
        if file.path not in seen:
            seen.add(file.path)
            print_remarks(map_)
        return map_

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
    """The rows of ``mapgraft evaluate`` that ready maps have, under the same names."""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    for title, rows in _parts(counted).items():
        table.add_row(cell(title), style="bold")
        for name, text in rows.items():
            table.add_row(cell(f"  {name}"), cell(text))
    console.print(table)


def _parts(counted: Tally) -> dict[str, dict[str, str]]:
    telling = {name: area for name, area in counted.areas.items() if not math.isnan(area.value)}
    best = sorted(telling, key=lambda name: -max(telling[name].value, 1.0 - telling[name].value))
    shown = [name for name in best if not name.startswith(EVIDENCE)]
    return {
        "pairs": {
            "with truth": str(counted.pairs),
            "unrelated": str(counted.unrelated),
            "turned away by the decision table": str(counted.rejected),
            "best hypothesis right / wrong / none": " / ".join(
                str(share.count) for share in (counted.first_right, counted.first_wrong, counted.first_none)
            ),
        },
        "right hypothesis on top, by true overlap": {
            **{name: percent(share) for name, share in zip(BINS, counted.recall, strict=True)},
            ">= .3": percent(counted.recall_from_some),
        },
        "merged": {
            "right, of pairs with truth": percent(counted.accepted_right),
            "right, of right hypotheses at overlap >= .5": percent(counted.accepted_of_right),
            "wrong, of pairs with truth": percent(counted.accepted_wrong),
            "unrelated, of unrelated pairs": percent(counted.merged),
            "ambiguous": str(counted.ambiguous),
        },
        "error of right hypotheses, median (95th percentile)": {
            "walls": _spread(counted.off.metres, "m"),
            "keypoints": _spread(counted.off.pixels, "px"),
            "rotation": _spread(counted.off.degrees, "°"),
        },
        "time, median (95th percentile), longest": {
            "match": f"{_spread(counted.match_s, 's')}, {counted.longest_s:.3g} s" if counted.match_s.count else "-",
        },
        "area under the curve, right against wrong and unrelated": {name: auc(telling[name]) for name in shown},
    }


def _word(error: Error | None) -> str:
    return "none" if error is None else "right" if error.right else "wrong"


def _off(error: Error | None) -> str:
    if error is None:
        return ""
    return f"{error.keypoint_px:.1f} px" if error.keypoint_px is not None else f"{error.displacement_m:.3f} m"


def _spread(spread: Spread, unit: str) -> str:
    gap = "" if unit == "°" else " "
    return "-" if spread.count == 0 else f"{spread.median:.3g}{gap}{unit} ({spread.p95:.3g})"


def as_document(judged: Sequence[Judged], left: Sequence[LeftOut], counted: Tally) -> dict[str, Any]:
    """The same for machines; the keys are documented with the command."""
    return {
        "format_version": 1,
        "pairs": [_pair(one) for one in judged],
        "left_out": [{"id": pair.id, "reason": pair.reason} for pair in left],
        "summary": {
            "pairs": counted.pairs,
            "unrelated": counted.unrelated,
            "rejected": counted.rejected,
            "ambiguous": counted.ambiguous,
            "first": {name: _numbers(getattr(counted, f"first_{name}")) for name in ("right", "wrong", "none")},
            "recall": {name: _numbers(share) for name, share in zip(BINS, counted.recall, strict=True)},
            "recall_from_some_overlap": _numbers(counted.recall_from_some),
            "accepted": {name: _numbers(getattr(counted, f"accepted_{name}")) for name in ("right", "wrong")},
            "accepted_of_right_at_much_overlap": _numbers(counted.accepted_of_right),
            "unrelated_merged": _numbers(counted.merged),
            "error_m": _numbers(counted.off.metres),
            "error_px": _numbers(counted.off.pixels),
            "error_deg": _numbers(counted.off.degrees),
            "auc": {name: _numbers(area) for name, area in counted.areas.items()},
            "match_s": {**_numbers(counted.match_s), "longest": number(counted.longest_s)},
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


def _numbers(counted: Share | Spread | Area) -> dict[str, float | None]:
    return {name: number(value) for name, value in dataclasses.asdict(counted).items()}
