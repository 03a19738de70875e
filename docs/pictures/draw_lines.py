"""Draws docs/pictures/lines.png and tells the table of docs/lines.md, from evaluations of one log with equal pairs.

    mapgraft evaluate intel.log.gz --pairs 200 --across 0 --no-baseline --resolution 0.07 --other-resolution 0.1 \
        --json grids.json
    mapgraft evaluate intel.log.gz --pairs 200 --across 0 --no-baseline --type line_segments --json lines.json
    mapgraft evaluate intel.log.gz --pairs 200 --across 0 --no-baseline --type line_segments \
        --other-type occupancy_grid --other-resolution 0.1 --json lines_grid.json
    mapgraft evaluate intel.log.gz --pairs 200 --across 0 --no-baseline --resolution 0.07 \
        --other-type line_segments --json grid_lines.json
    python docs/pictures/draw_lines.py intel.log.gz FOLDER

``FOLDER`` holds the four JSON files. The overlap of a pair is that of its grids, for all of them.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from mapgraft.config import parse_config
from mapgraft.contracts import Transform
from mapgraft.evaluation import Drawing, build, draw_pairs, load_courses
from mapgraft.plugins import load_plugins
from mapgraft_lines.evidence.posterior import MODEL_FILE
from mapgraft_lines.line_association import LineAssociation
from mapgraft_lines.line_map import LineMap
from mapgraft_lines.map_type import LineSegments
from mapgraft_lines.output import free_rectangles_m
from mapgraft_standard.regression import models_of, posterior

NAMES: Final = {
    "grids": "grid ← grid, `correlation`",
    "lines": "lines ← lines, `line_association`",
    "lines_grid": "lines ← grid, `line_association`",
    "grid_lines": "grid ← lines, `line_association`",
}
SURE: Final = 0.9
BANDS: Final = ((0.0, 0.1), (0.1, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 1.01))
BLUE, ORANGE, PALE = "#0072B2", "#D55E00", "#dbe7f3"
FOLDER: Final = Path(__file__).parent
DRAWN_OVERLAP: Final = (0.3, 0.6)  # of the pair in the picture


def read(folder: Path, name: str) -> list[dict[str, Any]]:
    pairs: list[dict[str, Any]] = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))["pairs"]
    return pairs


def windows(pairs: Sequence[Mapping[str, Any]]) -> list[tuple[int, int]]:
    return [(pair["receiver"]["first_scan"], pair["donor"]["first_scan"]) for pair in pairs]


def probable(judged: Mapping[str, Any]) -> bool:
    """Whether the best hypothesis is right with 0.9 or more: of grids as told, of lines by the shipped model."""
    numbers = judged["numbers"]
    if "posterior" in numbers:
        return bool(numbers["posterior"] >= SURE)
    start = "line_posterior."
    features = {name.removeprefix(start): value for name, value in numbers.items() if name.startswith(start)}
    told = posterior("line_posterior", models_of(MODEL_FILE, "line_posterior"), features, support=0)
    return told.value >= SURE  # NaN is not


def table(folder: Path) -> str:
    """Right best hypotheses by the overlap of the grids, and those that are right with a probability of 0.9 or more."""
    grids = read(folder, "grids")
    overlap = np.array([pair["overlap"] for pair in grids])
    head = [f"{low:g} – {min(high, 1.0):g}" for low, high in BANDS]
    rows = [["", *head, "sure and right", "sure and wrong", "median match"]]
    for name, title in NAMES.items():
        pairs = read(folder, name)
        if windows(pairs) != windows(grids):
            raise SystemExit(f"{name}.json is of other pairs than grids.json: evaluate them alike")
        judged = [pair["judged"] for pair in pairs]
        right = np.array([bool(one["right"]) for one in judged])
        counts = []
        for low, high in BANDS:
            inside = (overlap >= low) & (overlap < high)
            counts.append(f"{right[inside].sum()} / {inside.sum()}")
        sure = np.array([probable(one) for one in judged])
        times = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))["times"]
        match_ms = times["procedures"]["judged"]["match_ms"]["median"]
        rows.append([title, *counts, str((sure & right).sum()), str((sure & ~right).sum()), f"{match_ms:.0f} ms"])
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]])


def show(axes: Axes, seen: LineMap, colour: str, T: Transform | None = None) -> None:
    """Walls and free space of one map, moved."""
    T = T or Transform.identity()
    for x0, y0, x1, y1 in free_rectangles_m(seen).tolist():
        axes.fill(*T.apply(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])).T, color=PALE, lw=0)
    ends = T.apply(seen.walls.ends_m.reshape(-1, 2)).reshape(-1, 2, 2)
    axes.add_collection(LineCollection(list(ends), colors=colour, linewidths=1.6))
    axes.set_aspect("equal")
    axes.autoscale()


def draw(log: Path, folder: Path) -> None:
    """A pair of windows: both maps, and the donor's where the matcher puts it."""
    plugins, config = load_plugins(), parse_config({})
    kind = LineSegments()
    grids = read(folder, "grids")
    low, high = DRAWN_OVERLAP
    number = next(
        k
        for k, (grid, line) in enumerate(zip(grids, read(folder, "lines"), strict=True))
        if low <= grid["overlap"] <= high and line["judged"]["right"]
    )
    parameters = json.loads((folder / "lines.json").read_text(encoding="utf-8"))["parameters"]
    drawing = Drawing(*(parameters[name] for name in ("pairs", "scans", "further", "across", "seed")))
    plan = draw_pairs(load_courses([log], config, plugins), drawing)[number]
    pair = build(plan, kind, kind)
    own, donor = kind.view(pair.receiver.layer), kind.view(pair.donor.layer)
    best = LineAssociation().match(own, donor)[0]
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(15, 5.2), layout="constrained")
    show(left, own, BLUE)
    left.set_title(f"receiver: {len(own.walls)} walls")
    show(middle, donor, ORANGE)
    middle.set_title(f"donor: {len(donor.walls)} walls")
    show(right, own, BLUE)
    show(right, donor, ORANGE, best.T_receiver_donor)
    explained, against = best.evidence["explained_m"], best.evidence["against_m"]
    right.set_title(f"found: {explained:.0f} m of wall explained, {against:.1f} m against")
    for axes in (left, middle, right):
        axes.set_xlabel("m")
    figure.savefig(FOLDER / "lines.png", dpi=90)


if __name__ == "__main__":
    sys.stdout.write(table(Path(sys.argv[2])) + "\n")
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
