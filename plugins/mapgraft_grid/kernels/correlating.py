"""The kernels of the correlation search: fields, splatted points, products of spectra, best cells, scores."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def fields(
    marks: NDArray[np.uint8], factor: int, wall: NDArray[np.float64], free: NDArray[np.float64], ring: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What a wall point and a free point of the other grid tell on cells ``factor`` times as large.

    ``marks`` (h, w); ``wall`` and ``free`` (5,) what such a point tells on each mark. On a large cell a wall point
    tells what it tells on a wall where any of the small cells is one, ``ring`` of that where one of the eight large
    cells around has one, and the mean elsewhere; a free point always tells the mean.
    """
    height, width = (marks.shape[0] + factor - 1) // factor, (marks.shape[1] + factor - 1) // factor
    on_wall = np.zeros((height, width), np.float32)
    on_free = np.zeros((height, width), np.float32)
    some = np.zeros((height, width), np.bool_)
    share = 1.0 / (factor * factor)
    for y in range(marks.shape[0]):
        row = y // factor
        for x in range(marks.shape[1]):
            m = marks[y, x]
            if m:
                column = x // factor
                on_wall[row, column] += np.float32(share * wall[m])
                on_free[row, column] += np.float32(share * free[m])
                some[row, column] |= m == 2
    if factor > 1:
        _soften(some, np.float32(wall[2]), np.float32(ring * wall[2]), on_wall)
    return on_wall, on_free


@njit(cache=True)
def _soften(some: NDArray[np.bool_], on: np.float32, near: np.float32, out: NDArray[np.float32]) -> None:
    """Write ``on`` where some is, and ``near`` into the others of the eight cells around."""
    height, width = some.shape
    for row in range(height):
        for column in range(width):
            if some[row, column]:
                out[row, column] = on
                for r in range(max(0, row - 1), min(height, row + 2)):
                    for c in range(max(0, column - 1), min(width, column + 2)):
                        if not some[r, c]:
                            out[r, c] = near


@njit(cache=True)
def splat(
    points: NDArray[np.float64], weight: float, yaws: NDArray[np.float64], unit: float, out: NDArray[np.float32]
) -> None:
    """Add the points (n, 2), turned by each of k yaws, to periodic grids (k, h, w) whose cell (0, 0) lies around 0."""
    height, width = out.shape[1], out.shape[2]
    for k in range(yaws.size):
        c, s = math.cos(yaws[k]) / unit, math.sin(yaws[k]) / unit
        for i in range(points.shape[0]):
            x = math.floor(c * points[i, 0] - s * points[i, 1] + 0.5)
            y = math.floor(s * points[i, 0] + c * points[i, 1] + 0.5)
            out[k, y + height if y < 0 else y, x + width if x < 0 else x] += np.float32(weight)


@njit(cache=True, fastmath=True)
def multiply(target: NDArray[np.complex64], source: NDArray[np.complex64], out: NDArray[np.complex64]) -> None:
    """Spectra of the scores: target (2, h, w), source (2, k, h, w); out (2, k, h, w).

    The first half is for the source as it is, the second for the source turned by 180°, whose spectra are conjugate.
    """
    for k in range(source.shape[1]):
        for y in range(source.shape[2]):
            for x in range(source.shape[3]):
                a, b = target[0, y, x], target[1, y, x]
                p, q = source[0, k, y, x], source[1, k, y, x]
                out[0, k, y, x] = a * p.conjugate() + b * q.conjugate()
                out[1, k, y, x] = a * p + b * q


@njit(cache=True)
def _is_peak(scores: NDArray[np.float32], y: int, x: int) -> bool:
    """Whether no cell of the eight around (periodic) is higher; of equal ones the last is the peak."""
    height, width = scores.shape
    v = scores[y, x]
    above, below = y - 1 if y else height - 1, y + 1 if y + 1 < height else 0
    left, right = x - 1 if x else width - 1, x + 1 if x + 1 < width else 0
    if v < scores[above, left] or v < scores[above, x] or v < scores[above, right] or v < scores[y, left]:
        return False
    return bool(v > scores[y, right] and v > scores[below, left] and v > scores[below, x] and v > scores[below, right])


@njit(cache=True)
def peaks(scores: NDArray[np.float32], count: int, least: float) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The best local maxima above ``least`` of a periodic grid (h, w): row and column (n, 2), values; best first."""
    height, width = scores.shape
    places = np.empty((count, 2), np.int64)
    values = np.empty(count, np.float32)
    n, floor = 0, np.float32(least)
    for y in range(height):
        for x in range(width):
            v = scores[y, x]
            if v <= floor or not _is_peak(scores, y, x):
                continue
            n = min(n + 1, count)
            at = n - 1
            while at > 0 and values[at - 1] < v:
                values[at], places[at, 0], places[at, 1] = values[at - 1], places[at - 1, 0], places[at - 1, 1]
                at -= 1
            values[at], places[at, 0], places[at, 1] = v, y, x
            if n == count:
                floor = values[count - 1]
    return places[:n], values[:n]


@njit(cache=True)
def _sum(
    field: NDArray[np.float32],
    points: NDArray[np.float64],
    pose: tuple[float, float, float],
    weight: float,
    reach: int,
    sums: NDArray[np.float64],
) -> None:
    """Add what the points tell on the field when brought there, for all shifts of up to ``reach`` cells."""
    height, width = field.shape
    x0, y0, c, s = pose[0], pose[1], math.cos(pose[2]), math.sin(pose[2])
    side = 2 * reach + 1
    for i in range(points.shape[0]):
        x = math.floor(c * points[i, 0] - s * points[i, 1] + x0) - reach
        y = math.floor(s * points[i, 0] + c * points[i, 1] + y0) - reach
        if x >= 0 and y >= 0 and x + side <= width and y + side <= height:
            for b in range(side):
                for a in range(side):
                    sums[b, a] += weight * field[y + b, x + a]
        elif x > -side and y > -side and x < width and y < height:
            for b in range(max(0, -y), min(side, height - y)):
                for a in range(max(0, -x), min(side, width - x)):
                    sums[b, a] += weight * field[y + b, x + a]


@njit(cache=True)
def climb(
    on_wall: NDArray[np.float32],
    on_free: NDArray[np.float32],
    walls: NDArray[np.float64],
    free: NDArray[np.float64],
    weights: tuple[float, float],
    poses: NDArray[np.float64],
    yaw_step: float,
    turns: int,
    reach: int,
) -> NDArray[np.float64]:
    """For each pose (k, 3) the best of those around: (k, 4) of x, y, yaw and the score.

    All lengths are in the fields' cells. A pose brings the points' origin to (x, y) from the fields' lower-left corner;
    around it are 2 · ``turns`` + 1 yaws and (2 · ``reach`` + 1)² shifts. ``weights`` are those of a wall and a free
    point.
    """
    side = 2 * reach + 1
    out = np.empty((poses.shape[0], 4))
    sums = np.empty((side, side))
    for k in range(poses.shape[0]):
        out[k, 3] = -np.inf
        for turn in range(-turns, turns + 1):
            pose = (poses[k, 0], poses[k, 1], poses[k, 2] + turn * yaw_step)
            sums[:] = 0.0
            _sum(on_wall, walls, pose, weights[0], reach, sums)
            _sum(on_free, free, pose, weights[1], reach, sums)
            for b in range(side):
                for a in range(side):
                    if sums[b, a] > out[k, 3]:
                        out[k, 0], out[k, 1] = pose[0] + (a - reach), pose[1] + (b - reach)
                        out[k, 2], out[k, 3] = pose[2], sums[b, a]
    return out
