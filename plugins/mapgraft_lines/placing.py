"""Placing evidence in another frame: floats, rounded; on one machine the same layer gives the same bytes."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Transform
from mapgraft_lines.kernels.keys import BARE, LIMIT, STEPS_PER_M
from mapgraft_lines.layer import DX, DY, LOOKS, PIECE_COLUMNS, SPACE_COLUMNS, WX, WXX, WXY, WY, WYY, Evidence, W
from mapgraft_lines.segments import cell_keys, slots_of
from mapgraft_lines.table import Counts, Table, distinct
from mapgraft_lines.walls import SLOT_MASK, cell_corners_m

RESAMPLER: Final = "pieces_at_their_middle/1"
_PLANAR_TOLERANCE: Final = 1e-6


def place_evidence(
    evidence: Evidence, cell_m: float, T_receiver_donor: Transform, scale: float, receiver_cell_m: float
) -> Evidence:
    """The evidence in the receiver's frame and cells; ``T_receiver_donor`` in fixed point (``Transform.snapped``).

    Every piece goes, turned and as it is, to the receiver's cell in which its middle comes to lie. Pieces that come to
    lie in one slot tell of one place: their information adds up, but it was looked at as often as the one of them that
    was seen most, however many of the donor's cells lie in one of the receiver's. Each of the receiver's cells is as
    free as the donor's cell at its own centre, so that turning leaves no holes. Raises MapError when the transform
    tilts the plane, the scale is no positive number, or something comes to lie out of reach.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise MapError(f"the scale of a map of line segments must be positive, found {scale}")
    matrix = T_receiver_donor.matrix
    if abs(matrix[2, 2] - 1.0) > _PLANAR_TOLERANCE:
        raise MapError(f"a map of line segments lies in a plane and cannot be tilted, found {T_receiver_donor!r}")
    pieces = _placed_pieces(evidence.pieces, cell_m, matrix, scale, receiver_cell_m)
    return Evidence(pieces, _placed_space(evidence.space, cell_m, matrix, scale, receiver_cell_m))


def _placed_pieces(table: Table, cell_m: float, matrix: NDArray[np.float64], scale: float, to_m: float) -> Table:
    if not len(table):
        return table
    c, s = float(matrix[0, 0]), float(matrix[1, 0])
    old = table.counts.astype(np.float64)
    w = old[:, W]
    corner = cell_corners_m(table.keys, cell_m) * STEPS_PER_M
    mean_x, mean_y = old[:, WX] / w, old[:, WY] / w
    xx, xy, yy = (
        old[:, WXX] - mean_x * old[:, WX],
        old[:, WXY] - mean_x * old[:, WY],
        old[:, WYY] - mean_y * old[:, WY],
    )
    at_x, at_y = corner[:, 0] + mean_x, corner[:, 1] + mean_y
    new_x = scale * (c * at_x - s * at_y) + matrix[0, 3] * STEPS_PER_M
    new_y = scale * (s * at_x + c * at_y) + matrix[1, 3] * STEPS_PER_M
    side = to_m * STEPS_PER_M
    ix, iy = np.floor(new_x / side).astype(np.int64), np.floor(new_y / side).astype(np.int64)
    _require_reach(ix, iy, to_m)
    x, y = np.rint(new_x - ix * side), np.rint(new_y - iy * side)
    area = scale * scale
    new = np.empty((len(table), PIECE_COLUMNS), np.int64)
    new[:, LOOKS], new[:, W] = table.counts[:, LOOKS], table.counts[:, W]
    new[:, WX], new[:, WY] = w * x, w * y
    new[:, WXX] = np.rint(area * (c * c * xx - 2.0 * c * s * xy + s * s * yy) + w * x * x)
    new[:, WXY] = np.rint(area * (c * s * (xx - yy) + (c * c - s * s) * xy) + w * x * y)
    new[:, WYY] = np.rint(area * (s * s * xx + 2.0 * c * s * xy + c * c * yy) + w * y * y)
    faced = (table.keys & SLOT_MASK) < BARE
    turn_c, turn_s = np.where(faced, c, c * c - s * s), np.where(faced, s, 2.0 * c * s)
    new[:, DX] = np.rint(turn_c * old[:, DX] - turn_s * old[:, DY])
    new[:, DY] = np.rint(turn_s * old[:, DX] + turn_c * old[:, DY])
    angle = np.arctan2(new[:, DY].astype(np.float64), new[:, DX].astype(np.float64))
    slots = slots_of(np.where(faced, angle, 0.5 * angle), faced)
    placed = Table.summed(cell_keys(ix, iy) | slots, new, most=LOOKS)
    share = cell_m / (to_m * scale)  # information is told for a piece as long as a cell; what is stretched is less sure
    return placed if share == 1.0 else Table(placed.keys, reweighed(placed.counts, share))


