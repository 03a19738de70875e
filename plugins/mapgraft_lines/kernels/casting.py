"""Which cells the beams of one scan went through freely."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_lines.kernels.keys import key_of

_THROUGH = 0.5  # of a cell: a shorter way through it tells nothing of the cell


@njit(cache=True)
def _mark(seen: NDArray[np.bool_], x0: float, y0: float, x1: float, y1: float, first_x: int, first_y: int) -> None:
    """Mark the cells through which a beam, given in cells, goes for half a cell or more."""
    dx, dy = x1 - x0, y1 - y0
    length = math.hypot(dx, dy)
    if length < _THROUGH:
        return
    ix, iy = math.floor(x0), math.floor(y0)
    at = 0.0
    for _ in range(3 + abs(math.floor(x1) - ix) + abs(math.floor(y1) - iy)):
        across, up = 2.0, 2.0
        if dx != 0.0:
            across = (ix + (1.0 if dx > 0.0 else 0.0) - x0) / dx
        if dy != 0.0:
            up = (iy + (1.0 if dy > 0.0 else 0.0) - y0) / dy
        leaves = min(across, up, 1.0)
        if (leaves - at) * length >= _THROUGH:
            seen[iy - first_y, ix - first_x] = True
        if leaves >= 1.0:
            return
        at = max(at, leaves)
        if across <= up:
            ix += 1 if dx > 0.0 else -1
        if up <= across:
            iy += 1 if dy > 0.0 else -1


@njit(cache=True)
def cast(
    origins: NDArray[np.float64],
    ends: NDArray[np.float64],
    hits: NDArray[np.bool_],
    cell_m: float,
    far_m: float,
    free_m: float,
    margin_m: float,
) -> NDArray[np.int64]:
    """Keys (k,) of the cells, ascending, through which the beams of one scan went freely.

    ``origins`` (1, 2) or (n, 2), ``ends`` (n, 2), ``hits`` (n,). A beam that hit something within ``far_m`` is free up
    to ``margin_m`` before its end, any other up to ``free_m`` or its end, whichever is nearer. All within reach.
    """
    reach = np.empty(ends.shape[0])
    low_x, low_y = origins[:, 0].min() / cell_m, origins[:, 1].min() / cell_m
    high_x, high_y = origins[:, 0].max() / cell_m, origins[:, 1].max() / cell_m
    for i in range(ends.shape[0]):
        o = origins[i if origins.shape[0] > 1 else 0]
        length = math.hypot(ends[i, 0] - o[0], ends[i, 1] - o[1])
        free = length - margin_m if hits[i] and length <= far_m else min(free_m, length)
        reach[i] = min(free / length, 1.0) if length > 0.0 else 0.0
        x = (o[0] + reach[i] * (ends[i, 0] - o[0])) / cell_m
        y = (o[1] + reach[i] * (ends[i, 1] - o[1])) / cell_m
        low_x, high_x, low_y, high_y = min(low_x, x), max(high_x, x), min(low_y, y), max(high_y, y)
    first_x, first_y = math.floor(low_x) - 1, math.floor(low_y) - 1
    width, height = math.floor(high_x) - first_x + 2, math.floor(high_y) - first_y + 2
    seen = np.zeros((height, width), np.bool_)
    for i in range(ends.shape[0]):
        if reach[i] > 0.0:
            o = origins[i if origins.shape[0] > 1 else 0]
            x0, y0 = o[0] / cell_m, o[1] / cell_m
            x1 = (o[0] + reach[i] * (ends[i, 0] - o[0])) / cell_m
            y1 = (o[1] + reach[i] * (ends[i, 1] - o[1])) / cell_m
            _mark(seen, x0, y0, x1, y1, first_x, first_y)
    out = np.empty(np.count_nonzero(seen), np.int64)
    n = 0
    for x in range(width):  # ascending keys: x is the higher part
        for y in range(height):
            if seen[y, x]:
                out[n] = key_of(x + first_x, y + first_y, 0)
                n += 1
    return out
