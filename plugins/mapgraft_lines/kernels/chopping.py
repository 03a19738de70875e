"""Cutting segments into the pieces that lie in each cell, with what each piece tells as integers."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_lines.kernels.keys import STEPS_PER_M, key_of, slot_at

UNIT_M = 0.02  # the standard deviation of a piece of weight UNIT
UNIT = 256
HEAVIEST = 1 << 17
DIRECTION = 256  # steps of a unit vector
PIECE_COLUMNS = 9
_SHORTEST = 1e-9  # of a cell: shorter pieces are rounding


@njit(cache=True)
def count_pieces(ends: NDArray[np.float64], cell_m: float) -> int:
    """At most so many pieces segments (n, 4) of x0, y0, x1, y1 are cut into."""
    total = 0
    for i in range(ends.shape[0]):
        total += 3
        total += int(abs(math.floor(ends[i, 2] / cell_m) - math.floor(ends[i, 0] / cell_m)))
        total += int(abs(math.floor(ends[i, 3] / cell_m) - math.floor(ends[i, 1] / cell_m)))
    return total


@njit(cache=True)
def _moments(row: NDArray[np.int64], w: int, px: int, py: int, sx: float, sy: float) -> None:
    """Write the weighted moments of a piece with its middle at (px, py) that reaches over (sx, sy), all in steps."""
    row[2], row[3] = w * px, w * py
    row[4] = w * px * px + round(w * sx * sx / 12.0)
    row[5] = w * px * py + round(w * sx * sy / 12.0)
    row[6] = w * py * py + round(w * sy * sy / 12.0)


@njit(cache=True)
def chop(
    ends: NDArray[np.float64],
    faced: NDArray[np.bool_],
    variance: NDArray[np.float64],
    looks: NDArray[np.int64],
    cell_m: float,
    keys: NDArray[np.int64],
    counts: NDArray[np.int64],
) -> int:
    """Write one row for each piece of each segment; returns how many.

    ``ends`` (n, 4) x0, y0, x1, y1 (m), the seen side on the left where ``faced`` (n,); ``variance`` (n, 5): the
    variance across the wall at a place t metres from the middle is v0 + v1 · (t − v2)² + v3 · (t − v4)² (m²); ``looks``
    (n,); ``keys`` (m,) and ``counts`` (m, 9) as ``count_pieces`` says, in the columns of ``layer.Evidence``.
    """
    n = 0
    for i in range(ends.shape[0]):
        x0, y0 = ends[i, 0], ends[i, 1]
        dx, dy = ends[i, 2] - x0, ends[i, 3] - y0
        length = math.hypot(dx, dy)
        if not length > 0.0:
            continue
        angle = math.atan2(dy, dx)
        slot = slot_at(angle, faced[i])
        turn = angle if faced[i] else 2.0 * angle
        ux, uy = math.cos(turn) * DIRECTION, math.sin(turn) * DIRECTION
        at = 0.0
        ix, iy = math.floor(x0 / cell_m), math.floor(y0 / cell_m)
        last_x, last_y = math.floor(ends[i, 2] / cell_m), math.floor(ends[i, 3] / cell_m)
        for _ in range(2 + abs(last_x - ix) + abs(last_y - iy)):
            across, up = 2.0, 2.0  # where the line leaves the cell, as shares of the segment
            if dx != 0.0:
                across = ((ix + (1.0 if dx > 0.0 else 0.0)) * cell_m - x0) / dx
            if dy != 0.0:
                up = ((iy + (1.0 if dy > 0.0 else 0.0)) * cell_m - y0) / dy
            leaves = min(across, up, 1.0)
            piece = (leaves - at) * length
            if piece > _SHORTEST * cell_m:
                middle = 0.5 * (at + leaves)
                t = (middle - 0.5) * length
                v = variance[i, 0] + variance[i, 1] * (t - variance[i, 2]) ** 2
                v += variance[i, 3] * (t - variance[i, 4]) ** 2
                w = round(UNIT * UNIT_M * UNIT_M / v * piece / cell_m)
                w = min(max(w, 1), HEAVIEST)
                px = round((x0 + middle * dx - ix * cell_m) * STEPS_PER_M)
                py = round((y0 + middle * dy - iy * cell_m) * STEPS_PER_M)
                sx, sy = (leaves - at) * dx * STEPS_PER_M, (leaves - at) * dy * STEPS_PER_M
                keys[n] = key_of(ix, iy, slot)
                counts[n, 0], counts[n, 1] = looks[i], w
                _moments(counts[n], w, px, py, sx, sy)
                counts[n, 7], counts[n, 8] = round(w * ux), round(w * uy)
                n += 1
            if leaves >= 1.0:
                break
            at = max(at, leaves)
            if across <= up:
                ix += 1 if dx > 0.0 else -1
            if up <= across:
                iy += 1 if dy > 0.0 else -1
    return n
