"""Growing walls out of pieces that continue each other."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_lines.kernels.keys import find, key_of, x_of, y_of

_REACH = 2  # cells in which a wall is continued
_ITS_OWN_M = 0.3  # a shorter wall runs as its pieces say, a longer one as their places do
ROW = 9  # columns of a piece: x, y, ux, uy, xx, xy, yy, weight, faced


@njit(cache=True)
def _line(sums: NDArray[np.float64], ux: float, uy: float, long: bool) -> tuple[float, float, float, float, float]:
    """Centre, direction and mean square across of sums w, wx, wy, wxx, wxy, wyy; the direction given when not long."""
    w = sums[0]
    x, y = sums[1] / w, sums[2] / w
    xx, xy, yy = sums[3] / w - x * x, sums[4] / w - x * y, sums[5] / w - y * y
    if long:
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
        c, s = math.cos(angle), math.sin(angle)
        if c * ux + s * uy < 0.0:
            c, s = -c, -s
    else:
        c, s = ux, uy
    return x, y, c, s, max(s * s * xx - 2.0 * c * s * xy + c * c * yy, 0.0)


@njit(cache=True)
def _add(sums: NDArray[np.float64], row: NDArray[np.float64], x0: float, y0: float) -> None:
    w, x, y = row[7], row[0] - x0, row[1] - y0
    sums[0] += w
    sums[1] += w * x
    sums[2] += w * y
    sums[3] += w * (x * x + row[4])
    sums[4] += w * (x * y + row[5])
    sums[5] += w * (y * y + row[6])


@njit(cache=True)
def half_length(row: NDArray[np.float64], c: float, s: float) -> float:
    """Half the length along (c, s) of a uniform piece of these moments."""
    return math.sqrt(max(3.0 * (c * c * row[4] + 2.0 * c * s * row[5] + s * s * row[6]), 0.0))


@njit(cache=True)
def grow(
    keys: NDArray[np.int64],
    rows: NDArray[np.float64],
    order: NDArray[np.int64],
    across_m: float,
    gap_m: float,
    turn_cosine: float,
) -> tuple[NDArray[np.int64], int]:
    """To which wall each piece belongs (n,), and how many walls there are.

    ``keys`` (n,) ascending, ``rows`` (n, 9), ``order`` (n,) in which pieces begin walls. A wall takes a piece of the
    neighbourhood that runs as it does (``turn_cosine``, the same side seen where both know it), lies on its line within
    ``across_m`` and continues it with no gap of more than ``gap_m``.
    """
    label = np.full(keys.size, -1, np.int64)
    stack = np.empty(keys.size, np.int64)
    walls = 0
    for seed in order:
        if label[seed] >= 0:
            continue
        x0, y0 = rows[seed, 0], rows[seed, 1]
        sums = np.zeros(6)
        _add(sums, rows[seed], x0, y0)
        ux, uy, faced = rows[seed, 2], rows[seed, 3], rows[seed, 8] > 0.0
        x, y, c, s, _ = _line(sums, ux, uy, False)
        low, high = -half_length(rows[seed], c, s), half_length(rows[seed], c, s)  # from (x0, y0) along (c, s)
        label[seed] = walls
        stack[0] = seed
        depth = 1
        while depth:
            depth -= 1
            here = keys[stack[depth]]
            for ix in range(x_of(here) - _REACH, x_of(here) + _REACH + 1):
                first = key_of(ix, y_of(here) - _REACH, 0)
                last = key_of(ix, y_of(here) + _REACH + 1, 0)
                k = find(keys, first)
                while k < keys.size and keys[k] < last:
                    if label[k] < 0:
                        row = rows[k]
                        dot = c * row[2] + s * row[3]
                        alike = dot if faced and row[8] > 0.0 else abs(dot)
                        dx, dy = row[0] - x0, row[1] - y0
                        off = abs((dx - x) * -s + (dy - y) * c)
                        t, half = dx * c + dy * s, half_length(row, c, s)
                        gap = max(t - half - high, low - t - half)
                        if alike >= turn_cosine and off <= across_m and gap <= gap_m:
                            _add(sums, row, x0, y0)
                            label[k] = walls
                            stack[depth] = k
                            depth += 1
                            if not faced and row[8] > 0.0:
                                faced = True
                                if dot < 0.0:
                                    c, s, low, high = -c, -s, -high, -low
                                    t = -t
                            low, high = min(low, t - half), max(high, t + half)
                            x, y, c, s, _ = _line(sums, c, s, high - low > _ITS_OWN_M)
                    k += 1
        walls += 1
    return label, walls


@njit(cache=True)
def measure(
    rows: NDArray[np.float64], looks: NDArray[np.int64], own: NDArray[np.float64], label: NDArray[np.int64], walls: int
) -> NDArray[np.float64]:
    """Walls (walls, 10) of labelled pieces.

    Columns: x0, y0, x1, y1, the seen side on the left where one is known; mean square across (m²); information per
    metre of one look; looks, weighted by length; share of the weight whose side is known; share of the weight that is
    ``own``; weight.
    """
    origin = np.full((walls, 2), np.nan)
    sums, headings = np.zeros((walls, 6)), np.zeros((walls, 2))
    shares = np.zeros((walls, 3))
    for k in range(rows.shape[0]):
        i = label[k]
        if math.isnan(origin[i, 0]):
            origin[i, 0], origin[i, 1] = rows[k, 0], rows[k, 1]
            headings[i, 0], headings[i, 1] = 1e-9 * rows[k, 2], 1e-9 * rows[k, 3]
        _add(sums[i], rows[k], origin[i, 0], origin[i, 1])
        if rows[k, 8] > 0.0:
            headings[i, 0] += rows[k, 7] * rows[k, 2]
            headings[i, 1] += rows[k, 7] * rows[k, 3]
            shares[i, 0] += rows[k, 7]
        shares[i, 1] += own[k]
        shares[i, 2] += rows[k, 7] * looks[k]
    lines = np.empty((walls, 5))
    extent = np.empty((walls, 2))
    for i in range(walls):
        w = sums[i, 0]
        x, y = sums[i, 1] / w, sums[i, 2] / w
        spread = sums[i, 3] / w - x * x + sums[i, 5] / w - y * y
        size = math.hypot(headings[i, 0], headings[i, 1])
        line = _line(sums[i], headings[i, 0] / size, headings[i, 1] / size, 12.0 * spread > _ITS_OWN_M**2)
        for column in range(5):
            lines[i, column] = line[column]
        extent[i, 0], extent[i, 1] = np.inf, -np.inf
    for k in range(rows.shape[0]):
        i = label[k]
        c, s = lines[i, 2], lines[i, 3]
        t = (rows[k, 0] - origin[i, 0] - lines[i, 0]) * c + (rows[k, 1] - origin[i, 1] - lines[i, 1]) * s
        half = half_length(rows[k], c, s)
        extent[i, 0], extent[i, 1] = min(extent[i, 0], t - half), max(extent[i, 1], t + half)
    out = np.empty((walls, 10))
    for i in range(walls):
        x, y, c, s = lines[i, 0] + origin[i, 0], lines[i, 1] + origin[i, 1], lines[i, 2], lines[i, 3]
        out[i, 0], out[i, 1] = x + extent[i, 0] * c, y + extent[i, 0] * s
        out[i, 2], out[i, 3] = x + extent[i, 1] * c, y + extent[i, 1] * s
        out[i, 4] = lines[i, 4]
        seen = shares[i, 2] / sums[i, 0]
        length = max(extent[i, 1] - extent[i, 0], 1e-6)
        out[i, 5] = sums[i, 0] / seen / length
        out[i, 6] = seen
        out[i, 7], out[i, 8] = shares[i, 0] / sums[i, 0], shares[i, 1] / sums[i, 0]
        out[i, 9] = sums[i, 0]
    return out
