"""Layers from given line segments: what other map types convert to, and what ready-made maps are read into.

``from_segments(map_type, points_m, sigma_m)`` is all that a conversion to ``line_segments`` needs.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, MapType, Points
from mapgraft_lines.kernels import chopping
from mapgraft_lines.kernels.keys import BARE, BARE_BINS, FACED, FACED_BINS, INDEX_BITS, LIMIT, SLOT_BITS
from mapgraft_lines.layer import CONVERTED, LOOKS, PIECE_COLUMNS, SPACE_COLUMNS, Evidence, LineLayer
from mapgraft_lines.table import Table, distinct

SegmentPoints = NDArray[np.float64]  # (n, 2, 2) segment, end, (x, y) in metres

MOST_PIECES: Final = 6_000_000  # of a layer: 1 GB of rows while they are summed
FINEST_SIGMA_M: Final = 1e-4
COARSEST_SIGMA_M: Final = 1.0
MOST_LOOKS: Final = 1 << 20  # of one segment


def from_segments(
    map_type: MapType,
    points_m: SegmentPoints,
    sigma_m: float | NDArray[np.floating] = 0.02,
    *,
    faced: bool | NDArray[np.bool_] = False,
    looks: int | NDArray[np.integer] = 1,
    free_m: Points | None = None,
    free_looks: int = 1,
    mapper: str = CONVERTED,
    observations: int = 1,
    sensors: frozenset[str] = frozenset(),
) -> LineLayer:
    """A layer of ``map_type`` (a ``LineSegments`` instance) that says that walls run along the segments.

    ``points_m`` (n, 2, 2) are the ends of n segments in metres; ``sigma_m`` the standard deviation across the wall,
    one or (n,); ``faced`` tells of which segments only the side on the **left**, going from the first end to the
    second, is open space (one or (n,)); False where nobody knows. ``looks`` is how many observations each stands for;
    of several in one place, those of the most seen count.
    ``free_m`` (k, 2) are places that are known to be free, each telling of the whole cell it lies in, ``free_looks``
    times. Segments without length are left out. Raises MapError when the type is another one, a number is not finite,
    a segment lies out of reach, or there would be more than 6 million pieces.
    """
    layer = map_type.new_layer()
    if not isinstance(layer, LineLayer):
        raise MapError(f"segments make a layer of line_segments, found the type {map_type.name}: name another target")
    ends = np.ascontiguousarray(np.asarray(points_m, np.float64).reshape(-1, 4))
    sigma = _checked_sigma(np.broadcast_to(np.asarray(sigma_m, np.float64), len(ends)))
    variance = np.zeros((len(ends), 5))
    variance[:, 0] = sigma**2
    seen = np.broadcast_to(np.asarray(looks, np.int64), len(ends))
    if len(ends) and not (seen.min() >= 1 and seen.max() <= MOST_LOOKS):
        raise MapError(f"a segment stands for 1 to {MOST_LOOKS} observations, found {seen.min()} to {seen.max()}")
    sides = np.ascontiguousarray(np.broadcast_to(np.asarray(faced, np.bool_), len(ends)))
    pieces = pieces_of(ends, sides, variance, np.ascontiguousarray(seen), layer.cell_m)
    layer.own = Evidence(pieces, free_cells(free_m, free_looks, layer.cell_m))
    layer.observations, layer.sensors, layer.mapper = observations, sensors, mapper
    return layer


def pieces_of(
    ends: NDArray[np.float64],
    faced: NDArray[np.bool_],
    variance: NDArray[np.float64],
    looks: NDArray[np.int64],
    cell_m: float,
) -> Table:
    """The pieces of segments (n, 4); see ``kernels.chopping.chop`` for the arrays.

    However many pieces lie in one slot of a cell, it was looked at as often as the one of them that was seen most: a
    wall in many short segments, or drawn twice, was not seen more often than one in a single segment. Raises MapError
    when a segment is not finite, out of reach, or there are too many pieces.
    """
    if ends.size and not np.abs(ends).max() < (LIMIT - 1) * cell_m:
        raise MapError(
            f"a map of line segments reaches ±{LIMIT * cell_m:.0f} m, found a segment beyond or not finite: "
            "check its unit and its pose"
        )
    most = chopping.count_pieces(ends, cell_m)
    if most > MOST_PIECES:
        raise MapError(
            f"{len(ends)} segments make about {most} pieces of {cell_m:g} m, the most is {MOST_PIECES}: "
            "check their unit, or take a larger cell_m"
        )
    keys, counts = np.empty(most, np.int64), np.zeros((most, PIECE_COLUMNS), np.int64)
    made = chopping.chop(ends, faced, variance, looks, cell_m, keys, counts)
    return Table.summed(keys[:made], counts[:made], most=LOOKS)


def free_cells(points_m: Points | None, looks: int, cell_m: float) -> Table:
    """The cells in which the points (n, 2) lie, each seen through ``looks`` times."""
    if points_m is None or not len(points_m):
        return Table.empty(SPACE_COLUMNS)
    index = np.floor(np.asarray(points_m, np.float64) / cell_m)
    if not np.abs(index).max() < LIMIT:
        raise MapError(f"a map of line segments reaches ±{LIMIT * cell_m:.0f} m, found free space beyond")
    keys = distinct(cell_keys(index[:, 0].astype(np.int64), index[:, 1].astype(np.int64)))
    return Table(keys, np.full((len(keys), SPACE_COLUMNS), looks, np.int64))


def slots_of(angle_rad: NDArray[np.float64], faced: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The slots (n,) of walls that run along directions, as ``kernels.keys.slot_at``."""
    sided = np.floor(angle_rad / math.tau * FACED_BINS + 0.5).astype(np.int64) % FACED_BINS
    bare = np.floor(angle_rad / math.pi * BARE_BINS + 0.5).astype(np.int64) % BARE_BINS
    out: NDArray[np.int64] = np.where(faced, FACED + sided, BARE + bare)
    return out


def cell_keys(ix: NDArray[np.int64], iy: NDArray[np.int64]) -> NDArray[np.int64]:
    """The keys (slot 0) of cells."""
    out: NDArray[np.int64] = (((ix + LIMIT) << INDEX_BITS) | (iy + LIMIT)) << SLOT_BITS
    return out


def _checked_sigma(sigma_m: NDArray[np.float64]) -> NDArray[np.float64]:
    if sigma_m.size and not ((sigma_m >= FINEST_SIGMA_M) & (sigma_m <= COARSEST_SIGMA_M)).all():
        found = sorted({float(sigma_m.min()), float(sigma_m.max())})
        raise MapError(
            f"the standard deviation of a segment lies in {FINEST_SIGMA_M:g} … {COARSEST_SIGMA_M:g} m, "
            f"found {' to '.join(f'{value:g}' for value in found)}: check its unit"
        )
    return sigma_m


def length_m(points_m: SegmentPoints) -> float:
    """The length of all segments (n, 2, 2) together."""
    return math.fsum(np.hypot(*(points_m[:, 1] - points_m[:, 0]).T).tolist()) if len(points_m) else 0.0
