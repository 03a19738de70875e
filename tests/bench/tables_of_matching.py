"""Puts measured tables into docs/matching.md: from the JSON of ``mapgraft evaluate`` and of lists of map pairs.

    mapgraft evaluate LOG… --pairs 500 --resolution 0.07 --json 07-07.json      # as often as wanted
    python tests/bench/evaluate_map_pairs.py --json maps                        # writes maps/grid.json and so on
    python tests/bench/tables_of_matching.py 07-07.json … maps/*.json           # writes between the page's markers
    python tests/bench/tables_of_matching.py --print 07-07.json …               # prints instead

Intervals are 95 %, by bootstrap over stretches of the recordings, over all the runs that a row is made of; equal
windows in several runs (the same seed at other resolutions) are one stretch. Where none or all were hit they are
those of Clopper and Pearson for as many things as there are different pairs of windows.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from mapgraft.evaluation.certainty import ELLIPSE_95
from mapgraft.evaluation.statistics import Area, Share, Spread, Weights, clopper_pearson, resampled, share, spread
from mapgraft.evaluation.summary import BINS, MUCH_OVERLAP, NEW_WALL_M, SOME_OVERLAP, bin_of
from mapgraft.evaluation.tables import auc, milliseconds, percent
from mapgraft_grid.evidence.posterior import MODEL_FILE

PAGE: Final = Path(__file__).parents[2] / "docs" / "matching.md"
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
JUDGED, BASELINE = "judged", "baseline"
TIMES: Final = {  # what is timed, and what that is called
    "match_ms": "one match",
    "integrate_ms": "map a scan",
    "verify_ms": "verify, per scan",
    "anew_ms": "register anew, each",
    "final_ms": "last look",
}
TOGETHER: Final = "together"
Row = Mapping[str, Any]  # an entry of ``pairs``


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One call of ``mapgraft evaluate``."""

    content: Mapping[str, Any]

    @property
    def label(self) -> str:
        given = self.content["parameters"]
        sides = (given["resolution_m"], given["other_resolution_m"])
        return " / ".join("default" if side is None else f"{side:.2f}" for side in sides)

    @property
    def command(self) -> str:
        given = self.content["parameters"]
        options = [f"--{name} {given[name]}" for name in ("pairs", "scans", "further", "seed")]
        options += [f"--across {given['across']:g}"] if given["across"] != 0.5 else []
        named = {"resolution": "resolution_m", "other-resolution": "other_resolution_m"}
        options += [f"--{option} {given[key]:g}" for option, key in named.items() if given[key] is not None]
        options += [f"--{name} {given[name]}" for name in ("matcher", "verifier") if given[name]]
        files = " ".join(Path(file["path"]).name for file in self.content["files"])
        return f"mapgraft evaluate {files} {' '.join(options)}"

    @property
    def rows(self) -> Sequence[Row]:
        rows: Sequence[Row] = self.content["pairs"]
        return rows

    @property
    def procedures(self) -> dict[str, str]:
        """Name → title."""
        return {name: told["title"] for name, told in self.content["procedures"].items()}


