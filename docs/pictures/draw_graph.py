"""Draws graph.png: a layer that comes in through a third robot, and nine robots whose merges contradict each other.

python docs/pictures/draw_graph.py

The nine robots are those of ``tests/bench/bench_nine.py``: needs the Intel log beside the checkout.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "bench"))
from bench_nine import How, Met, meet

from mapgraft.contracts import Points
from mapgraft_grid.grid_map import OCCUPIED

mpl.use("Agg")

OWN, RIGHT, WRONG, THROUGH = "#20242a", "#2a9a55", "#d2342c", "#2a6fbb"
COLOURS = ("#2a6fbb", "#e6952b", "#2a9a55", "#9a4fb8", "#8a6a4a", "#d2342c", "#3aa6a6", "#b8a030", "#707780")


def arrow(axes: Any, start: Points, end: Points, colour: str, style: str = "-", bend: float = 0.12) -> None:
    how = {"arrowstyle": "-|>", "color": colour, "lw": 1.3, "linestyle": style, "shrinkA": 9, "shrinkB": 9}
    axes.annotate("", end, start, arrowprops={**how, "connectionstyle": f"arc3,rad={bend}"})


def draw_chain(axes: Any) -> None:
    """Three robots, the first of whom has never met the third."""
    places = {"alpha": (0.0, 0.0), "bravo": (1.0, 0.55), "charlie": (2.0, 0.0)}
    for name, (x, y) in places.items():
        axes.text(x, y, name, ha="center", va="center", fontsize=9, bbox={"boxstyle": "round,pad=.4", "fc": "white"})
    ends = {name: np.array(place) for name, place in places.items()}
    arrow(axes, ends["bravo"], ends["alpha"], RIGHT)
    arrow(axes, ends["charlie"], ends["bravo"], RIGHT)
    arrow(axes, ends["charlie"], ends["alpha"], THROUGH, "--", -0.25)
    axes.text(0.35, 0.42, "alpha.bravo.1", fontsize=7, color=RIGHT, ha="right")
    axes.text(1.65, 0.42, "bravo.charlie.1", fontsize=7, color=RIGHT)
    axes.text(1.0, -0.42, "alpha.charlie.via.1", fontsize=7, color=THROUGH, ha="center")
    axes.set_xlim(-0.4, 2.4)
    axes.set_ylim(-0.75, 0.9)
    axes.axis("off")
    axes.set_title("A layer comes in through a third robot", fontsize=9, loc="left")


def walls(met: Met, name: str) -> Points:
    """A robot's own walls, where they truly are."""
    dense = met.robots[name].reversal.own().dense()
    rows, columns = np.nonzero(dense.classes == OCCUPIED)
    cells = np.stack((columns + 0.5, rows + 0.5), axis=1) * dense.resolution_m + np.array(dense.origin_m)
    return met.truth[name].apply(cells)


def draw_nine(maps: Any, graph: Any, met: Met) -> None:
    """The maps where they are, and who merged whom."""
    events = met.assembly.history.events
    merged = [event for event in events if event.kind == "merged"]
    gone = {event.merge_id for event in events if event.kind == "reverted"}
    names = sorted(met.robots)
    for name, colour in zip(names, COLOURS, strict=True):
        points = walls(met, name)
        maps.scatter(points[:, 0], points[:, 1], s=0.15, c=colour, linewidths=0)
    maps.set_aspect("equal")
    maps.axis("off")
    maps.set_title(f"Nine robots on the Intel log, {len(merged)} merges", fontsize=9, loc="left")
    angles = np.linspace(0.0, 2.0 * np.pi, len(names), endpoint=False)
    ends = {name: np.array([np.sin(a), np.cos(a)]) for name, a in zip(names, angles, strict=True)}
    for event in sorted(merged, key=lambda one: one.merge_id in gone):
        arrow(graph, ends[event.donor], ends[event.receiver], WRONG if event.merge_id in gone else RIGHT)
    for name, colour in zip(names, COLOURS, strict=True):
        box = {"boxstyle": "circle,pad=.3", "fc": "white", "ec": colour, "lw": 1.5}
        graph.text(*ends[name], name, ha="center", va="center", fontsize=8, bbox=box)
    graph.set_xlim(-1.25, 1.25)
    graph.set_ylim(-1.2, 1.2)
    graph.set_aspect("equal")
    graph.axis("off")
    graph.set_title(f"{len(gone)} of them, all lies and no other, fell to their loops", fontsize=9, loc="left")


def main() -> None:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(12.5, 4.2), width_ratios=(0.9, 1.1, 1.0), constrained_layout=True)
    draw_chain(axes[0])
    draw_nine(axes[1], axes[2], meet(How(9, 3, 1.0), refuse=False))
    figure.savefig(Path(__file__).with_name("graph.png"), dpi=120)


if __name__ == "__main__":
    main()
