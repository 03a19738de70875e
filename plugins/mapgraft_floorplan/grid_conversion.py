"""A floor plan as an occupancy grid: walls occupied, rooms free, all else unknown."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Layer, MapError, MapType
from mapgraft_floorplan.layer import STEP_M, as_layer
from mapgraft_floorplan.plan import Segments
from mapgraft_grid.cells import READY_MADE, GridLayer, Lattice, layer_of_window
from mapgraft_grid.map_type import OccupancyGrid

MOST_CELLS: Final = 60_000_000
CELLS_ACROSS: Final = 1_000  # of a plan whose scale is not known: its cells can have any size
GAPS_M: Final = (0.1, 0.3, 0.5, 0.65, 0.8)  # half the gaps that may be open in the outer walls, tried in this order
GAP_SHARES: Final = (0.002, 0.01, 0.02, 0.03, 0.045)  # the same as shares of the extent, where the scale is not known
ENCLOSED: Final = 0.9  # share of what larger gaps would enclose, too, at which the outer walls hold
THIN_M: Final = 0.4  # a space that no disc of this radius fits into is the inside of a wall
THIN_SHARE: Final = 0.15  # of the radius of the largest disc that fits into the plan, where the scale is not known
_MARGIN: Final = 2  # cells around
_SHIFT: Final = 6  # binary places of a cell in which walls are drawn

UNKNOWN: Final = 0
ROOM: Final = 1
WALL: Final = 2

Classes = NDArray[np.uint8]  # (h, w) UNKNOWN, ROOM or WALL, row 0 at the smallest y


class Raster(NamedTuple):
    """A plan on cells: its classes, and the cell (ix, iy) of element [0, 0]."""

    classes: Classes
    first: tuple[int, int]


class PlanToGrid:
    """Draws the walls, and takes for free what lies inside rooms.

    Outside is what can be reached from beyond the plan without passing through a wall or a gap in it: gaps of up to
    1.6 m are closed as far as needed for the outer walls to hold. What remains is inside; spaces too narrow to stand
    in are the insides of walls. Both, the outside and the insides of walls, stay unknown. Where the outer walls do not
    hold whatever is closed, nothing is free.

    A wall has as many hits and a room as many misses as the target's sensor model needs to call them occupied and free:
    classes to match and compare by. How little of that enters a fused map is the fuser's affair.
    A plan of unknown scale comes in its own units, on cells of a thousandth of its extent: nobody knows how large the
    target's would be in it.
    """

    def convert(self, layer: Layer, source: MapType, target: MapType) -> GridLayer:
        """Raises MapError when the target is no occupancy grid, or its cells are too fine for so large a plan."""
        plan = as_layer(layer)
        if not isinstance(target, OccupancyGrid):
            raise MapError(f"this conversion makes occupancy grids of floor plans, found the target {target.name}")
        empty, segments = target.new_layer(), plan.told.segments_m
        lattice = empty.lattice if plan.scale_known or not len(segments) else _own_lattice(segments)
        raster = rasterise(segments, lattice, plan.scale_known)
        model, limits = empty.sensor_model, target.thresholds
        hits, misses = -(-limits.occupied // model.l_hit), -(limits.free // -model.l_miss)
        counts = np.zeros((2, *raster.classes.shape), np.min_scalar_type(max(hits, misses)))
        counts[0][raster.classes == WALL] = hits
        counts[1][raster.classes == ROOM] = misses
        return layer_of_window(
            target,
            raster.first,
            counts,
            lattice=lattice,
            observations=plan.observations,
            sensors=plan.sensors,
            mapper=READY_MADE,
        )


def rasterise(segments_m: Segments, lattice: Lattice, scale_known: bool) -> Raster:
    """Walls and rooms of pieces (n, 4) on a lattice; raises MapError when they are too many cells."""
    if not len(segments_m):
        return Raster(np.zeros((0, 0), np.uint8), (0, 0))
    first, shape = _window(segments_m, lattice)
    walls = drawn(segments_m, lattice, first, shape)
    unit_m = lattice.resolution_m
    extent_m = max(shape) * unit_m
    gaps_m = GAPS_M if scale_known else tuple(share * extent_m for share in GAP_SHARES)
    inside = enclosed(walls, [gap / unit_m for gap in gaps_m])
    rooms = _wide(inside, THIN_M / unit_m if scale_known else None)
    classes = np.where(walls, WALL, np.where(rooms, ROOM, UNKNOWN)).astype(np.uint8)
    return Raster(classes, first)


def drawn(segments_m: Segments, lattice: Lattice, first: tuple[int, int], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Which cells (h, w) from ``first`` on the walls pass through, each wall a cell wide."""
    import cv2

    cells = (segments_m.reshape(-1, 2) - lattice.anchor_m) / lattice.resolution_m - np.array(first) - 0.5
    fixed = np.round(cells * (1 << _SHIFT)).astype(np.int32).reshape(-1, 2, 1, 2)
    out = np.zeros(shape, np.uint8)
    cv2.polylines(out, list(fixed), False, 1, 1, cv2.LINE_8, _SHIFT)
    return out > 0


