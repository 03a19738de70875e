"""What of a robot's map lies beyond everything that a plan draws."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points, Transform
from mapgraft_floorplan.kernels.beyond import count_beyond
from mapgraft_grid.prepared import Prepared

BEYOND_M: Final = 0.3  # farther out than the outermost wall: that one has a thickness, and lies off by some cells


class Outline(NamedTuple):
    """The lines n · p = limit around something: normals (k, 2) that point outwards, and limits (k,)."""

    normals: NDArray[np.float64]
    limits: NDArray[np.float64]


def beyond(robot: Prepared, plan: Prepared, T: Transform) -> NDArray[np.int64]:
    """How many of the robot's cells of each mark (5,) lie outside the convex hull of a placed plan's walls.

    The hull and not the rooms, because an outer wall that was not drawn opens a room and leaves the hull as it is.
    """
    kept = plan.kept.get("outline")
    if not isinstance(kept, Outline):
        kept = plan.kept["outline"] = outline(plan.walls)
    turned = kept.normals @ T.matrix[:2, :2].T
    limits = kept.limits + turned @ (T.matrix[:2, 3] - robot.origin_m) + BEYOND_M
    cells, marks = robot.marked_cells
    counted: NDArray[np.int64] = count_beyond(cells, marks, np.ascontiguousarray(turned), limits / robot.unit_m)
    return counted


def outline(points: Points) -> Outline:
    """That of the convex hull of points (n, 2)."""
    import cv2

    middle = points.mean(axis=0)
    corners = cv2.convexHull((points - middle).astype(np.float32)).reshape(-1, 2).astype(np.float64)
    along = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(*along.T)
    some = lengths > 0.0
    normals = np.stack((along[some, 1], -along[some, 0]), axis=1) / lengths[some, None]
    limits = (normals * corners[some]).sum(axis=1)
    outwards = np.where((normals @ corners.T).mean(axis=1) > limits, -1.0, 1.0)  # whichever way round the corners come
    normals, limits = normals * outwards[:, None], limits * outwards
    return Outline(normals, limits + normals @ middle)
