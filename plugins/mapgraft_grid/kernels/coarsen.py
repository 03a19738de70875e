"""Viewing a class grid at a coarser resolution."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def coarsen(classes: NDArray[np.uint8], ratio: float) -> NDArray[np.uint8]:
    """The classes on cells ``ratio`` ≥ 1 times as large, with the same lower-left corner.

    A fine cell belongs to the coarse cell that holds its centre. A coarse cell is occupied when any of its fine cells
    is, free when at least half of them are, and unknown otherwise.
    """
    height, width = classes.shape
    rows, columns = math.ceil(height / ratio), math.ceil(width / ratio)
    cells = np.zeros((rows, columns), np.int32)
    free = np.zeros((rows, columns), np.int32)
    out = np.zeros((rows, columns), np.uint8)
    for y in range(height):
        row = min(int((y + 0.5) / ratio), rows - 1)
        for x in range(width):
            column = min(int((x + 0.5) / ratio), columns - 1)
            cells[row, column] += 1
            if classes[y, x] == 2:
                out[row, column] = 2
            elif classes[y, x] == 1:
                free[row, column] += 1
    for row in range(rows):
        for column in range(columns):
            if out[row, column] == 0 and free[row, column] > 0 and 2 * free[row, column] >= cells[row, column]:
                out[row, column] = 1
    return out
