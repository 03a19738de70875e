"""A plan as a grid at some scale: what is compared with a robot's map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import EmptyMapError, Points
from mapgraft_floorplan.directions import SOFT_CELLS, Histogram, histogram
from mapgraft_grid.grid_map import FREE, OCCUPIED, Classes, GridMap
from mapgraft_grid.kernels.coarsen import coarsen
from mapgraft_grid.prepared import RIM, Prepared, rows_and_columns

_MARGIN_CELLS: Final = 40  # around the plan's field, so that what lies beside it knows how far it is
_MOST_CELLS: Final = 1_000  # across the field
_SOFT_ACROSS: Final = 400.0  # directions are those of a drawing seen with so many cells across, whatever its own are
_SAME: Final = 1.01  # relative difference up to which cells are not made coarser


@dataclass(frozen=True, slots=True, eq=False)
class PlanGrid:
    """A plan's grid in its own units: classes from ``origin`` (x, y) on, its walls (n, 2), their middle and reach.

    ``rooms`` (m, 2) are its free cells and ``clear`` (m,) how far each lies from the nearest wall.
    ``field`` are distances to walls in those units at the centres of cells of ``field_unit`` from ``corner``, which is
    counted from the middle. ``directions`` tells along which directions the walls run.
    """

    classes: Classes
    unit: float
    origin: NDArray[np.float64]
    walls: Points
    rooms: Points
    clear: NDArray[np.float64]
    centre: NDArray[np.float64]
    radius: float
    field: NDArray[np.float32]
    field_unit: float
    corner: NDArray[np.float64]
    directions: Histogram

    @classmethod
    def of(cls, map_: GridMap) -> PlanGrid:
        """Raises EmptyMapError when nothing is occupied."""
        dense = map_.dense()
        unit, origin = dense.resolution_m, np.asarray(dense.origin_m, np.float64)
        walls = _centres(dense.classes == OCCUPIED, unit, origin)
        if not len(walls):
            raise EmptyMapError("the source map has no occupied cell, so there is nothing to match: it needs walls")
        centre = (walls.min(axis=0) + walls.max(axis=0)) / 2.0
        radius = math.sqrt(float(((walls - centre) ** 2).sum(axis=1).max()))
        field, field_unit, corner = _field(dense.classes, unit, origin)
        rooms = _centres(dense.classes == FREE, unit, origin)
        clear = unit * _away(dense.classes == OCCUPIED)[dense.classes == FREE].astype(np.float64)
        directions = histogram(dense.classes, max(SOFT_CELLS, max(dense.classes.shape) / _SOFT_ACROSS))
        shown = walls, rooms, clear, centre, radius
        return cls(dense.classes, unit, origin, *shown, field, field_unit, corner - centre, directions)

    def at(self, scale: float, unit_m: float) -> Prepared:
        """The plan stretched by ``scale``, on cells of ``unit_m`` or, where its own are then larger, on those."""
        side = self.unit * scale
        ratio = unit_m / side
        coarser = ratio > _SAME
        classes = coarsen(self.classes, ratio) if coarser else self.classes
        size = unit_m if coarser else side
        classes = np.pad(classes, RIM)
        origin = self.origin * scale - RIM * size
        walls = _centres(classes == OCCUPIED, size, origin)
        return Prepared(size, origin, classes, walls, self.centre * scale, self.radius * scale)


def _field(
    classes: Classes, unit: float, origin: NDArray[np.float64]
) -> tuple[NDArray[np.float32], float, NDArray[np.float64]]:
    ratio = max(1.0, max(classes.shape) / _MOST_CELLS)
    walls = (coarsen(classes, ratio) if ratio > 1.0 else classes) == OCCUPIED
    side = unit * ratio
    distances = _away(np.pad(walls, _MARGIN_CELLS)) * np.float32(side)
    return np.asarray(distances, np.float32), side, origin - _MARGIN_CELLS * side


def _away(walls: NDArray[np.bool_]) -> NDArray[np.float32]:
    """How far each cell lies from the nearest wall, in cells."""
    import cv2

    return np.asarray(cv2.distanceTransform((~walls).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5), np.float32)


def _centres(wanted: NDArray[np.bool_], unit: float, origin: NDArray[np.float64]) -> Points:
    rows, columns = rows_and_columns(wanted)
    centres: Points = np.stack((columns + 0.5, rows + 0.5), axis=1) * unit + origin
    return centres
