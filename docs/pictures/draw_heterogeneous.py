"""Draws heterogeneous.png: what becomes of four maps of four types when the demo of their robots is replayed.

python docs/pictures/draw_heterogeneous.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

import mapgraft
from mapgraft.contracts import Finding, Points, Transform
from mapgraft.events import Snapshot
from mapgraft.outputs.memory_sink import MemorySink
from mapgraft_grid.grid_map import FREE, OCCUPIED, GridMap
from mapgraft_recordings import demo_files
from mapgraft_recordings.outcome import read_outcome

mpl.use("Agg")

OWN, DONOR, FOUND, ADDED = "#20242a", "#2a6fbb", "#d2342c", "#e6952b"
NAME = "heterogeneous"
BAND_M = (0.3, 2.4)
WINDOW = (-21.5, 21.5, -8.2, 8.2)  # metres in the world's frame


def walls(snapshot: Snapshot, fused: bool = False) -> Points:
    """Where a map of any type has walls, in its own frame."""
    points = snapshot.map_type.structure(snapshot.fused if fused else snapshot.own)
    if points.shape[1] == 3:  # seen from above, floor and ceiling would hide the rest
        points = points[(points[:, 2] > BAND_M[0]) & (points[:, 2] < BAND_M[1])]
    return points[:, :2]


def latest(memory: MemorySink, robot: str, stamp_ns: int) -> Snapshot:
    return [s for s in memory.snapshots if s.robot == robot and s.stamp_ns <= stamp_ns][-1]


def show(axes: Any, T_world_map: Transform, points: Points, colour: str, size: float = 0.3) -> None:
    placed = T_world_map.apply(points)
    axes.scatter(placed[:, 0], placed[:, 1], s=size, c=colour, linewidths=0)


def show_grid(axes: Any, T_world_map: Transform, grid: GridMap) -> None:
    """Free space light, walls dark."""
    dense = grid.dense()
    for kind, colour, size in ((FREE, "#e8eef5", 0.5), (OCCUPIED, OWN, 0.4)):
        rows, columns = np.nonzero(dense.classes == kind)
        cells = np.stack((columns + 0.5, rows + 0.5), axis=1) * dense.resolution_m + np.array(dense.origin_m)
        show(axes, T_world_map, cells, colour, size)


def finish(axes: Any, title: str) -> None:
    axes.set_xlim(*WINDOW[:2])
    axes.set_ylim(*WINDOW[2:])
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title(title, fontsize=9, loc="left")


def findings(events: Any, receiver: str, donor: str) -> tuple[Finding, ...]:
    told = [
        measurement.findings
        for event in events
        if (event.receiver, event.donor) == (receiver, donor) and event.state in ("provisional", "confirmed")
        for measurement in event.measurements
        if measurement.findings
    ]
    return tuple(told[-1])


def main() -> None:
    import matplotlib.pyplot as plt

    files, config, expected = demo_files(NAME)
    memory, outcome = MemorySink(), read_outcome(expected)
    result = mapgraft.run(files, config, sinks=[memory])
    truth = {name: Transform.planar(*pose) for name, pose in outcome.T_world_map.items()}
    merged = {
        (event.receiver, event.donor): event for event in reversed(result.events) if event.kind == "merged"
    }  # the first of each pair
    figure, panels = plt.subplots(3, 2, figsize=(10.5, 6.6))

    wrong = merged["bravo", "alpha"]
    at = memory.snapshot("bravo", "after merge", wrong.merge_id)
    axes = panels[0, 0]
    show(axes, truth["bravo"], walls(at), OWN)
    assert wrong.T_receiver_donor is not None
    show(axes, truth["bravo"] @ wrong.T_receiver_donor, walls(latest(memory, "alpha", at.stamp_ns)), DONOR)
    finish(axes, "bravo, a cloud (black), with alpha's grid (blue) in the wrong wing")

    undone = next(event for event in result.events if event.kind == "reverted" and event.receiver == "bravo")
    at = memory.snapshot("bravo", "after revert", undone.merge_id)
    show(panels[0, 1], truth["bravo"], walls(at, fused=True), OWN)
    finish(panels[0, 1], "bravo after the revert: as if it had never been")

    last = result.maps
    show(panels[1, 0], truth["bravo"], walls(last["bravo"], fused=True), DONOR)
    show(panels[1, 0], truth["bravo"], walls(last["bravo"]), OWN)
    finish(panels[1, 0], "bravo at the end: its cloud, and what others added (blue)")

    show(panels[1, 1], truth["charlie"], walls(last["charlie"], fused=True), DONOR)
    show(panels[1, 1], truth["charlie"], walls(last["charlie"]), OWN)
    finish(panels[1, 1], "charlie at the end: its segments, and those that others added (blue)")

    assert isinstance(last["alpha"].fused, GridMap)
    show_grid(panels[2, 0], truth["alpha"], last["alpha"].fused)
    finish(panels[2, 0], "alpha at the end: its grid, with all others in it")

    axes = panels[2, 1]
    show(axes, truth["plan"], walls(last["plan"]), "#a9a3b8")
    for finding in findings(result.events, "alpha", "plan"):
        ends = truth["alpha"].apply(np.array([finding.start_m[:2], finding.end_m[:2]]))
        axes.plot(*ends.T, color=ADDED if finding.kind == "wall added" else FOUND, lw=1.6)
    finish(axes, "the plan; red: missing or displaced for alpha; orange: added, furniture too")

    figure.tight_layout()
    figure.savefig(Path(__file__).parent / "heterogeneous.png", dpi=110)


if __name__ == "__main__":
    main()
