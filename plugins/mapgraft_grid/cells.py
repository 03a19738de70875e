"""Occupancy-grid layers out of counts of cells, and the counts of cells out of layers: what conversions are made with.

A conversion to ``occupancy_grid`` ends in ``layer_of_cells`` or ``layer_of_window``; one from it reads the counts with
``cells_of`` or ``window_of``, and what they mean to that robot with ``source.view(layer)``. ``Lattice``,
``SensorModel`` and ``GridLayer`` are handed out here, so that a plugin needs nothing else of this package but its map
type.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Layer, MapError, MapType, Points
from mapgraft_grid.kernels.tile_keys import KEY_BIAS, KEY_BITS, TILE
from mapgraft_grid.layer import FROM_SCANS, READY_MADE, GridLayer
from mapgraft_grid.parameters import CELL_LIMIT, Lattice, SensorModel
from mapgraft_grid.tiles import TileKeys

__all__ = [
    "FROM_SCANS",
    "HITS",
    "MISSES",
    "MOST_LOOKS",
    "READY_MADE",
    "CellCounts",
    "Cells",
    "GridLayer",
    "Lattice",
    "SensorModel",
    "Window",
    "added",
    "cells_at",
    "cells_inside",
    "cells_of",
    "centres_m",
    "lattice_of",
    "layer_of_cells",
    "layer_of_window",
    "most",
    "window_of",
]

Cells = NDArray[np.int64]  # (n, 2) ix, iy on a lattice
CellCounts = NDArray[np.int64]  # (n, 2) hits, misses
Window = NDArray[np.integer]  # (2, h, w) hits and misses, row 0 at the smallest y

HITS: Final = 0
MISSES: Final = 1
MOST_LOOKS: Final = 1 << 30  # of one cell: what counts beyond is counted as this
_AT_ONCE: Final = 512  # tiles per call: 16 MB of counts


def layer_of_cells(
    target: MapType,
    cells: Cells,
    counts: CellCounts,
    *,
    lattice: Lattice | None = None,
    sensor_model: SensorModel | None = None,
    observations: int = 1,
    sensors: frozenset[str] = frozenset(),
    mapper: str = FROM_SCANS,
) -> GridLayer:
    """A layer of ``target`` (an ``OccupancyGrid`` instance) in which the cells have these counts, and others none.

    ``cells`` (n, 2) are ix, iy on ``lattice`` (the target's own where none is given), each told once: see ``added`` and
    ``most``. ``counts`` (n, 2) are hits and misses. ``sensor_model`` says what one of each is worth, else the target's.
    ``mapper`` is ``FROM_SCANS`` or ``READY_MADE``. Raises MapError when the target is another type, a cell is told
    twice or lies beyond ±2³⁰, or a count is negative.
    """
    layer = _empty(target, lattice, sensor_model, observations, sensors, mapper)
    cells, counts = _checked(cells, counts)
    some = counts.any(axis=1)
    cells, counts = cells[some], np.minimum(counts[some], MOST_LOOKS).astype(np.uint32)
    tiles = _tile_keys(cells[:, 0] // TILE, cells[:, 1] // TILE)
    order = np.argsort(tiles, kind="stable")
    keys, starts = np.unique(tiles[order], return_index=True)
    ends = np.append(starts[1:], len(order))
    for first in range(0, len(keys), _AT_ONCE):
        part = slice(first, min(first + _AT_ONCE, len(keys)))
        rows = order[starts[part][0] : ends[part][-1]]
        slots = np.repeat(np.arange(part.stop - part.start), (ends - starts)[part])
        x, y = cells[rows, 0] % TILE, cells[rows, 1] % TILE
        table = np.zeros((2, part.stop - part.start, TILE, TILE), np.uint32)
        table[HITS, slots, y, x], table[MISSES, slots, y, x] = counts[rows, HITS], counts[rows, MISSES]
        if np.count_nonzero(table.any(axis=0)) < len(rows):
            raise MapError("a cell is told of more than once: add the counts up, or take the most of them")
        layer.pool.set_counts(keys[part], table[HITS], table[MISSES])
    return layer


def layer_of_window(
    target: MapType,
    first_cell: tuple[int, int],
    window: Window,
    *,
    lattice: Lattice | None = None,
    sensor_model: SensorModel | None = None,
    observations: int = 1,
    sensors: frozenset[str] = frozenset(),
    mapper: str = FROM_SCANS,
) -> GridLayer:
    """As ``layer_of_cells``, for a rectangle (2, h, w) of hits and misses whose element [:, 0, 0] is ``first_cell``."""
    layer = _empty(target, lattice, sensor_model, observations, sensors, mapper)
    (ix, iy), (_, height, width) = first_cell, window.shape
    _require_reach(np.array([[ix, iy], [ix + width - 1, iy + height - 1]], np.int64))
    if window.size and window.min() < 0:
        raise MapError(f"a cell cannot have been seen {int(window.min())} times: give counts from 0")
    tile_x = np.arange(ix // TILE, -(-(ix + width) // TILE))
    beside = (ix % TILE, -(ix + width) % TILE)
    for row in range(iy // TILE, -(-(iy + height) // TILE)):
        low, high = max(row * TILE - iy, 0), min((row + 1) * TILE - iy, height)
        around = ((0, 0), (low + iy - row * TILE, (row + 1) * TILE - iy - high), beside)
        strip = np.pad(np.minimum(window[:, low:high].astype(np.int64), MOST_LOOKS).astype(np.uint32), around)
        tiles = strip.reshape(2, TILE, len(tile_x), TILE).swapaxes(1, 2)
        some = tiles.any(axis=(0, 2, 3))
        keys = _tile_keys(tile_x[some], np.int64(row))
        layer.pool.set_counts(keys, tiles[HITS, some], tiles[MISSES, some])
    return layer


def cells_of(layer: Layer) -> tuple[Cells, CellCounts]:
    """The cells (n, 2) of a grid layer with hits or misses, and these (n, 2); tile by tile, in each row by row.

    What was baked in from other sources has no counts: only the view tells of it. Raises MapError on a layer of another
    type.
    """
    pool = _grid(layer).pool
    cells, counts = [np.empty((0, 2), np.int64)], [np.empty((0, 2), np.int64)]
    keys = np.sort(pool.index.keys)
    for first in range(0, len(keys), _AT_ONCE):
        part = keys[first : first + _AT_ONCE]
        told = np.stack(pool.counts(part), axis=-1)
        tile, row, column = np.nonzero(told.any(axis=-1))
        corners = _corners(part)[tile]
        cells.append(corners + np.stack((column, row), axis=1))
        counts.append(told[tile, row, column].astype(np.int64))
    return np.concatenate(cells), np.concatenate(counts)


def window_of(layer: Layer, first_cell: tuple[int, int], shape: tuple[int, int]) -> NDArray[np.int64]:
    """Hits and misses (2, h, w) of the rectangle of ``shape`` (h, w) whose element [:, 0, 0] is ``first_cell``.

    Raises MapError on a layer of another type.
    """
    pool = _grid(layer).pool
    out = np.zeros((2, *shape), np.int64)
    keys = np.sort(pool.index.keys)
    corners = _corners(keys) - np.array(first_cell, np.int64)
    inside = ((corners > -TILE) & (corners < (shape[1], shape[0]))).all(axis=1)
    for key, (x, y) in zip(keys[inside], corners[inside].tolist(), strict=True):
        rows, columns = slice(max(y, 0), min(y + TILE, shape[0])), slice(max(x, 0), min(x + TILE, shape[1]))
        part = (0, slice(rows.start - y, rows.stop - y), slice(columns.start - x, columns.stop - x))
        hits, misses = pool.counts(np.array([key]))
        out[HITS, rows, columns], out[MISSES, rows, columns] = hits[part], misses[part]
    return out


def lattice_of(target: MapType) -> Lattice:
    """The lattice of a target's new layers; raises MapError when it is no ``OccupancyGrid`` instance."""
    return _new(target).lattice


def cells_at(points_m: NDArray[np.floating], lattice: Lattice) -> Cells:
    """The cells (n, 2) in which points (n, 2) lie; raises MapError beyond ±2³⁰ cells and where one is not finite."""
    index = np.floor((points_m - np.array(lattice.anchor_m)) / lattice.resolution_m)
    if not np.isfinite(index).all():
        raise MapError("a point that is not finite lies in no cell of a grid: leave it out")
    _require_reach(index)
    cells: Cells = index.astype(np.int64)
    return cells


def centres_m(cells: Cells, lattice: Lattice) -> Points:
    """The centres (n, 2) of cells."""
    centres: Points = np.array(lattice.anchor_m) + (cells + 0.5) * lattice.resolution_m
    return centres


def cells_inside(corners_m: NDArray[np.floating], side_m: float, lattice: Lattice) -> tuple[Cells, NDArray[np.intp]]:
    """The cells (k, 2) whose centres lie in squares of ``side_m`` with lower left corners (n, 2), and in which (k,).

    For evidence that tells of squares of another size: squares that do not overlap share no cell, and cells larger than
    the squares are told of by the one at their centre.
    """
    low = (corners_m - np.array(lattice.anchor_m)) / lattice.resolution_m
    across = side_m / lattice.resolution_m
    steps = np.arange(math.ceil(across) + 1)
    first, end = _first_from(low), _first_from(low + across)
    _require_reach(first)
    spread = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    cells = first.astype(np.int64)[:, None] + spread
    inside = (cells < end[:, None]).all(axis=2)
    return cells[inside], np.nonzero(inside)[0]


def _first_from(edge: NDArray[np.floating]) -> NDArray[np.floating]:
    """The first cells whose centres, at whole numbers and a half, do not lie before an edge, in cells.

    Squares side by side say the same of the edge between them, though each gets there by sums of its own.
    """
    first: NDArray[np.floating] = np.ceil(np.round(edge - 0.5, 9))
    return first


def added(cells: Cells, counts: CellCounts) -> tuple[Cells, CellCounts]:
    """Each cell once, by rows, with the counts (n, k) of all that told of it added up."""
    unique, inverse = _each_once(cells)
    out = np.zeros((len(unique), counts.shape[1]), np.int64)
    np.add.at(out, inverse, counts)
    return unique, out


def most(cells: Cells, counts: CellCounts) -> tuple[Cells, CellCounts]:
    """Each cell once, by rows, with the largest of each of the counts (n, k) that told of it.

    For what one observation told in several places of one cell: it was one look all the same.
    """
    unique, inverse = _each_once(cells)
    out = np.zeros((len(unique), counts.shape[1]), np.int64)
    np.maximum.at(out, inverse, counts)
    return unique, out


def _each_once(cells: Cells) -> tuple[Cells, NDArray[np.intp]]:
    _require_reach(cells)
    packed, inverse = np.unique(((cells[:, 1] + CELL_LIMIT) << 32) | (cells[:, 0] + CELL_LIMIT), return_inverse=True)
    return np.stack(((packed & 0xFFFFFFFF) - CELL_LIMIT, (packed >> 32) - CELL_LIMIT), axis=1), inverse.ravel()


def _checked(cells: Cells, counts: CellCounts) -> tuple[Cells, CellCounts]:
    if cells.ndim != 2 or cells.shape[1:] != (2,) or counts.shape != cells.shape:
        raise MapError(
            f"a grid is made of cells (n, 2) and their counts (n, 2), found {cells.shape} and {counts.shape}: "
            "give ix, iy and hits, misses of each"
        )
    if len(counts) and counts.min() < 0:
        raise MapError(f"a cell cannot have been seen {int(counts.min())} times: give counts from 0")
    _require_reach(cells)
    return cells, counts


def _empty(
    target: MapType,
    lattice: Lattice | None,
    sensor_model: SensorModel | None,
    observations: int,
    sensors: frozenset[str],
    mapper: str,
) -> GridLayer:
    layer = _new(target)
    layer.lattice, layer.sensor_model = lattice or layer.lattice, sensor_model or layer.sensor_model
    layer.observations, layer.sensors, layer.mapper = observations, sensors, mapper
    return layer


def _new(target: MapType) -> GridLayer:
    layer = target.new_layer()
    if not isinstance(layer, GridLayer):
        raise MapError(f"counts of cells make an occupancy_grid, found the target {target.name}: name another `via`")
    return layer


def _grid(layer: Layer) -> GridLayer:
    if not isinstance(layer, GridLayer):
        raise MapError(
            f"cells are counted in layers of occupancy_grid, found one of {layer.map_type}: convert it first"
        )
    return layer


def _tile_keys(tile_x: NDArray[np.int64], tile_y: NDArray[np.int64] | np.int64) -> TileKeys:
    keys: TileKeys = ((tile_y + KEY_BIAS) << KEY_BITS) | (tile_x + KEY_BIAS)
    return keys


def _corners(keys: TileKeys) -> Cells:
    """The lowest cells (k, 2) of tiles."""
    corners: Cells = TILE * np.stack(((keys & ((1 << KEY_BITS) - 1)) - KEY_BIAS, (keys >> KEY_BITS) - KEY_BIAS), axis=1)
    return corners


def _require_reach(cells: NDArray[np.integer] | NDArray[np.floating]) -> None:
    if cells.size and not np.abs(cells).max() < CELL_LIMIT:
        raise MapError(f"a grid reaches ±{CELL_LIMIT} cells, found one beyond: check the unit, or take a coarser grid")
