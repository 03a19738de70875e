"""Which occupied cells of a grid lie on lines, along what direction, and from which side they were seen."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_FREE, _OCCUPIED = 1, 2
NO_LINE, LEFT, BARE = 0, 1, 2  # of ``kind``: no line; a line whose left is the seen side; one whose side nobody knows
_BEHIND = 3  # cells: what lies within is looked at for the seen side, beyond the cell itself


@njit(cache=True)
def trace(
    classes: NDArray[np.uint8], rows: NDArray[np.int64], columns: NDArray[np.int64], radius: int, flat: float
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Directions (n, 2) and kinds (n,) of occupied cells (n,) of a grid (h, w).

    A cell lies on a line when the occupied cells within ``radius`` spread across the line by less than ``flat`` of
    what they spread along it (as variances), or when such a cell's line goes through it: so lines reach into corners.
    """
    n = rows.size
    lines, kinds = np.zeros((n, 2)), np.zeros(n, np.uint8)
    number = np.full(classes.shape, -1, np.int32)
    for k in range(n):
        lines[k, 0], lines[k, 1] = _direction(classes, rows[k], columns[k], radius, flat)
        if lines[k, 0] != 0.0 or lines[k, 1] != 0.0:
            number[rows[k], columns[k]] = k
    for k in range(n):
        if number[rows[k], columns[k]] < 0:
            found = _borrowed(number, lines, rows[k], columns[k], radius)
            if found >= 0:
                lines[k] = lines[found]
    for k in range(n):
        if lines[k, 0] != 0.0 or lines[k, 1] != 0.0:
            left = _seen(classes, rows[k], columns[k], -lines[k, 1], lines[k, 0])
            right = _seen(classes, rows[k], columns[k], lines[k, 1], -lines[k, 0])
            kinds[k] = LEFT if left != right else BARE
            if right and not left:
                lines[k] = -lines[k]
    return lines, kinds


@njit(cache=True)
def _direction(classes: NDArray[np.uint8], row: int, column: int, radius: int, flat: float) -> tuple[float, float]:
    height, width = classes.shape
    n, x, y, xx, xy, yy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(max(row - radius, 0), min(row + radius + 1, height)):
        for i in range(max(column - radius, 0), min(column + radius + 1, width)):
            dx, dy = float(i - column), float(j - row)
            if classes[j, i] == _OCCUPIED and dx * dx + dy * dy <= radius * radius:
                n += 1
                x, y = x + dx, y + dy
                xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
    if n < 3:
        return 0.0, 0.0
    x, y = x / n, y / n
    xx, xy, yy = xx / n - x * x, xy / n - x * y, yy / n - y * y
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(angle), math.sin(angle)
    along = c * c * xx + 2.0 * c * s * xy + s * s * yy
    across = s * s * xx - 2.0 * c * s * xy + c * c * yy
    if across > flat * along or 12.0 * along < radius * radius:
        return 0.0, 0.0
    return c, s


@njit(cache=True)
def _borrowed(number: NDArray[np.int32], lines: NDArray[np.float64], row: int, column: int, radius: int) -> int:
    """The nearest cell on a line whose line goes through this one, -1 if there is none."""
    height, width = number.shape
    best, found = radius * radius + 1.0, -1
    for j in range(max(row - radius, 0), min(row + radius + 1, height)):
        for i in range(max(column - radius, 0), min(column + radius + 1, width)):
            k = number[j, i]
            if k < 0:
                continue
            dx, dy = float(column - i), float(row - j)
            if abs(lines[k, 0] * dy - lines[k, 1] * dx) <= 1.0 and dx * dx + dy * dy < best:
                best, found = dx * dx + dy * dy, k
    return found


@njit(cache=True)
def _seen(classes: NDArray[np.uint8], row: int, column: int, nx: float, ny: float) -> bool:
    """Whether the first cell that is not occupied, from this one along a normal, is free."""
    height, width = classes.shape
    for step in range(1, 2 * _BEHIND + 2):
        x, y = round(column + 0.5 * step * nx), round(row + 0.5 * step * ny)
        if not (0 <= x < width and 0 <= y < height):
            return False
        if classes[y, x] != _OCCUPIED:
            return bool(classes[y, x] == _FREE)
    return False
