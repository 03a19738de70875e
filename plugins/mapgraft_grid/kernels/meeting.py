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
    cells: NDArray[np.int32],
    marks: NDArray[np.uint8],
    cosine: float,
    sine: float,
    shift_x: float,
    shift_y: float,
) -> NDArray[np.int64]:
    """The (5, 5) table of (target mark, source mark) when the source's cells are turned, shifted and dropped.

    ``target`` (h, w) marks; ``cells`` (n, 2) rows and columns of the source and their ``marks`` (n,). A cell's centre
    (x, y), in cells from the source's lower-left corner, goes to cosine · x - sine · y + shift_x, sine · x + cosine · y
    + shift_y in the target's cells. What lands outside is not counted.
    """
    table = np.zeros((5, 5), np.int64)
    height, width = target.shape
    for i in range(cells.shape[0]):
        u, v = cells[i, 1] + 0.5, cells[i, 0] + 0.5
        x, y = math.floor(cosine * u - sine * v + shift_x), math.floor(sine * u + cosine * v + shift_y)
        if 0 <= x < width and 0 <= y < height:
            table[target[y, x], marks[i]] += 1
    return table
