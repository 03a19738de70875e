"""Counting how the classes of two grids meet."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def meet(
    target: NDArray[np.uint8],
    points: NDArray[np.float64],
    classes: NDArray[np.uint8],
    cosine: float,
    sine: float,
    shift_x: float,
    shift_y: float,
) -> NDArray[np.int64]:
    """The 3 × 3 table of (target class, point class) when the points are turned, shifted and dropped on the target.

    ``target`` (h, w) classes; ``points`` (n, 2) in the target's cells, where cell (row, column) spans column to
    column + 1 in x and row to row + 1 in y; ``classes`` (n,) of the points. Points outside count as unknown.
    """
    table = np.zeros((3, 3), np.int64)
    height, width = target.shape
    for i in range(points.shape[0]):
        x = math.floor(cosine * points[i, 0] - sine * points[i, 1] + shift_x)
        y = math.floor(sine * points[i, 0] + cosine * points[i, 1] + shift_y)
        if 0 <= x < width and 0 <= y < height:
            table[target[y, x], classes[i]] += 1
        else:
            table[0, classes[i]] += 1
    return table


@njit(cache=True)
def coincidences(
    target: NDArray[np.uint8], wanted: int, points: NDArray[np.float64], shifts: NDArray[np.float64]
) -> NDArray[np.int64]:
    """How many of the points fall on target cells of class ``wanted``, for each of k shifts.

    ``target`` (h, w) classes; ``points`` (n, 2) and ``shifts`` (k, 2) in the target's cells, as in ``meet``.
    """
    out = np.zeros(shifts.shape[0], np.int64)
    height, width = target.shape
    for k in range(shifts.shape[0]):
        count = 0
        for i in range(points.shape[0]):
            x = math.floor(points[i, 0] + shifts[k, 0])
            y = math.floor(points[i, 1] + shifts[k, 1])
            if 0 <= x < width and 0 <= y < height and target[y, x] == wanted:
                count += 1
        out[k] = count
    return out


@njit(cache=True)
def tile_tables(
    target: NDArray[np.int16],
    donor: NDArray[np.int16],
    target_free: int,
    target_occupied: int,
    donor_free: int,
    donor_occupied: int,
) -> NDArray[np.int64]:
    """For each of k tiles the counts (2, 2) of cells known in both: rows the target's class, columns the donor's.

    ``target`` and ``donor`` (k, h, w) log-odds, each read with its own thresholds; class 0 is free, 1 occupied.
    """
    out = np.zeros((target.shape[0], 2, 2), np.int64)
    for k in range(target.shape[0]):
        for y in range(target.shape[1]):
            for x in range(target.shape[2]):
                a, b = target[k, y, x], donor[k, y, x]
                a_occupied, b_occupied = a >= target_occupied, b >= donor_occupied
                if (a_occupied or a <= target_free) and (b_occupied or b <= donor_free):
                    out[k, int(a_occupied), int(b_occupied)] += 1
    return out
