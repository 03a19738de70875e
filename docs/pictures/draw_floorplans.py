"""Draw the picture of docs/floorplans.md: a map on a plan of unknown scale, and where the two differ.

python docs/pictures/draw_floorplans.py [OUT.png]
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import matplotlib as mpl
import numpy as np

from mapgraft.contracts import Comparison
from mapgraft_floorplan.findings import findings_of
from mapgraft_floorplan.grid_conversion import PlanToGrid
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.matcher import PlanCorrelation
from mapgraft_floorplan.plan import plan_of as as_plan
from mapgraft_floorplan.standing import differences_of
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_recordings.buildings import building, drive
from mapgraft_recordings.buildings.plans import plan_of

SEED, SCANS, SCALE, TURN_RAD = 204, 160, 37.0, 0.7
COLOURS = {"wall missing": "#d62728", "wall displaced": "#ff9f1c", "wall added": "#1f77b4"}


def main(out: Path) -> None:
    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.collections import LineCollection

    house, grid = building(SEED), OccupancyGrid()
    layer = grid.new_layer()
    for observation in drive(house, SEED + 1, SCANS):
        grid.integrate(layer, observation)
    turn = SCALE * np.array([[np.cos(TURN_RAD), -np.sin(TURN_RAD)], [np.sin(TURN_RAD), np.cos(TURN_RAD)]])
    drawn = (plan_of(house, 0).reshape(-1, 2) @ turn.T).reshape(-1, 4)
    plan = as_plan(drawn, None, "the plan")
    source = PlanToGrid().convert(PlanLayer(Walls.of_metres(plan.segments_m), scale_known=False), FloorPlanType(), grid)
    robot = grid.view(layer)
    best = PlanCorrelation(scale="unknown").match(robot, grid.view(source))[0]
    placed = grid.view(grid.place(source, best.T_receiver_donor, best.scale))
    found = differences_of(cast("Comparison", SimpleNamespace(target=robot, donor=placed)), "plan_deviations")
    ends = best.T_receiver_donor.apply(best.scale * plan.segments_m.reshape(-1, 2)).reshape(-1, 2, 2)
    figure, axes = plt.subplots(1, 2, figsize=(12, 6), constrained_layout=True)
    dense = robot.dense()
    x, y = dense.origin_m
    height, width = dense.classes.shape
    extent = (x, x + width * dense.resolution_m, y, y + height * dense.resolution_m)
    gray = np.choose(dense.classes, (0.85, 1.0, 0.0))
    axes[0].add_collection(LineCollection(plan.segments_m.reshape(-1, 2, 2).tolist(), colors="#7048a8", linewidths=0.8))
    axes[0].autoscale()
    axes[0].set_title("the plan as drawn, its scale unknown")
    axes[1].imshow(gray, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent)
    axes[1].add_collection(LineCollection(ends.tolist(), colors="#7048a8", linewidths=0.7))
    labelled: set[str] = set()
    for finding in () if found is None else findings_of(found):
        label: Any = None if finding.kind in labelled else finding.kind
        labelled.add(finding.kind)
        pair = np.array([finding.start_m[:2], finding.end_m[:2]])
        axes[1].plot(*pair.T, color=COLOURS[finding.kind], linewidth=3, alpha=0.7, label=label)
    axes[1].set_title(f"where the map lies on it: one nominal metre is {best.scale:.3f} m")
    axes[1].legend(loc="upper right")
    for axis in axes:
        axis.set_aspect("equal")
        axis.set_axis_off()
    figure.savefig(out, dpi=80, metadata={"Software": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("floorplans.png"))
