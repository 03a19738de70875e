"""What the correlation matcher makes of one grid, once: marks, points and fields at one resolution."""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import EmptyMapError, Points
from mapgraft_grid.grid_map import OCCUPIED, Classes, GridMap
from mapgraft_grid.kernels.coarsen import coarsen
from mapgraft_grid.kernels.meeting import mark

CANONICAL_M: Final = 0.1  # log Bayes factors are compared at this resolution, or at the coarser map's
SAME_RESOLUTION: Final = 0.01  # relative difference up to which nothing is resampled
RIM: Final = 1  # cells around the known rectangle, so that what touches a wall at its edge has a place

Marks = NDArray[np.uint8]  # (h, w) as ``kernels.meeting.mark`` makes them


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """One grid at one resolution: row 0 at the smallest y, ``origin_m`` its lower-left corner, all read-only.

    ``walls`` (n, 2) and ``free`` (m, 2) are the centres of its occupied and free cells in metres, in the map's frame;
    ``centre_m`` is the middle of what is known, ``radius_m`` how far from there it reaches, ``walls_m`` the mean of the
    walls. ``kept`` holds what is made of it on demand.
    """

    unit_m: float
    origin_m: NDArray[np.float64]
    classes: Classes
    marks: Marks
    walls: Points
    free: Points
    centre_m: NDArray[np.float64]
    radius_m: float
    kept: dict[object, object] = field(default_factory=dict)

    @property
    def walls_m(self) -> NDArray[np.float64]:
        mean: NDArray[np.float64] = self.walls.mean(axis=0)
        return mean


_PREPARED: weakref.WeakKeyDictionary[GridMap, dict[float, Prepared]] = weakref.WeakKeyDictionary()


def canonical_m(*resolutions_m: float) -> float:
    """The resolution at which grids are compared: 0.1 m, or the coarsest of them when that is coarser."""
    return max(CANONICAL_M, *resolutions_m)


def prepare(map_: GridMap, unit_m: float, name: str = "given") -> Prepared:
    """The grid at ``unit_m`` or, where that is no coarser by more than a percent, at its own resolution.

    Made once and kept while the map lives. Raises EmptyMapError when it has no occupied cell; ``name`` is for that.
    """
    kept = _PREPARED.setdefault(map_, {})
    if unit_m not in kept:
        kept[unit_m] = _prepared(map_, unit_m, name)
    return kept[unit_m]


def _prepared(map_: GridMap, unit_m: float, name: str) -> Prepared:
    grid = map_.dense()
    ratio = unit_m / grid.resolution_m
    resample = ratio > 1.0 + SAME_RESOLUTION
    classes = coarsen(grid.classes, ratio) if resample else grid.classes
    size_m = unit_m if resample else grid.resolution_m
    classes = np.pad(classes, RIM)
    origin_m = np.asarray(grid.origin_m, dtype=np.float64) - RIM * size_m
    walls, free = (_centres(classes, wanted, size_m, origin_m) for wanted in (OCCUPIED, 1))
    if not len(walls):
        raise EmptyMapError(f"the {name} map has no occupied cell, so there is nothing to match: map more of it first")
    known = np.concatenate((walls, free))
    centre = (known.min(axis=0) + known.max(axis=0)) / 2.0
    radius = math.sqrt(float(((known - centre) ** 2).sum(axis=1).max()))
    marks = mark(classes)[1:-1, 1:-1]
    return Prepared(size_m, origin_m, classes, np.ascontiguousarray(marks), walls, free, centre, radius)


def _centres(classes: Classes, wanted: int, unit_m: float, origin_m: NDArray[np.float64]) -> Points:
    rows, columns = np.nonzero(classes == wanted)
    return np.stack((columns + 0.5, rows + 0.5), axis=1) * unit_m + origin_m
