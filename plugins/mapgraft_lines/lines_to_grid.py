"""Line segments as an occupancy grid: walls drawn into cells, free space filled in, count for count."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Layer, MapError, MapType
from mapgraft_grid.kernels.tile_keys import TILE, tile_key
from mapgraft_grid.layer import FROM_SCANS, READY_MADE, GridLayer
from mapgraft_grid.parameters import CELL_LIMIT, Lattice
from mapgraft_lines.kernels.growing import half_length
from mapgraft_lines.layer import FROM_SCANS as LINES_FROM_SCANS
from mapgraft_lines.layer import LOOKS, Evidence, as_layer
from mapgraft_lines.line_map import Reading
from mapgraft_lines.table import Keys, Table
from mapgraft_lines.walls import cell_corners_m, piece_rows, standing

BEFORE_WALLS: Final = 1.5  # cells of the line map: as far before a wall, on the seen side, beams came through
MOST_CELLS: Final = 100_000_000  # samples of walls and cells of free space that are drawn
MOST_LOOKS: Final = 1 << 30

Index = NDArray[np.int64]  # (n, 2) ix, iy of grid cells


class LinesToGrid:
    """Draws pieces of walls as hits and free space as misses.

    A grid cell through which a piece of wall runs has as many hits as the piece was seen, and no misses where the piece
    stands. A grid cell whose centre lies in a free cell of the line map has as many misses as that was looked through.
    Between the two, on the side from which a wall was seen and up to 1.5 cells of the line map before it, a grid cell
    has as many misses as the wall was seen: its beams came through there. Without free space (a plan, a file of
    segments) there are hits only. Rays and paths are not kept with lines, so the grid has none.
    """

    def convert(self, layer: Layer, source: MapType, target: MapType) -> GridLayer:
        """A grid layer with the target's parameters; MapError when one of the two is of another type."""
        own, grid = as_layer(layer), _new_grid(target)
        evidence = own.own.plus(own.absorbed)
        _require_size(evidence, own.cell_m, grid.lattice)
        drawn, before, still = _walls(evidence, own.cell_m, grid.lattice)
        free = _space(evidence.space, own.cell_m, grid.lattice)
        hits, misses = _tabled(*drawn), _tabled(*free).without(_tabled(*still).keys)
        beside = _tabled(*before)
        beside = beside.without(np.union1d(hits.keys, misses.keys))
        _write(grid, hits, misses.plus(beside))
        grid.observations, grid.sensors = own.observations, own.sensors
        grid.mapper = FROM_SCANS if own.mapper in (LINES_FROM_SCANS, "") else READY_MADE
        return grid


def _new_grid(target: MapType) -> GridLayer:
    layer = target.new_layer()
    if not isinstance(layer, GridLayer):
        raise MapError(f"line segments convert to occupancy_grid, found {target.name}: name another `via`")
    return layer


_Drawn = tuple[Index, NDArray[np.int64]]  # cells and counts


def _walls(evidence: Evidence, cell_m: float, lattice: Lattice) -> tuple[_Drawn, _Drawn, _Drawn]:
    """The cells of all pieces, those before their seen sides, and those of pieces that stand."""
    rows, looks = piece_rows(evidence.pieces, cell_m), evidence.pieces.counts[:, LOOKS]
    reading = Reading()
    stands = np.isin(
        evidence.pieces.keys,
        standing(evidence.pieces, evidence.space, reading.looks_min, reading.share_min).keys,
        assume_unique=True,
    )
    half = np.array([half_length(row, row[2], row[3]) for row in rows])
    counts = np.maximum(np.ceil(4.0 * half / lattice.resolution_m).astype(np.int64), 1)
    piece = np.repeat(np.arange(len(rows)), counts)
    nth = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    along = (2.0 * (nth + 0.5) / counts[piece] - 1.0) * half[piece]
    points = rows[piece, :2] + along[:, None] * rows[piece, 2:4]
    index = _index(points, lattice)
    seen = stands[piece]
    sided = seen & (rows[piece, 8] > 0.0)
    steps = np.arange(0.75, BEFORE_WALLS * cell_m / lattice.resolution_m, 0.5) * lattice.resolution_m
    normals = np.column_stack((-rows[piece, 3], rows[piece, 2]))[sided]
    ahead = (points[sided][:, None] + steps[:, None] * normals[:, None]).reshape(-1, 2)
    return (
        (index, looks[piece]),
        (_index(ahead, lattice), np.repeat(looks[piece][sided], len(steps))),
        (index[seen], looks[piece][seen]),
    )


