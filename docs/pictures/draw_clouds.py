"""Draws clouds.png: two simulated cloud maps, the one in the other, and what a grid robot gets of it.

python docs/pictures/draw_clouds.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from mapgraft.contracts import Points, Transform
from mapgraft_cloud.grid_conversion import GridConversion
from mapgraft_cloud.kiss import Kiss
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.map_type import PointCloud
from mapgraft_grid.grid_map import FREE, OCCUPIED
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_recordings.buildings import building
from mapgraft_recordings.buildings.spatial import record_spatial, spatial_observations

mpl.use("Agg")

SEED, SWEEPS = 2, 60
CEILING_M = 2.2  # what lies higher hides the rest
OWN, DONOR = "#2a6fbb", "#e07b1a"


def layer_of(drive: int, T: Transform) -> CloudLayer:
    kind = PointCloud()
    layer = kind.new_layer()
    for observation in spatial_observations(record_spatial(building(SEED), drive, SWEEPS)):
        kind.integrate(layer, observation)
    return kind.place(layer, T)


def below_ceiling(points: Points) -> Points:
    return points[points[:, 2] < CEILING_M]


def draw_heights(axes: Any, points: Points, title: str) -> None:
    shown = below_ceiling(points)
    shown = shown[np.argsort(shown[:, 2], kind="stable")]
    axes.scatter(shown[:, 0], shown[:, 1], c=shown[:, 2], s=0.4, cmap="viridis", linewidths=0)
    crop(axes, shown)
    finish(axes, title)


def crop(axes: Any, points: Points) -> None:
    """Leave out what was seen far off through a window."""
    low, high = np.percentile(points[:, :2], (0.5, 99.5), axis=0)
    axes.set_xlim(low[0] - 1.0, high[0] + 1.0)
    axes.set_ylim(low[1] - 1.0, high[1] + 1.0)


def finish(axes: Any, title: str) -> None:
    axes.set_title(title, fontsize=9)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])


def main() -> None:
    import matplotlib.pyplot as plt

    kind, grid = PointCloud(), OccupancyGrid(resolution_m=0.1)
    own, donor = layer_of(0, Transform.identity()), layer_of(1, Transform.planar(9.0, -4.0, 2.2))
    ours, theirs = kind.view(own), kind.view(donor)
    match = Kiss().match(ours, theirs)[0]
    placed = kind.view(kind.place(donor, match.T_receiver_donor))
    figure, panels = plt.subplots(1, 4, figsize=(13, 3.8))
    draw_heights(panels[0], ours.points_m, f"receiver: {len(ours.points_m):,} voxels, coloured by height")
    draw_heights(panels[1], theirs.points_m, f"donor: {len(theirs.points_m):,} voxels")
    walls = [below_ceiling(m.points_m) for m in (ours, placed)]
    for points, colour in zip(walls, (OWN, DONOR), strict=True):
        raised = points[points[:, 2] > 0.3]
        panels[2].scatter(raised[:, 0], raised[:, 1], c=colour, s=0.4, alpha=0.5, linewidths=0)
    crop(panels[2], np.concatenate(walls))
    finish(panels[2], f"matched: {match.score:.0f} m² shared, {match.margin:.0f} above the next")
    dense = grid.view(GridConversion().convert(own, PointCloud(), grid)).dense()
    shades = np.full(dense.classes.shape, 0.8)
    shades[dense.classes == FREE], shades[dense.classes == OCCUPIED] = 1.0, 0.0
    panels[3].imshow(shades, cmap="gray", origin="lower", vmin=0.0, vmax=1.0)
    finish(panels[3], "the receiver's map as a grid: 0.3 to 1.8 m")
    figure.tight_layout()
    figure.savefig(Path(__file__).with_name("clouds.png"), dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
