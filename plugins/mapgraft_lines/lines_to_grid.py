"""Line segments as an occupancy grid: walls drawn into cells, free space filled in, count for count."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Layer, MapError, MapType
from mapgraft_grid.cells import (
    FROM_SCANS,
    HITS,
    MISSES,
    MOST_LOOKS,
    READY_MADE,
    Cells,
    GridLayer,
    Lattice,
    cells_at,
    cells_inside,
    lattice_of,
    layer_of_cells,
)
from mapgraft_grid.parameters import CELL_LIMIT
from mapgraft_lines.layer import FROM_SCANS as LINES_FROM_SCANS
from mapgraft_lines.layer import LOOKS, Evidence, as_layer
from mapgraft_lines.line_map import LineMap
from mapgraft_lines.map_type import LineSegments
from mapgraft_lines.table import Table
from mapgraft_lines.walls import cell_corners_m, half_lengths_m, piece_rows

BEFORE_WALLS: Final = 1.5  # cells of the line map: as far before a wall, on the seen side, beams came through
MOST_CELLS: Final = 100_000_000  # samples of walls and cells of free space that are drawn


class LinesToGrid:
    """Draws pieces of walls as hits and free space as misses.

    Walls are those of the map as ``source`` reads it; what it takes for none is not drawn. A grid cell
    through which a piece of wall runs has as many hits as the piece was seen, and no misses. A grid cell whose centre
    lies in a free cell of the line map has as many misses as that was looked through. Between the two, on the side from
    which a wall was seen and up to 1.5 cells of the line map before it, a grid cell has as many misses as the wall was
    seen: its beams came through there. Without free space (a plan, a file of segments) there are hits only. Rays and
    paths are not kept with lines, so the grid has none.
    """

    def convert(self, layer: Layer, source: MapType, target: MapType) -> GridLayer:
        """A grid layer with the target's parameters, of the walls that the source shows.

        Raises MapError when one of the three is of another type, or the grid would be too large.
        """
        own, lattice = as_layer(layer), lattice_of(target)
        if not isinstance(source, LineSegments):
            raise MapError(f"line segments are read as their own type says, found a layer to be read as {source.name}")
        evidence = own.all()
        _require_size(evidence, own.cell_m, lattice)
        drawn, before = _walls(_shown(evidence.pieces, source.view(own)), own.cell_m, lattice)
        hits, beside = _tabled(*drawn), _tabled(*before)
        misses = _tabled(*_space(evidence.space, own.cell_m, lattice)).without(hits.keys)
        misses = misses.plus(beside.without(hits.keys).without(misses.keys))
        told = _column(hits, HITS).plus(_column(misses, MISSES))
        return layer_of_cells(
            target,
            np.stack(((told.keys >> 32) - CELL_LIMIT, (told.keys & 0xFFFFFFFF) - CELL_LIMIT), axis=1),
            told.counts,
            observations=own.observations,
            sensors=own.sensors,
            mapper=FROM_SCANS if own.mapper in (LINES_FROM_SCANS, "") else READY_MADE,
        )


_Drawn = tuple[Cells, NDArray[np.int64]]  # cells and counts


def _shown(pieces: Table, seen: LineMap) -> Table:
    """The pieces that lie on walls of the map."""
    kept = np.isin(pieces.keys, seen.wall_keys(), assume_unique=True)
    return Table(pieces.keys[kept], pieces.counts[kept])


def _walls(pieces: Table, cell_m: float, lattice: Lattice) -> tuple[_Drawn, _Drawn]:
    """The cells of pieces, and those before their seen sides."""
    rows, looks = piece_rows(pieces, cell_m), pieces.counts[:, LOOKS]
    half = half_lengths_m(rows)
    counts = np.maximum(np.ceil(4.0 * half / lattice.resolution_m).astype(np.int64), 1)
    piece = np.repeat(np.arange(len(rows)), counts)
    nth = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    along = (2.0 * (nth + 0.5) / counts[piece] - 1.0) * half[piece]
    points = rows[piece, :2] + along[:, None] * rows[piece, 2:4]
    index = cells_at(points, lattice)
    sided = rows[piece, 8] > 0.0
    steps = np.arange(0.75, BEFORE_WALLS * cell_m / lattice.resolution_m, 0.5) * lattice.resolution_m
    normals = np.column_stack((-rows[piece, 3], rows[piece, 2]))[sided]
    ahead = (points[sided][:, None] + steps[:, None] * normals[:, None]).reshape(-1, 2)
    return (index, looks[piece]), (cells_at(ahead, lattice), np.repeat(looks[piece][sided], len(steps)))


def _space(space: Table, cell_m: float, lattice: Lattice) -> _Drawn:
    cells, row = cells_inside(cell_corners_m(space.keys, cell_m), cell_m, lattice)
    return cells, space.counts[row, 0]


def _tabled(index: Cells, counts: NDArray[np.int64]) -> Table:
    """The largest count of each cell, by a key of its own."""
    packed = ((index[:, 0] + CELL_LIMIT) << 32) | (index[:, 1] + CELL_LIMIT)
    order = np.argsort(packed, kind="stable")
    keys = packed[order]
    first = np.flatnonzero(np.diff(keys, prepend=-1))
    if not len(first):
        return Table.empty(1)
    return Table(keys[first], np.minimum(np.maximum.reduceat(counts[order], first), MOST_LOOKS)[:, None])


def _column(counts: Table, column: int) -> Table:
    """A table of hits and misses, of which one is told."""
    both = np.zeros((len(counts), 2), np.int64)
    both[:, column] = counts.counts[:, 0]
    return Table(counts.keys, both)


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