def _space(space: Table, cell_m: float, lattice: Lattice) -> _Drawn:
    index, row = _cells_inside(space.keys, cell_m, lattice, 0.0)
    return index, space.counts[row, 0]


def _cells_inside(keys: Keys, cell_m: float, lattice: Lattice, reach: float) -> tuple[Index, NDArray[np.intp]]:
    """Grid cells whose centres lie in the line map's cells, or up to ``reach`` of these beside, and in which (row)."""
    reach_cells = reach * cell_m / lattice.resolution_m
    corner = (cell_corners_m(keys, cell_m) - lattice.anchor_m) / lattice.resolution_m  # in grid cells
    across = cell_m / lattice.resolution_m
    steps = np.arange(math.ceil(across + 2 * reach_cells) + 1)
    first = np.ceil(corner - 0.5 - reach_cells).astype(np.int64)  # centres lie at whole numbers and a half
    spread = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    index = first[:, None] + spread
    inside = (index + 0.5 < corner[:, None] + across + reach_cells).all(axis=2)
    return index[inside], np.nonzero(inside)[0]


def _index(points: NDArray[np.float64], lattice: Lattice) -> Index:
    index: Index = np.floor((points - lattice.anchor_m) / lattice.resolution_m).astype(np.int64)
    return index


def _tabled(index: Index, counts: NDArray[np.int64]) -> Table:
    """The largest count of each cell, by a key of its own."""
    packed = ((index[:, 0] + CELL_LIMIT) << 32) | (index[:, 1] + CELL_LIMIT)
    order = np.lexsort((-counts, packed))
    keys, first = np.unique(packed[order], return_index=True)
    return Table(keys, np.minimum(counts[order][first], MOST_LOOKS)[:, None])


def _write(grid: GridLayer, hits: Table, misses: Table) -> None:
    keys = np.union1d(hits.keys, misses.keys)
    if not len(keys):
        return
    x, y = (keys >> 32) - CELL_LIMIT, (keys & 0xFFFFFFFF) - CELL_LIMIT
    tiles, slot = np.unique(np.column_stack((x, y)) // TILE, axis=0, return_inverse=True)
    counts = np.zeros((2, len(tiles), TILE, TILE), np.uint32)
    for side, table in enumerate((hits, misses)):
        counts[side, slot.ravel(), y % TILE, x % TILE] = table.at(keys)[:, 0]
    tile_keys = np.array([tile_key(a, b) for a, b in tiles.tolist()], np.int64)
    grid.pool.set_counts(tile_keys, counts[0], counts[1])


def _require_size(evidence: Evidence, cell_m: float, lattice: Lattice) -> None:
    ratio = cell_m / lattice.resolution_m
    cells = len(evidence.space) * max(ratio, 1.0) ** 2 + len(evidence.pieces) * (4.0 * ratio) * (2.0 + 3.0 * ratio)
    if cells > MOST_CELLS:
        raise MapError(
            f"{len(evidence.pieces)} pieces of wall and {len(evidence.space)} free cells make a grid of about "
            f"{cells:.0f} drawn cells at {lattice.resolution_m:g} m, the most is {MOST_CELLS}: take a coarser one"
        )
    for keys in (evidence.pieces.keys, evidence.space.keys):
        corners = cell_corners_m(keys[[0, -1]] if len(keys) else keys, cell_m)
        if corners.size and np.abs(corners).max() / lattice.resolution_m > CELL_LIMIT / 2:
            raise MapError(f"line segments reach beyond ±{CELL_LIMIT // 2} cells of a grid: take a coarser resolution")
