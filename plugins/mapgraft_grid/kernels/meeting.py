"""How the marks of two grids meet, cell by cell, and what marks a grid of classes has."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def mark(classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The marks of classes (h, w), same shape.

    0 unknown, 1 free, 2 occupied, 3 free and touching an occupied cell, 4 unknown and touching one (of its eight).
    """
    height, width = classes.shape
    out = classes.copy()
    for row in range(height):
        for column in range(width):
            if classes[row, column] == 2:
                for r in range(max(0, row - 1), min(height, row + 2)):
                    for c in range(max(0, column - 1), min(width, column + 2)):
                        if classes[r, c] == 1:
                            out[r, c] = 3
                        elif classes[r, c] == 0:
                            out[r, c] = 4
    return out


@njit(cache=True)
def meeting(
    target: NDArray[np.uint8],
    source: NDArray[np.uint8],
    cosine: float,
    sine: float,
    shift_x: float,
    shift_y: float,
) -> NDArray[np.int64]:
    """The (5, 5) table of (target mark, source mark) when the source's cells are turned, shifted and dropped.

    ``target`` and ``source`` are marks. A cell's centre (x, y) of the source, in cells from its lower-left corner, goes
    to cosine · x - sine · y + shift_x, sine · x + cosine · y + shift_y in the target's cells. Cells of
    the source that land outside or know nothing are not counted.
    """
    table = np.zeros((5, 5), np.int64)
    height, width = target.shape
    for row in range(source.shape[0]):
        u0 = 0.5 * cosine - (row + 0.5) * sine + shift_x
        v0 = 0.5 * sine + (row + 0.5) * cosine + shift_y
        for column in range(source.shape[1]):
            theirs = source[row, column]
            if theirs == 0:
                continue
            x, y = math.floor(u0 + column * cosine), math.floor(v0 + column * sine)
            if 0 <= x < width and 0 <= y < height:
                table[target[y, x], theirs] += 1
    return table
