"""A point cloud seen from above, for people: where walls are, and where a sensor looked through."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import OutputMessage
from mapgraft_cloud.cloud_map import CloudMap
from mapgraft_cloud.region import voxels_of

FREE: Final = 0
WALL: Final = 100
UNKNOWN: Final = -1
MOST_CELLS: Final = 16_000_000  # of one message: larger maps are shown in larger cells

Columns = NDArray[np.int64]  # (n, 2) ix, iy


def seen_from_above(map_: CloudMap) -> OutputMessage:
    """The map as ``nav_msgs/msg/OccupancyGrid``; it must have an occupied voxel.

    A cell is a wall where an upright surface stands in its column, however high, and else free where any voxel of the
    column is. What only lies level, floors, ceilings and tops of tables, is no wall. Cells are as large as the voxels,
    or a whole number of times as large.
    """
    walls, free = _walls(map_), _free(map_)
    everything = np.vstack((free, _all(map_)))
    low, high = everything.min(axis=0), everything.max(axis=0)
    times = 1
    while np.prod((high - low) // times + 2) > MOST_CELLS:
        times *= 2
    low = low // times
    width, height = (high // times - low + 1).tolist()
    cells = np.full((height, width), UNKNOWN, np.int8)
    for columns, what in ((free, FREE), (walls, WALL)):
        at = columns // times - low
        cells[at[:, 1], at[:, 0]] = what
    cell_m = times * map_.voxel_m
    x_m, y_m = (low * cell_m).tolist()
    origin = {"position": {"x": x_m, "y": y_m, "z": 0.0}, "orientation": {"w": 1.0}}
    info = {"resolution": cell_m, "width": width, "height": height, "origin": origin}
    return OutputMessage("cloud_above", "nav_msgs/msg/OccupancyGrid", {"info": info, "data": cells.ravel()})


def _all(map_: CloudMap) -> Columns:
    blocks, places = map_.occupied
    return voxels_of(map_.keys[blocks], places)[:, :2]


def _walls(map_: CloudMap) -> Columns:
    """The columns (n, 2) of occupied voxels that lie on an upright surface, some of them more than once."""
    surface = map_.surface
    if not surface.upright.any():
        return np.empty((0, 2), np.int64)
    _, nearest = surface.tree.query(map_.points_m)
    columns: Columns = _all(map_)[surface.upright[nearest]]
    return columns


def _free(map_: CloudMap) -> Columns:
    """The columns (n, 2) with a free voxel, some of them more than once."""
    block, place = np.nonzero(map_.log_odds <= map_.thresholds.free)
    return voxels_of(map_.keys[block], place)[:, :2]
