"""L1 distance maps and what the distance metric reads from them (Birk and Carpin 2006)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def taxicab(classes: NDArray[np.uint8], wanted: int, far: int) -> NDArray[np.int32]:
    """Steps along the axes from every cell of (h, w) to the nearest cell of class ``wanted``; ``far`` at most.

    The two directions are separable: first along the columns, then along the rows.
    """
    height, width = classes.shape
    out = np.empty((height, width), np.int32)
    for y in range(height):
        for x in range(width):
            out[y, x] = 0 if classes[y, x] == wanted else far
    for y in range(1, height):
        for x in range(width):
            out[y, x] = min(out[y, x], out[y - 1, x] + 1)
    for y in range(height - 2, -1, -1):
        for x in range(width):
            out[y, x] = min(out[y, x], out[y + 1, x] + 1)
    for y in range(height):
        nearest = far
        for x in range(width):
            nearest = min(nearest + 1, out[y, x])
            out[y, x] = nearest
        nearest = far
        for x in range(width - 1, -1, -1):
            nearest = min(nearest + 1, out[y, x])
            out[y, x] = nearest
    return out


@njit(cache=True)
def joint_box(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> tuple[int, int, int, int]:
    """The rectangle of the cells known in both: first row and column, one beyond the last; all 0 without any."""
    height, width = a.shape
    top, left, bottom, right = height, width, 0, 0
    for y in range(height):
        for x in range(width):
            if a[y, x] > 0 and b[y, x] > 0:
                top, bottom = min(top, y), y + 1
                left, right = min(left, x), max(right, x + 1)
    if bottom == 0:
        return 0, 0, 0, 0
    return top, left, bottom, right


@njit(cache=True)
def reach_beyond(
    source: NDArray[np.uint8],
    other: NDArray[np.uint8],
    to_free: NDArray[np.int32],
    to_occupied: NDArray[np.int32],
    margins: tuple[int, int, int, int],
) -> int:
    """How many cells more must be seen around ``other`` for the distances that ``collect`` reads to be exact.

    All arrays (h, w) are cut from wider ones, in which ``other`` was seen ``margins`` cells farther to the left, below,
    to the right and above. A cell outside may be the nearest one where the border is nearer than the distance found.
    """
    height, width = source.shape
    left, below, right, above = margins
    most = 0
    for y in range(height):
        for x in range(width):
            c = source[y, x]
            if c > 0 and other[y, x] > 0:
                d = to_occupied[y, x] if c == 2 else to_free[y, x]
                outside = min(x + left, width - 1 - x + right, y + below, height - 1 - y + above) + 1
                most = max(most, d - outside)
    return most


@njit(cache=True)
def collect(
    source: NDArray[np.uint8],
    other: NDArray[np.uint8],
    to_free: NDArray[np.int32],
    to_occupied: NDArray[np.int32],
    trim: int,
) -> NDArray[np.int64]:
    """Per class of ``source``, over the cells known in both: count, Σ distance, Σ distance cut at ``trim``.

    ``to_free`` and ``to_occupied`` are the distance maps of ``other``; all arrays (h, w). Returns (3, 3), row = class.
    """
    out = np.zeros((3, 3), np.int64)
    height, width = source.shape
    for y in range(height):
        for x in range(width):
            c = source[y, x]
            if c > 0 and other[y, x] > 0:
                d = to_occupied[y, x] if c == 2 else to_free[y, x]
                out[c, 0] += 1
                out[c, 1] += d
                out[c, 2] += min(d, trim)
    return out
