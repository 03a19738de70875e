"""Refinement of placements below a cell and a degree: robust least squares on fields of distances to walls."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points, Transform
from mapgraft_grid.grid_map import OCCUPIED, GridMap
from mapgraft_grid.kernels.refining import refine
from mapgraft_grid.prepared import Prepared, prepare, thinned

FINEST_M: Final = 0.05  # the field of a finer map is made at this resolution: walls are no sharper
MOST_POINTS: Final = 500  # of each map
SIGMAS_CELLS: Final = (3.0, 1.5)  # scales of the robust loss, in cells of the coarser field
STEPS: Final = 6  # of Gauss-Newton with each
FAR_M: Final = 1.0  # distances are cut off here


class Field(NamedTuple):
    """Distances to the nearest occupied cell (m) at the cells of a grid, and its occupied cells, thinned."""

    distances_m: NDArray[np.float32]
    unit_m: float
    origin_m: NDArray[np.float64]
    points: Points


def distance_field(map_: GridMap) -> Field:
    """The field of a map at its own resolution, or at 0.05 m when that is coarser; made once."""
    prepared = prepare(map_, max(map_.resolution_m, FINEST_M))
    if "distances" not in prepared.kept:
        prepared.kept["distances"] = _field(prepared)
    found = prepared.kept["distances"]
    assert isinstance(found, Field)
    return found


def _field(prepared: Prepared) -> Field:
    import cv2

    empty = (prepared.classes != OCCUPIED).astype(np.uint8)
    distances = cv2.distanceTransform(empty, cv2.DIST_L2, cv2.DIST_MASK_5)
    distances = np.minimum(distances * np.float32(prepared.unit_m), np.float32(FAR_M))
    return Field(distances, prepared.unit_m, prepared.origin_m, thinned(prepared.walls, MOST_POINTS))


def refined(
    target: Field, source: Field, centre_m: NDArray[np.float64], hypotheses: list[Transform]
) -> list[Transform]:
    """Each ``T_target_source`` moved to where the walls of both maps lie on each other, within a few cells.

    ``centre_m`` is the point of the source about which is turned. Minimises Geman and McClure's loss over the distances
    of the walls of either map to those of the other, at two scales.
    """
    if not hypotheses:
        return []
    poses = np.array([[*(T.apply(centre_m[None])[0] - target.origin_m), T.yaw_rad] for T in hypotheses])
    sigmas = np.array(SIGMAS_CELLS) * max(target.unit_m, source.unit_m)
    moved = refine(
        target.distances_m,
        target.unit_m,
        target.points - target.origin_m,
        source.distances_m,
        source.unit_m,
        source.points - centre_m,
        source.origin_m - centre_m,
        poses,
        sigmas,
        STEPS,
    )
    return [placed(pose + np.array([*target.origin_m, 0.0]), centre_m) for pose in moved]


def placed(pose: NDArray[np.float64], centre_m: NDArray[np.float64]) -> Transform:
    """The transform that turns by yaw and brings the centre to (x, y)."""
    x, y, yaw = (float(value) for value in pose[:3])
    c, s = math.cos(yaw), math.sin(yaw)
    u, v = (float(value) for value in centre_m)
    return Transform.planar(x - (c * u - s * v), y - (s * u + c * v), yaw)