@dataclass(frozen=True, slots=True, eq=False)
class Listed:
    """One list of ready-made map pairs."""

    name: str
    summary: Mapping[str, Any]
    times: Mapping[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Crowd:
    """Pairs of which shares are asked, as one procedure did with them."""

    rows: Sequence[Row]
    procedure: str
    weights: Weights

    @classmethod
    def of(cls, rows: Sequence[Row], procedure: str) -> Crowd:
        rows = [row for row in rows if procedure in row]
        return cls(rows, procedure, resampled(blocks_of(rows), 0) if rows else np.ones((1, 0)))

    def share(self, hit: Callable[[Row, Row], bool], among: Callable[[Row, Row], bool] = lambda *_: True) -> Share:
        """``hit`` and ``among`` are asked of each pair and of what the procedure did with it."""
        pairs = [(row, row[self.procedure]) for row in self.rows]
        inside = [among(*pair) for pair in pairs]
        found = share([hit(*pair) for pair in pairs], inside, self.weights)
        if found.of == 0 or found.count not in (0, found.of):
            return found
        different = len({_windows(row) for row, is_in in zip(self.rows, inside, strict=True) if is_in})
        low, high = clopper_pearson(found.count and different, different)
        return replace(found, low=low, high=high)

    def spread(self, number: Callable[[Row], float | None]) -> Spread:
        found = (number(row[self.procedure]) for row in self.rows)
        return spread([value for value in found if value is not None])


def _windows(row: Row) -> tuple[str, int, str, int]:
    """The same for one pair of windows at two resolutions, which are not two independent pairs."""
    receiver, donor = row["receiver"], row["donor"]
    return receiver["robot"], receiver["first_scan"], donor["robot"], donor["first_scan"]


def blocks_of(rows: Sequence[Row]) -> list[tuple[int, int]]:
    """The stretches of recordings in which the windows of each pair lie, numbered."""
    numbers: dict[tuple[str, int], int] = {}

    def number(side: Mapping[str, Any]) -> int:
        return numbers.setdefault((side["robot"], side["stretch"]), len(numbers))

    return [(number(row["receiver"]), number(row["donor"])) for row in rows]


def is_right(row: Row, done: Row) -> bool:
    return bool(done["right"])


def is_wrong(row: Row, done: Row) -> bool:
    return done["best"] is not None and not done["right"]


def merged_right(row: Row, done: Row) -> bool:
    return done["accepted"] is not None and bool(done["accepted"]["right"])


def merged_wrong(row: Row, done: Row) -> bool:
    return done["accepted"] is not None and not done["accepted"]["right"]


def lies_wrong(row: Row, done: Row) -> bool:
    return done["final"] is not None and not done["final"]["right"]


def overlaps(least: float) -> Callable[[Row, Row], bool]:
    return lambda row, done: row["overlap"] is not None and row["overlap"] >= least


def matched(row: Row, done: Row) -> bool:
    return bool(done["verdict"] != "rejected")


def both(*questions: Callable[[Row, Row], bool]) -> Callable[[Row, Row], bool]:
    return lambda row, done: all(question(row, done) for question in questions)


def in_state(state: str) -> Callable[[Row, Row], bool]:
    return lambda row, done: bool(done["state"] == state)


def on_new_wall(row: Row, done: Row) -> bool:
    return row["new_wall_m"] is not None and row["new_wall_m"] >= NEW_WALL_M


def groups(runs: Sequence[Run]) -> Iterator[tuple[str, Sequence[Row]]]:
    """Every run, and all of them together when they are several."""
    for run in runs:
        yield run.label, run.rows
    if len(runs) > 1:
        yield TOGETHER, [row for run in runs for row in run.rows]


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def short(found: Share) -> str:
    """``97 % 110/113``."""
    return "–" if found.of == 0 else f"{100.0 * found.value:.0f} % {found.count}/{found.of}"


def whole(found: Share) -> str:
    """With its interval."""
    return "–" if found.of == 0 else percent(found)


def recall_table(runs: Sequence[Run]) -> str:
    def line(label: str, recording: str, rows: Sequence[Row]) -> list[str]:
        ours, theirs = Crowd.of(rows, JUDGED), Crowd.of(rows, BASELINE)
        bins = [ours.share(is_right, both(matched, _in_bin(number))) for number in range(len(BINS))]
        some = both(matched, overlaps(SOME_OVERLAP))
        return [
            label,
            recording,
            *map(short, bins),
            whole(ours.share(is_right, some)),
            whole(theirs.share(is_right, some)),
        ]

    lines = []
    for label, rows in groups(runs):
        within = [row for row in rows if not row["across"]]
        lines.append(line(label, "all", within))
        robots = dict.fromkeys(row["receiver"]["robot"] for row in within)
        if len(robots) > 1 and label != TOGETHER:
            lines += [line("", robot, [row for row in within if row["receiver"]["robot"] == robot]) for robot in robots]
    names = [name.replace("<= ", "≤ ").replace(" - ", "–") for name in BINS]
    return markdown(["cells, m", "recording", *names, "≥ .3", "Carpin's, ≥ .3"], lines)


def _in_bin(number: int) -> Callable[[Row, Row], bool]:
    return lambda row, done: row["overlap"] is not None and bin_of(row["overlap"]) == number


def acceptance_table(runs: Sequence[Run]) -> str:
    lines = []
    for label, rows, procedure, title in _procedures(runs):
        crowd = Crowd.of(rows, procedure)
        lines.append(
            [
                label,
                title,
                whole(crowd.share(merged_right, both(is_right, overlaps(MUCH_OVERLAP)))),
                whole(crowd.share(merged_right, is_right)),
                whole(crowd.share(merged_wrong, is_wrong)),
                whole(crowd.share(merged_wrong, lambda row, done: bool(row["across"]))),
            ]
        )
    names = ["right at overlap ≥ .5", "all right", "wrong", "pairs across recordings"]
    return markdown(["cells, m", "procedure", *names], lines)


def afterwards_table(runs: Sequence[Run]) -> str:
    lines = []
    for label, rows, procedure, title in _procedures(runs):
        crowd = Crowd.of(rows, procedure)
        lines.append(
            [
                label,
                title,
                whole(crowd.share(both(in_state("confirmed"), lies_wrong))),
                whole(crowd.share(both(in_state("provisional"), lies_wrong))),
                whole(crowd.share(in_state("reverted"), merged_wrong)),
                whole(crowd.share(in_state("reverted"), merged_right)),
                whole(crowd.share(in_state("confirmed"), merged_right)),
                whole(crowd.share(in_state("confirmed"), both(merged_right, on_new_wall))),
            ]
        )
    names = ["wrong and confirmed", "wrong and provisional", "wrong reverted"]
    names += ["right reverted", "right confirmed", f"the same, ≥ {NEW_WALL_M:g} m of new wall"]
    return markdown(["cells, m", "procedure", *names], lines)


def _procedures(runs: Sequence[Run]) -> Iterator[tuple[str, Sequence[Row], str, str]]:
    for procedure in (JUDGED, BASELINE):
        titles = dict.fromkeys(run.procedures[procedure] for run in runs if procedure in run.procedures)
        if titles:
            for label, rows in groups([run for run in runs if procedure in run.procedures]):
                yield label, rows, procedure, " or ".join(titles)


def certainty_table(runs: Sequence[Run]) -> str:
    lines = []
    for label, rows in groups(runs):
        crowd = Crowd.of(rows, JUDGED)
        told = crowd.share(_is_sure, is_right)
        inside = crowd.share(lambda row, done: _number(done["ellipse_distance2"]) <= ELLIPSE_95, _is_sure)
        lines.append(
            [
                label,
                whole(inside),
                f"{told.of - told.count}",
                _errors(crowd, "best", is_right),
                _errors(crowd, "accepted", merged_right),
                _errors(crowd, "final", merged_right),
            ]
        )
    names = ["truth in the 95 % ellipse", "without a covariance", "first hypothesis, right", "merged, right"]
    return markdown(["cells, m", *names, "the same in the end"], lines)


def _is_sure(row: Row, done: Row) -> bool:
    return done["ellipse_distance2"] is not None


def _errors(crowd: Crowd, which: str, wanted: Callable[[Row, Row], bool]) -> str:
    """Median and 95th percentile of displacement and turn."""

    def of(done: Row, key: str) -> float | None:
        return done[which][key] if done[which] is not None and wanted(done, done) else None

    shift, turn = crowd.spread(lambda done: of(done, "error_m")), crowd.spread(lambda done: of(done, "error_deg"))
    if not shift.count:
        return "–"
    return f"{100 * shift.median:.1f} cm ({100 * shift.p95:.0f}), {turn.median:.2f}° ({turn.p95:.1f})"


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def auc_table(runs: Sequence[Run]) -> str:
    """One row per number that was measured, the best one of the first run on top; details are left out."""
    areas = [run.content["procedures"][JUDGED]["summary"]["auc"] for run in runs]
    told = {n: a["value"] for one in reversed(areas) for n, a in one.items() if a["value"] is not None and "." not in n}
    names = sorted(told, key=lambda name: -told[name])
    lines = [[f"`{name}`", *(_area(one.get(name)) for one in areas)] for name in names]
    return markdown(["right against wrong", *(run.label for run in runs)], lines)


def _area(found: Mapping[str, Any] | None) -> str:
    if found is None or found["value"] is None:
        return "–"
    return auc(Area(**{**found, **{key: _number(found[key]) for key in ("value", "low", "high")}}))


def times_table(runs: Sequence[Run]) -> str:
    lines = []
    for run in runs:
        for name, title in run.procedures.items():
            told = run.content["times"]["procedures"][name]
            spreads = [_spread(told[key]) for key in TIMES]
            lines.append([run.label, title, *map(milliseconds, spreads)])
    return markdown(["cells, m", "procedure", *TIMES.values()], lines)


def _spread(told: Mapping[str, Any]) -> Spread:
    return Spread(told["count"], *(_number(told[key]) for key in ("median", "p95", "largest")))


def held_out_table() -> str:
    """What the fit wrote down beside the coefficients."""
    found = json.loads(MODEL_FILE.read_text(encoding="utf-8"))
    shares = ("right_accepted_overlap_half", "right_accepted", "wrong_accepted")
    lines = [
        [", ".join(f"`{name}`" for name in model["coefficients"]), f"{told['auc']:.4f}", *(_percent(told, shares))]
        for model in found["models"]
        for told in (model["held_out"],)
    ]
    table = markdown(["features", "area under the curve", "taken: right at overlap ≥ .5", "all right", "wrong"], lines)
    given = found["provenance"]
    return f"{given['examples']} pairs, {given['right']} right; {given['held_out']}.\n\n{table}"


def _percent(told: Mapping[str, float], names: Sequence[str]) -> list[str]:
    return [f"{100.0 * told[name]:.3g} %" for name in names]


def lists_table(lists: Sequence[Listed]) -> str:
    lines = []
    for listed in lists:
        told, accepted = listed.summary, listed.summary["acceptance"]
        merged = [_share(accepted[name]) for name in ("right", "wrong", "wrong_across")]
        lines.append(
            [
                listed.name,
                f"{told['pairs'] - told['across']}",
                *(f"{told[name]}" for name in ("right", "wrong", "without_hypothesis")),
                *map(short, merged[:2]),
                whole(merged[2]),
                milliseconds(_spread(listed.times["match_ms"])),
            ]
        )
    names = [
        "with truth",
        "first right",
        "wrong, unrelated ones too",
        "none",
        "merged right",
        "wrong, of all",
        "unrelated and merged",
    ]
    return markdown(["list", *names, "match, median (95th percentile), longest"], lines)


def _share(told: Mapping[str, Any]) -> Share:
    numbers = (_number(told[name]) for name in ("value", "low", "high"))
    return Share(int(told["count"]), int(told["of"]), *numbers)


def page(runs: Sequence[Run], lists: Sequence[Listed]) -> str:
    """The Markdown of everything that was measured."""
    parts = []
    if runs:
        commands = "\n".join(run.command for run in runs)
        pairs = sum(len(run.rows) for run in runs)
        across = sum(bool(row["across"]) for run in runs for row in run.rows)
        further = " or ".join(dict.fromkeys(str(run.content["parameters"]["further"]) for run in runs))
        parts += [
            f"{pairs} pairs of windows, {across} of them across recordings, where nothing may be merged:",
            f"```sh\n{commands}\n```",
            "### The right place on top, by true overlap",
            recall_table(runs),
            "### Taken at once, of right best hypotheses, of wrong ones, and of pairs across recordings",
            acceptance_table(runs),
            f"### After {further} further scans, of all pairs, of wrong merges, and of right ones",
            afterwards_table(runs),
            "### How far off, and how sure: median (95th percentile)",
            certainty_table(runs),
            "### How well each number tells right from wrong best hypotheses: area under the curve",
            auc_table(runs),
            "### Time: median (95th percentile), longest",
            times_table(runs),
        ]
    parts += ["### The posterior on simulated buildings that its fit has not seen", held_out_table()]
    if lists:
        parts += ["### Ready-made maps (`tests/bench/evaluate_map_pairs.py`)", lists_table(lists)]
    return "\n\n".join(parts)


def read(path: Path) -> Run | Listed:
    """Either kind of file; raises SystemExit with a sentence for others."""
    content = json.loads(path.read_text(encoding="utf-8"))
    if content.get("format") == "mapgraft evaluation 1":
        given = content["parameters"]
        span = given["scans"] + given["further"]
        for row in content["pairs"]:
            for side in (row["receiver"], row["donor"]):
                side["stretch"] = (side["first_scan"] + span // 2) // span
        return Run(content)
    if content.get("format_version") == 2 and "summary" in content:
        return Listed(path.stem, content["summary"], content["times"])
    raise SystemExit(f"{path} is neither JSON of mapgraft evaluate nor of mapgraft match --pairs: name one of these")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--print", action="store_true", help="print the tables instead of writing them into the page")
    given = parser.parse_args()
    found = [read(path) for path in given.files]
    tables = page([one for one in found if isinstance(one, Run)], [one for one in found if isinstance(one, Listed)])
    if given.print:
        print(tables)
        return 0
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        print(f"{PAGE} has no {BEGIN} and {END}: put them where the tables belong", file=sys.stderr)
        return 1
    PAGE.write_text(f"{before}{BEGIN}\n\n{tables}\n\n{END}{after}", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
