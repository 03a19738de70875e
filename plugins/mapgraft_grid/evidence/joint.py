"""Two grids side by side where both may know something, at a resolution at which numbers can be compared."""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Comparison, Points
from mapgraft_grid.grid_map import OCCUPIED, Classes, GridMap
from mapgraft_grid.kernels import standing
from mapgraft_grid.kernels.coarsen import coarsen
from mapgraft_grid.overlap import pair_of

CANONICAL_M: Final = 0.1  # finer grids are viewed in whole multiples of their cells, about as large
TOLERANCE_M: Final = 0.25  # a wall nearer than this may be the same one: cells, scan poses and the match are all off
BLOCK_M: Final = 0.25  # walls are measured in blocks, so that thick ones are no longer
PATCH_M: Final = 2.0  # so far apart, places err by themselves
_MARGIN_M: Final = 0.5  # around the common rectangle, for the walls next to it
_FAR_M: Final = 1e3

Distances = NDArray[np.float32]  # (h, w) metres to the nearest occupied cell


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """The window in which both grids may know something; row 0 at the smallest y, all read-only.

    ``own`` and ``donor`` (h, w) classes, ``to_own_m`` and ``to_donor_m`` (h, w) how far their next walls are;
    ``origin_m`` the lower-left corner. ``kept`` holds what metrics have made of it.
    """

    own: Classes
    donor: Classes
    to_own_m: Distances
    to_donor_m: Distances
    unit_m: float
    origin_m: tuple[float, float]
    kept: dict[str, Any] = field(default_factory=dict)

    def cells(self, points: Points) -> Points:
        """Points (n, 2) in metres, in cells of the window."""
        return np.ascontiguousarray((points - self.origin_m) / self.unit_m)


@dataclass(frozen=True, slots=True)
class Standing:
    """How the walls of two grids stand to each other, where both know something; lengths in metres.

    ``table`` (2, 2) counts of (own, donor) classes, free first. ``walls_m``, ``near_m`` and ``against_m`` (own,
    donor): all walls, those near a wall of the other, those in its free space and near none. ``good`` and ``bad`` are
    the patches in which the walls of both are clearly near each other, and in which more are against.
    """

    table: NDArray[np.int64]
    walls_m: tuple[float, float]
    near_m: tuple[float, float]
    against_m: tuple[float, float]
    good: int
    bad: int


_KEPT: weakref.WeakKeyDictionary[GridMap, tuple[weakref.ref[GridMap], Joint]] = weakref.WeakKeyDictionary()


def joint_of(comparison: Comparison, metric: str) -> Joint:
    """The joint window of a comparison, made once for all metrics that look at the same two maps."""
    target, donor = pair_of(comparison, metric)
    kept = _KEPT.get(donor)
    if kept is None or kept[0]() is not target:
        kept = _KEPT[donor] = (weakref.ref(target), _made(target, donor))
    return kept[1]


def standing_of(comparison: Comparison, metric: str) -> Standing:
    """How the walls of both maps stand to each other."""
    joint = joint_of(comparison, metric)
    if "standing" not in joint.kept:
        joint.kept["standing"] = _standing(joint)
    made: Standing = joint.kept["standing"]
    return made


def _standing(joint: Joint) -> Standing:
    block, patch = (max(1, round(side_m / joint.unit_m)) for side_m in (BLOCK_M, PATCH_M))
    grids = joint.own, joint.donor, joint.to_own_m, joint.to_donor_m
    table, blocks, patches = standing.walls(*grids, TOLERANCE_M, block, patch)
    walls, near, against = (
        (float(blocks[0, what]) * block * joint.unit_m, float(blocks[1, what]) * block * joint.unit_m)
        for what in (standing.WALL, standing.NEAR, standing.AGAINST)
    )
    return Standing(table, walls, near, against, int(patches[0]), int(patches[1]))


def _made(target: GridMap, donor: GridMap) -> Joint:
    ratio = canonical_ratio(target.resolution_m)
    unit_m = ratio * target.resolution_m
    first, shape = _window(target, donor, ratio, math.ceil(_MARGIN_M / unit_m))
    own, donated = (coarse_classes(grid, ratio, first, shape) for grid in (target, donor))
    distances = [_distances(side, unit_m) for side in (own, donated)]
    origin_m = target.lattice.corner_m(first[0] * ratio, first[1] * ratio)
    return Joint(own, donated, distances[0], distances[1], unit_m, origin_m)


def canonical_ratio(resolution_m: float) -> int:
    """How many cells of a grid make one of about the canonical size, at least 1."""
    return max(1, round(CANONICAL_M / resolution_m))


def coarse_classes(grid: GridMap, ratio: int, first: tuple[int, int], shape: tuple[int, int]) -> Classes:
    """A window of a grid on cells ``ratio`` times as large: element [0, 0] is coarse cell ``first`` (ix, iy)."""
    fine = grid.dense_over((first[0] * ratio, first[1] * ratio), (shape[0] * ratio, shape[1] * ratio)).classes
    return coarsen(fine, float(ratio)) if ratio > 1 else fine


def cells_to_wall(classes: Classes) -> NDArray[np.float32] | None:
    """How many cells the next occupied cell is away (h, w); None when there is none."""
    import cv2

    if not (classes == OCCUPIED).any():
        return None
    return np.asarray(cv2.distanceTransform((classes != OCCUPIED).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5))


def _window(target: GridMap, donor: GridMap, ratio: int, margin: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """The first cell (ix, iy) and the shape (h, w) of the common rectangle with its margin, in coarse cells."""
    if target.is_empty or donor.is_empty:
        return (0, 0), (1, 1)
    a, b = target.bounds_cells(), donor.bounds_cells()
    low = [max(a[k], b[k]) // ratio - margin for k in (0, 1)]
    high = [-(-min(a[k], b[k]) // ratio) + margin for k in (2, 3)]
    return (low[0], low[1]), (max(1, high[1] - low[1]), max(1, high[0] - low[0]))


def _distances(classes: Classes, unit_m: float) -> Distances:
    cells = cells_to_wall(classes)
    return np.full(classes.shape, _FAR_M, np.float32) if cells is None else np.asarray(cells * unit_m, np.float32)
