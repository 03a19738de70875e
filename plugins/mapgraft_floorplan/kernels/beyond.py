"""Which cells of a robot's map lie beyond a convex outline."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def count_beyond(
    cells: NDArray[np.int32], marks: NDArray[np.uint8], normals: NDArray[np.float64], limits: NDArray[np.float64]
) -> NDArray[np.int64]:
    """How many cells of each mark (5,) have their centre beyond any of the lines n · (x, y) = limit.

    ``cells`` (n, 2) are rows and columns, ``marks`` (n,) below 5; ``normals`` (k, 2) as x, y and ``limits`` (k,) in
    cells from the lower-left corner.
    """
    out = np.zeros(5, np.int64)
    for i in range(cells.shape[0]):
        x, y = cells[i, 1] + 0.5, cells[i, 0] + 0.5
        for k in range(limits.size):
            if normals[k, 0] * x + normals[k, 1] * y > limits[k]:
                out[marks[i]] += 1
                break
    return out
