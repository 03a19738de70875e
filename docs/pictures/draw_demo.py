"""Draws demo.png: what becomes of alpha's map when the demo recording is replayed.

python docs/pictures/draw_demo.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from scipy.ndimage import maximum_filter

import mapgraft
from mapgraft.contracts import Transform
from mapgraft.events import Snapshot
from mapgraft.outputs.memory_sink import MemorySink
from mapgraft_grid.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap

Window = tuple[tuple[int, int], tuple[int, int]]  # origin cell (ix, iy), shape (h, w)
ROBOT = "alpha"
COLOURS = {UNKNOWN: (0.90, 0.90, 0.90), FREE: (1.0, 1.0, 1.0), OCCUPIED: (0.10, 0.10, 0.12)}
FOREIGN = {FREE: (0.80, 0.90, 1.0), OCCUPIED: (0.05, 0.35, 0.80)}
DISAGREE = (0.85, 0.10, 0.10)


def donor_in(memory: MemorySink, receiver: Snapshot, donor: str, T_receiver_donor: Transform) -> GridMap:
    """The donor's own map as it was then, where the receiver believes it to be."""
    layers = [s.layer for s in memory.snapshots if s.robot == donor and s.stamp_ns <= receiver.stamp_ns]
    map_type = receiver.map_type
    view = map_type.view(map_type.place(map_type.decode(layers[-1]), T_receiver_donor))
    assert isinstance(view, GridMap)
    return view


def draw(axes: Axes, snapshot: Snapshot, window: Window, donor: GridMap | None, title: str) -> None:
    """The own map in black and white, what came in from others in blue, and red where the donor is against it."""
    assert isinstance(snapshot.own, GridMap)
    assert isinstance(snapshot.fused, GridMap)
    own, fused = snapshot.own.dense_over(*window).classes, snapshot.fused.dense_over(*window).classes
    image = np.zeros((*own.shape, 3))
    for kind, colour in COLOURS.items():
        image[fused == kind] = colour
    for kind, colour in FOREIGN.items():
        image[(fused == kind) & (own == UNKNOWN)] = colour
    if donor is not None:
        theirs = donor.dense_over(*window).classes
        against = ((theirs == OCCUPIED) & (own == FREE)) | ((theirs == FREE) & (own == OCCUPIED))
        thick = maximum_filter(against & (maximum_filter(own, 3) != OCCUPIED), 3)  # not the edge of a wall in both
        image[thick] = DISAGREE
    axes.imshow(image, origin="lower", interpolation="nearest")
    axes.set_title(title, fontsize=10, loc="left")
    axes.axis("off")


def main() -> None:
    memory = MemorySink()
    result = mapgraft.run(sinks=[memory])
    wrong = next(e for e in result.events if e.kind == "reverted" and e.receiver == ROBOT)
    right = next(e for e in result.standing.values() if e.receiver == ROBOT and e.donor == wrong.donor)
    assert wrong.T_receiver_donor is not None
    last = result.maps[ROBOT].fused
    assert isinstance(last, GridMap)
    x0, y0, x1, y1 = last.bounds_cells()
    window = ((x0, y0), (y1 - y0, x1 - x0))
    found_out = memory.snapshot(ROBOT, "before revert", wrong.merge_id)
    donor = donor_in(memory, found_out, wrong.donor, wrong.T_receiver_donor)
    panels = [
        (memory.snapshot(ROBOT, "after merge", wrong.merge_id), None, f"1  {wrong.donor} is merged, in the wrong wing"),
        (found_out, donor, "2  further mapping contradicts it (red)"),
        (memory.snapshot(ROBOT, "after revert", wrong.merge_id), None, "3  reverted: as if it had never been"),
        (memory.snapshot(ROBOT, "after merge", right.merge_id), None, f"4  {wrong.donor} is merged where it belongs"),
    ]
    figure, axes = plt.subplots(1, 4, figsize=(14, 4.9), layout="constrained")
    for ax, (snapshot, against, title) in zip(axes, panels, strict=True):
        draw(ax, snapshot, window, against, title)
    figure.suptitle(f"{ROBOT}'s map: its own in black and white, what came in from others in blue", fontsize=11)
    figure.savefig(Path(__file__).with_name("demo.png"), dpi=90, metadata={"Software": None})


if __name__ == "__main__":
    main()
