"""Do thresholds that were calibrated in two buildings hold in two others? ``python tests/bench/bench_calibrate.py``.

Intel Research Lab and ACES set the thresholds, Belgioioso and Freiburg 101 are held out: examples of the first two are
collected (``mapgraft calibrate --collecting``, ``evaluate --examples``), thresholds are set with every option at its
default, and the decision table that comes of it is evaluated on the other two. Seeds, pairs and rates were fixed before
anything of the held-out buildings was looked at, and nothing is chosen by what comes out.

What was computed is kept under ``--work`` and used again; ``--pairs`` and ``--held-out-pairs`` make it shorter. Exact
intervals take pairs for independent; those by bootstrap draw stretches of the recordings anew, as ``evaluate`` does.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mapgraft.calibrate.rates import Rate
from mapgraft.cli import invoke
from mapgraft.errors import MapgraftError
from mapgraft.evaluation.statistics import resampled, share
from mapgraft.evaluation.tables import percent
from mapgraft.examples.reading import ExampleFolder

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "carmen"
KNOWN, HELD_OUT = ("intel", "aces"), ("belgioioso", "freiburg-101")
RESOLUTIONS_M = ((0.07, 0.07), (0.07, 0.10))
KNOWN_SEED, HELD_OUT_SEED = 801, 811  # of the first pair of resolutions; the next one takes the next
DRAWN = ("--across", "0.25", "--scans", "30", "--further", "30", "--no-baseline", "--quiet")
SIDES = ("receiver", "donor")
Row = Mapping[str, Any]


def main() -> None:
    options = _options()
    known, held_out, out = (options.work / name for name in ("calibration", "held-out", "thresholds"))
    collecting = options.work / "collecting.yaml"
    options.work.mkdir(parents=True, exist_ok=True)
    if not _complete(known):
        _run("calibrate", "--collecting", str(collecting))
        _evaluate(KNOWN, options.data, collecting, options.pairs, KNOWN_SEED, known, options.jobs)
    _run("calibrate", str(known), "-o", str(out))
    if not _complete(held_out):
        rules = out / "rules.yaml"
        _evaluate(HELD_OUT, options.data, rules, options.held_out_pairs, HELD_OUT_SEED, held_out, options.jobs)
    for line in tables(read(held_out)):
        print(line)
    documents = sorted(options.work.glob(f"{held_out.name}-*.json"))
    if documents:
        print("\n" + by_stretches([json.loads(path.read_text(encoding="utf-8")) for path in documents]))
    print("\nThe same with the scores of the held-out maps told beforehand (--for), without their labels:\n")
    _run("calibrate", str(known), "-o", str(options.work / "thresholds-for-held-out"), "--for", str(held_out))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the four CARMEN logs")
    parser.add_argument(
        "--work", type=Path, default=Path("calibrate-bench"), help="where examples and thresholds are kept"
    )
    parser.add_argument("--pairs", type=int, default=750, help="per pair of resolutions, for setting thresholds")
    parser.add_argument("--held-out-pairs", type=int, default=300, help="the same in the held-out buildings")
    parser.add_argument("--jobs", type=int, default=1)
    return parser.parse_args()


def _complete(path: Path) -> bool:
    """Whether every pair of resolutions has been evaluated."""
    return len(list((path / "examples").glob("run_id=*"))) >= len(RESOLUTIONS_M)


def _evaluate(names: Sequence[str], data: Path, rules: Path, pairs: int, seed: int, out: Path, jobs: int) -> None:
    files = [str(data / f"{name}-corrected.log.gz") for name in names]
    for number, (own_m, other_m) in enumerate(RESOLUTIONS_M):
        sides = ("--resolution", f"{own_m}", "--other-resolution", f"{other_m}")
        drawn = ("--pairs", f"{pairs}", "--seed", f"{seed + number}", "--jobs", f"{jobs}", *DRAWN)
        told = ("--examples", str(out), "--json", str(out.parent / f"{out.name}-{seed + number}.json"))
        _run("evaluate", *files, *sides, *drawn, "--rules", str(rules), *told)


def _run(*arguments: str) -> None:
    print(f"$ mapgraft {' '.join(arguments)}", flush=True)
    if invoke(list(arguments)) != 0:
        raise MapgraftError(f"mapgraft {arguments[0]} failed")


def read(path: Path) -> list[Row]:
    """The attempts of a folder that had a hypothesis."""
    sides = ("receiver_resolution_m", "donor_resolution_m")
    columns = ["environment", *sides, "verdict", "state", "chosen", "truth", "truth_final"]
    return [row for row in ExampleFolder(path).rows(columns).to_pylist() if row["chosen"] is not None]


def tables(rows: Sequence[Row]) -> Iterator[str]:
    """What the rules did to the held-out pairs, in Markdown: by resolution and environment, and all together."""
    titles = (
        "cells, m",
        "environment",
        "wrong accepted",
        "right accepted",
        "wrong confirmed",
        "right reverted",
        "right confirmed",
    )
    yield "| " + " | ".join(titles) + " |"
    yield "| " + " | ".join("---" for _ in titles) + " |"
    for own_m, other_m in RESOLUTIONS_M:
        here = [r for r in rows if (r["receiver_resolution_m"], r["donor_resolution_m"]) == (own_m, other_m)]
        yield from (
            _line(f"{own_m:.2f} / {other_m:.2f}" if not n else "", name, part)
            for n, (name, part) in enumerate(_parts(here))
        )
    yield _line("together", "all", rows)


def by_stretches(documents: Sequence[Mapping[str, Any]]) -> str:
    """Both shares of all pairs with intervals by bootstrap over the stretches that the windows lie in."""
    pairs = [pair for document in documents for pair in document["pairs"] if pair["judged"]["right"] is not None]
    span = documents[0]["parameters"]["scans"] + documents[0]["parameters"]["further"]
    blocks = [
        [(pair[side]["robot"], (pair[side]["first_scan"] + span // 2) // span) for side in SIDES] for pair in pairs
    ]
    numbers = {block: number for number, block in enumerate(sorted({one for both in blocks for one in both}))}
    weights = resampled([[numbers[one] for one in both] for both in blocks], HELD_OUT_SEED)
    right = np.array([pair["judged"]["right"] for pair in pairs], np.bool_)
    merged = [pair["judged"]["verdict"] == "provisional" for pair in pairs]
    wrongs, rights = (percent(share(merged, among, weights)) for among in (~right, right))
    return f"By bootstrap over {len(numbers)} stretches: wrong accepted {wrongs}, right accepted {rights}"


def _parts(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    yield "all", list(rows)
    for name in sorted({row["environment"] for row in rows}):
        yield name.replace("-corrected", ""), [row for row in rows if row["environment"] == name]


def _line(cells: str, name: str, rows: Sequence[Row]) -> str:
    wrong, right = ([row for row in rows if row["truth"] == kind] for kind in ("wrong", "right"))
    stands = [row for row in right if row["verdict"] == "provisional"]
    shares = (
        _share(wrong, lambda row: row["verdict"] == "provisional"),
        _share(right, lambda row: row["verdict"] == "provisional"),
        _share(wrong, lambda row: row["state"] == "confirmed" and row["truth_final"] == "wrong"),
        _share(stands, lambda row: row["state"] == "reverted"),
        _share(stands, lambda row: row["state"] == "confirmed"),
    )
    return "| " + " | ".join((cells, name, *shares)) + " |"


def _share(rows: Sequence[Row], hit: Callable[[Row], bool]) -> str:
    return Rate.counted(sum(map(hit, rows)), len(rows)).text if rows else "–"


if __name__ == "__main__":
    main()
