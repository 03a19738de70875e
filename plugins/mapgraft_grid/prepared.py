"""What the correlation matcher makes of one grid, once: marks, points and fields at one resolution."""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import EmptyMapError, Points
from mapgraft_grid.grid_map import FREE, OCCUPIED, Classes, GridMap
from mapgraft_grid.kernels.coarsen import coarsen
from mapgraft_grid.kernels.meeting import mark

CANONICAL_M: Final = 0.1  # log Bayes factors are compared at this resolution, or at the coarser map's
SAME_RESOLUTION: Final = 0.01  # relative difference up to which nothing is resampled
RIM: Final = 1  # cells around the known rectangle, so that what touches a wall at its edge has a place

Marks = NDArray[np.uint8]  # (h, w) as ``kernels.meeting.mark`` makes them


class MarkedCells(NamedTuple):
    """Cells (n, 2) by row and column, in that order, and their marks (n,)."""

    cells: NDArray[np.int32]
    marks: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """One grid at one resolution: row 0 at the smallest y, ``origin_m`` its lower-left corner, all read-only.

    ``walls`` (n, 2) are the centres of its occupied cells in metres, in the map's frame, ``centre_m`` is their middle
    and ``radius_m`` how far from there they reach. ``kept`` holds what is made on demand, once.
    """

    unit_m: float
    origin_m: NDArray[np.float64]
    classes: Classes
    walls: Points
    centre_m: NDArray[np.float64]
    radius_m: float
    kept: dict[object, object] = field(default_factory=dict)

    @property
    def marks(self) -> Marks:
        """What lies in each cell and beside it (h, w), see ``kernels.meeting.mark``."""
        if "marks" not in self.kept:
            self.kept["marks"] = mark(self.classes)
        found: Marks = np.asarray(self.kept["marks"])
        return found

    @property
    def mark_counts(self) -> NDArray[np.int64]:
        """How many cells have each mark (5,)."""
        if "mark counts" not in self.kept:
            self.kept["mark counts"] = np.bincount(self.marks.ravel(), minlength=5).astype(np.int64)
        found: NDArray[np.int64] = np.asarray(self.kept["mark counts"])
        return found

    @property
    def marked_cells(self) -> MarkedCells:
        """Rows and columns of all cells with a mark."""
        found = self.kept.get("marked cells")
        if not isinstance(found, MarkedCells):
            rows, columns = rows_and_columns(self.marks != 0)
            found = MarkedCells(np.stack((rows, columns), axis=1).astype(np.int32), self.marks[rows, columns])
            self.kept["marked cells"] = found
        return found

    def free_clear_of_walls(self, cells: int) -> Points:
        """The centres (m, 2) of the free cells more than so many cells from any wall, along x or y; not kept."""
        import cv2

        walls = (self.classes == OCCUPIED).astype(np.uint8)
        near = cv2.dilate(walls, np.ones((2 * cells + 1, 2 * cells + 1), np.uint8))
        return _centres((self.classes == FREE) & (near == 0), self.unit_m, self.origin_m)


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
    walls = _centres(classes == OCCUPIED, size_m, origin_m)
    if not len(walls):
        raise EmptyMapError(f"the {name} map has no occupied cell, so there is nothing to match: map more of it first")
    centre = (walls.min(axis=0) + walls.max(axis=0)) / 2.0
    radius = math.sqrt(float(((walls - centre) ** 2).sum(axis=1).max()))
    return Prepared(size_m, origin_m, classes, walls, centre, radius)


def _centres(wanted: NDArray[np.bool_], unit_m: float, origin_m: NDArray[np.float64]) -> Points:
    rows, columns = rows_and_columns(wanted)
    return np.stack((columns + 0.5, rows + 0.5), axis=1) * unit_m + origin_m


def rows_and_columns(wanted: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """As ``np.nonzero`` of a plane, several times as fast."""
    rows, columns = np.divmod(np.flatnonzero(wanted), wanted.shape[1])
    return rows, columns


def thinned(points: Points, most: int) -> Points:
    """Every k-th of the points, so that no more than ``most`` are left."""
    step = max(1, -(-len(points) // most))
    return np.ascontiguousarray(points[step // 2 :: step])
