"""Pieces of wall in two grids that lie on each other: their directions and how far they are apart."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

WINDOW = 4  # cells to either side that tell the direction of a piece of wall
REACH = 3  # cells between a piece of wall of one map and its partner in the other, at most
STRAIGHT = 0.6  # (λ1 − λ2) / (λ1 + λ2) of the occupied cells in the window; 1 is a line
PARALLEL = math.cos(math.radians(30.0))  # pieces of wall further turned against each other are no partners


@njit(cache=True)
def piece(classes: NDArray[np.uint8], wanted: int, row: int, column: int) -> tuple[float, float, float, float]:
    """The mean (x, y) of the cells of class ``wanted`` around one of them, and their line's unit normal (x, y).

    In cells, where cell (row, column) spans column to column + 1 in x and row to row + 1 in y. The normal is (0, 0)
    where they form no line.
    """
    n, x, y, xx, xy, yy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(max(0, row - WINDOW), min(classes.shape[0], row + WINDOW + 1)):
        for c in range(max(0, column - WINDOW), min(classes.shape[1], column + WINDOW + 1)):
            if classes[r, c] == wanted:
                u, v = float(c - column), float(r - row)
                n, x, y, xx, xy, yy = n + 1, x + u, y + v, xx + u * u, xy + u * v, yy + v * v
    mean_x, mean_y = x / n, y / n
    xx, xy, yy = xx / n - mean_x * mean_x, xy / n - mean_x * mean_y, yy / n - mean_y * mean_y
    spread = math.hypot(xx - yy, 2.0 * xy)
    x, y = column + 0.5 + mean_x, row + 0.5 + mean_y
    if n <= WINDOW or spread < STRAIGHT * (xx + yy):
        return x, y, 0.0, 0.0
    along = 0.5 * math.atan2(2.0 * xy, xx - yy)
    return x, y, -math.sin(along), math.cos(along)


@njit(cache=True)
def nearest(classes: NDArray[np.uint8], wanted: int, x: float, y: float) -> tuple[int, int]:
    """Row and column of the cell of class ``wanted`` nearest to a point, within ``REACH``; (-1, -1) without any."""
    row, column = math.floor(y), math.floor(x)
    found, best = (-1, -1), (REACH + 0.5) ** 2
    for r in range(max(0, row - REACH), min(classes.shape[0], row + REACH + 1)):
        for c in range(max(0, column - REACH), min(classes.shape[1], column + REACH + 1)):
            if classes[r, c] == wanted:
                square = (c + 0.5 - x) ** 2 + (r + 0.5 - y) ** 2
                if square < best:
                    found, best = (r, c), square
    return found


@njit(cache=True)
def partners(
    target: NDArray[np.uint8],
    source: NDArray[np.uint8],
    cells: NDArray[np.int64],
    wanted: int,
    cosine: float,
    sine: float,
    shift_x: float,
    shift_y: float,
) -> NDArray[np.float64]:
    """The pieces of wall of the source that lie, turned and shifted, beside a parallel one of the target.

    ``target`` and ``source`` (h, w) classes with cells of one size; ``cells`` (n, 2) rows and columns of cells of class
    ``wanted`` in the source. Returns (k, 7), k ≤ n: the source's piece (x, y) in the target's cells, the normal of the
    target's (x, y) and the source's (x, y), both to the same side, and how far the target's lies along its normal.
    """
    out = np.empty((cells.shape[0], 7))
    k = 0
    for i in range(cells.shape[0]):
        u, v, m_u, m_v = piece(source, wanted, cells[i, 0], cells[i, 1])
        if m_u == 0.0 and m_v == 0.0:
            continue
        x, y = cosine * u - sine * v + shift_x, sine * u + cosine * v + shift_y
        row, column = nearest(target, wanted, x, y)
        if row < 0:
            continue
        to_x, to_y, n_x, n_y = piece(target, wanted, row, column)
        m_x, m_y = cosine * m_u - sine * m_v, sine * m_u + cosine * m_v
        along = n_x * m_x + n_y * m_y
        if abs(along) < PARALLEL:
            continue
        side = 1.0 if along > 0.0 else -1.0
        out[k] = x, y, n_x, n_y, side * m_x, side * m_y, n_x * (to_x - x) + n_y * (to_y - y)
        k += 1
    return out[:k]