def reweighed(counts: Counts, share: float | NDArray[np.float64]) -> Counts:
    """Pieces with a share, one or (n,), of their information: at least 1, and where and how long they are as before."""
    w = counts[:, W].astype(np.float64)
    new = np.clip(np.rint(w * share), 1.0, None)
    x, y = counts[:, WX] / w, counts[:, WY] / w
    out = counts.copy()
    out[:, W] = new
    out[:, WX], out[:, WY] = np.rint(new * x), np.rint(new * y)
    near_x, near_y = out[:, WX] / new, out[:, WY] / new
    out[:, WXX] = np.rint(new * (counts[:, WXX] / w - x * x + near_x * near_x))
    out[:, WXY] = np.rint(new * (counts[:, WXY] / w - x * y + near_x * near_y))
    out[:, WYY] = np.rint(new * (counts[:, WYY] / w - y * y + near_y * near_y))
    for column in (DX, DY):
        out[:, column] = np.rint(new * (counts[:, column] / w))
    return out


def _placed_space(table: Table, cell_m: float, matrix: NDArray[np.float64], scale: float, to_m: float) -> Table:
    if not len(table):
        return table
    c, s = float(matrix[0, 0]), float(matrix[1, 0])
    x0, y0 = float(matrix[0, 3]), float(matrix[1, 3])
    middle = cell_corners_m(table.keys, cell_m) + 0.5 * cell_m
    near_x = np.floor((scale * (c * middle[:, 0] - s * middle[:, 1]) + x0) / to_m).astype(np.int64)
    near_y = np.floor((scale * (s * middle[:, 0] + c * middle[:, 1]) + y0) / to_m).astype(np.int64)
    _require_reach(near_x, near_y, to_m)
    reach = math.ceil(math.sqrt(0.5) * cell_m * scale / to_m)  # half a diagonal
    steps = np.arange(-reach, reach + 1)
    ix = near_x[:, None, None] + steps[:, None] + 0 * steps
    iy = near_y[:, None, None] + steps + 0 * steps[:, None]
    keys = distinct(cell_keys(ix.ravel(), iy.ravel()))
    centre = cell_corners_m(keys, to_m) + 0.5 * to_m
    dx, dy = centre[:, 0] - x0, centre[:, 1] - y0
    from_x = np.floor((c * dx + s * dy) / scale / cell_m).astype(np.int64)
    from_y = np.floor((c * dy - s * dx) / scale / cell_m).astype(np.int64)
    counts = table.at(cell_keys(from_x, from_y))
    seen = counts[:, 0] > 0
    return Table(keys[seen], counts[seen].reshape(-1, SPACE_COLUMNS))


def _require_reach(ix: NDArray[np.int64], iy: NDArray[np.int64], cell_m: float) -> None:
    if ix.size and max(int(np.abs(ix).max()), int(np.abs(iy).max())) >= LIMIT - 4:
        raise MapError(
            f"a map of line segments reaches ±{LIMIT * cell_m:.0f} m, placed it would lie beyond: check the transform"
        )