def enclosed(walls: NDArray[np.bool_], gaps: list[float]) -> NDArray[np.bool_]:
    """The cells that nothing reaches from the border of the window when gaps (half, cells) are closed.

    Of the gaps the least that encloses ``ENCLOSED`` of what any of them does.
    """
    found = [_inside(walls, max(gap, 0.5)) for gap in gaps]
    most = max(int(inside.sum()) for inside in found)
    return next(inside for inside in found if inside.sum() >= ENCLOSED * most)


def _inside(walls: NDArray[np.bool_], gap: float) -> NDArray[np.bool_]:
    import cv2

    border = math.ceil(gap) + 1
    around = np.pad(walls, border)
    away = cv2.distanceTransform((~around).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    reached = (away > gap).astype(np.uint8)
    cv2.floodFill(reached, None, (0, 0), 2)
    back = cv2.distanceTransform((reached != 2).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    inside: NDArray[np.bool_] = (back > gap + 0.5) & ~around
    return inside[border:-border, border:-border]


def _wide(inside: NDArray[np.bool_], least: float | None) -> NDArray[np.bool_]:
    """The connected spaces into which a disc of that radius (cells) fits; None: of a share of the largest."""
    import cv2

    count, labels = cv2.connectedComponents(inside.astype(np.uint8), connectivity=4)
    if count < 2:
        return inside
    # a frame around, so that spaces at the border are not taken for wider than they are
    radius = cv2.distanceTransform(np.pad(inside.astype(np.uint8), 1), cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
    widest = np.zeros(count, np.float64)
    np.maximum.at(widest, np.asarray(labels, np.int64).ravel(), np.asarray(radius, np.float64).ravel())
    widest[0] = 0.0
    keep = widest >= (THIN_SHARE * widest.max() if least is None else max(least, 1.5))
    keep[0] = False
    return np.asarray(keep[labels], np.bool_)


def _window(segments_m: Segments, lattice: Lattice) -> tuple[tuple[int, int], tuple[int, int]]:
    cells = (segments_m.reshape(-1, 2) - lattice.anchor_m) / lattice.resolution_m
    low = np.floor(cells.min(axis=0)).astype(np.int64) - _MARGIN
    high = np.ceil(cells.max(axis=0)).astype(np.int64) + _MARGIN
    width, height = (high - low).tolist()
    if width * height > MOST_CELLS:
        raise MapError(
            f"a plan of {width} × {height} cells of {lattice.resolution_m:g} m is too large for a grid (at most "
            f"{MOST_CELLS} cells): check its unit, or map the robot on coarser cells"
        )
    return (int(low[0]), int(low[1])), (height, width)


def _own_lattice(segments_m: Segments) -> Lattice:
    """Cells of a thousandth of the longer side of what is drawn."""
    ends = segments_m.reshape(-1, 2)
    return Lattice(max(float((ends.max(axis=0) - ends.min(axis=0)).max()) / CELLS_ACROSS, STEP_M))
