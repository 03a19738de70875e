"""Occupancy grids as line segments: occupied cells that lie on lines, and free space, count for count."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import EmptyMapError, Layer, MapError, MapType
from mapgraft_grid.cells import HITS, MISSES, GridLayer, window_of
from mapgraft_grid.grid_map import FREE, OCCUPIED, DenseGrid
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.kernels import tracing
from mapgraft_lines.kernels.chopping import DIRECTION, HEAVIEST, UNIT, UNIT_M
from mapgraft_lines.kernels.keys import LIMIT, STEPS_PER_M
from mapgraft_lines.layer import CONVERTED, LOOKS, PIECE_COLUMNS, Evidence, LineLayer
from mapgraft_lines.segments import cell_keys, slots_of
from mapgraft_lines.table import Table

NEAR_M: Final = 0.35  # around a cell: what tells its line's direction
LEAST_RADIUS: Final = 3  # cells
FLAT: Final = 0.12  # variance across a line over that along it, at most
SIGMA_M: Final = 0.03  # of a grid's walls beside what its cells round: scans lie a little off each other
KNOWN_SHARE: Final = 0.5  # of the fine cells of a free cell
FREE_SHARE: Final = 0.8  # of the known ones

Counts = NDArray[np.int64]  # (h, w)


class GridToLines:
    """Turns occupied cells that lie on lines into pieces of walls, and free cells into free space.

    An occupied cell lies on a line when those within 0.35 m (3 cells in coarse grids) do. It tells of the wall as many
    observations as it has hits, with the uncertainty of its size. A wall with free space on one side only was seen from
    that side. A cell of the line map is free where most of the grid's cells in it are, and none is occupied; it was
    looked through as often as these have misses, on average. What is occupied and lies on no line is left out. Occupied
    and free is what the robot that mapped the grid takes for it.
    """

    def convert(self, layer: Layer, source: MapType, target: MapType) -> LineLayer:
        """A line layer with the target's cells, of the grid as the source reads it.

        Raises MapError when one of the three is of another type, or the grid is too large.
        """
        if not isinstance(layer, GridLayer) or not isinstance(source, OccupancyGrid):
            raise MapError(
                f"occupancy grids convert to line_segments, found a layer of {layer.map_type} read as {source.name}"
            )
        lines = _new_layer(target)
        lines.observations, lines.sensors, lines.mapper = layer.observations, layer.sensors, CONVERTED
        try:
            seen = source.view(layer).dense()
        except EmptyMapError:
            return lines
        _require_reach(seen, lines.cell_m)
        hits, misses = _counts(layer, seen)
        lines.own = Evidence(_pieces(seen, hits, lines.cell_m), _space(seen, misses, lines.cell_m))
        return lines


def _new_layer(target: MapType) -> LineLayer:
    layer = target.new_layer()
    if not isinstance(layer, LineLayer):
        raise MapError(f"this converts to line_segments, found {target.name}: name another `via`")
    return layer


def _counts(layer: GridLayer, seen: DenseGrid) -> tuple[Counts, Counts]:
    """Hits and misses in the rectangle of the dense grid; evidence that has no counts is that of one look."""
    counts = window_of(layer, seen.origin_cell, seen.classes.shape)
    return np.maximum(counts[HITS], seen.classes == OCCUPIED), np.maximum(counts[MISSES], seen.classes == FREE)


def _pieces(seen: DenseGrid, hits: Counts, cell_m: float) -> Table:
    rows, columns = np.nonzero(seen.classes == OCCUPIED)
    radius = max(LEAST_RADIUS, math.ceil(NEAR_M / seen.resolution_m))
    lines, kinds = tracing.trace(seen.classes, rows, columns, radius, FLAT)
    some = kinds != tracing.NO_LINE
    rows, columns, lines, faced = rows[some], columns[some], lines[some], kinds[some] == tracing.LEFT
    looks = hits[rows, columns]
    variance = SIGMA_M**2 + seen.resolution_m**2 / 12.0
    each = UNIT * UNIT_M**2 / variance * seen.resolution_m / cell_m
    weight = np.clip(np.rint(looks * each), 1, HEAVIEST).astype(np.int64)
    x = seen.origin_m[0] + (columns + 0.5) * seen.resolution_m
    y = seen.origin_m[1] + (rows + 0.5) * seen.resolution_m
    ix, iy = np.floor(x / cell_m).astype(np.int64), np.floor(y / cell_m).astype(np.int64)
    px = np.rint((x - ix * cell_m) * STEPS_PER_M).astype(np.int64)
    py = np.rint((y - iy * cell_m) * STEPS_PER_M).astype(np.int64)
    own = np.rint(weight * (seen.resolution_m * STEPS_PER_M) ** 2 / 12.0).astype(np.int64)  # of the square itself
    angle = np.arctan2(lines[:, 1], lines[:, 0])
    turn = np.where(faced, angle, 2.0 * angle)
    counts = np.empty((len(x), PIECE_COLUMNS), np.int64)
    for column, values in enumerate((looks, weight, weight * px, weight * py)):
        counts[:, column] = values
    counts[:, 4], counts[:, 5], counts[:, 6] = weight * px * px + own, weight * px * py, weight * py * py + own
    counts[:, 7] = np.rint(weight * np.cos(turn) * DIRECTION)
    counts[:, 8] = np.rint(weight * np.sin(turn) * DIRECTION)
    keys = cell_keys(ix, iy) | slots_of(angle, faced)
    table = Table.summed(keys, counts)
    cells = Table.summed(keys, np.ones((len(keys), 1), np.int64)).counts[:, 0]
    mean = table.counts.copy()
    mean[:, LOOKS] = np.maximum((table.counts[:, LOOKS] + cells // 2) // np.maximum(cells, 1), 1)
    return Table(table.keys, mean)


def _space(seen: DenseGrid, misses: Counts, cell_m: float) -> Table:
    """The cells of the line map that are free, by the grid's cells whose centres lie in them."""
    rows, columns = np.nonzero(seen.classes)
    ix = np.floor((seen.origin_m[0] + (columns + 0.5) * seen.resolution_m) / cell_m).astype(np.int64)
    iy = np.floor((seen.origin_m[1] + (rows + 0.5) * seen.resolution_m) / cell_m).astype(np.int64)
    free = seen.classes[rows, columns] == FREE
    told = np.column_stack((np.ones(len(rows), np.int64), free, np.where(free, misses[rows, columns], 0)))
    table = Table.summed(cell_keys(ix, iy), told)
    known, empty, looks = table.counts.T
    inside = max((cell_m / seen.resolution_m) ** 2, 1.0)
    # known may be 1 for a cell that is smaller than the grid's: it is that cell
    kept = (empty == known) | ((empty >= FREE_SHARE * known) & (known > 1) & (known - empty < 2))
    kept &= (known >= KNOWN_SHARE * inside) & (empty > 0)
    counts = np.maximum((looks[kept] + empty[kept] // 2) // np.maximum(empty[kept], 1), 1)
    return Table(table.keys[kept], counts[:, None])


def _require_reach(seen: DenseGrid, cell_m: float) -> None:
    farthest = max(abs(value) for value in seen.origin_m) + max(seen.classes.shape) * seen.resolution_m
    if not farthest < (LIMIT - 4) * cell_m:
        raise MapError(f"a map of line segments reaches ±{LIMIT * cell_m:.0f} m, the grid reaches {farthest:.0f} m")
