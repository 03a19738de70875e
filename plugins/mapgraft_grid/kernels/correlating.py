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
    """What a wall and a free point of the other grid tell in each cell that is ``factor`` times as large.

    ``marks`` (h, w); ``wall`` and ``free`` (5,) what such a point tells on each mark. A wall point tells in a large cell
    what it tells on a wall when any of its cells is one, ``ring`` of that when one of the eight around has one, else
    the mean; a free point always the mean.
    """
    height, width = (marks.shape[0] + factor - 1) // factor, (marks.shape[1] + factor - 1) // factor
    on_wall = np.zeros((height, width), np.float32)
    on_free = np.zeros((height, width), np.float32)
    share = np.float32(1.0 / (factor * factor))
    some = np.zeros((height, width), np.bool_)
    for y in range(marks.shape[0]):
        row = y // factor
        for x in range(marks.shape[1]):
            m = marks[y, x]
            if m:
                column = x // factor
                on_wall[row, column] += share * wall[m]
                on_free[row, column] += share * free[m]
                some[row, column] |= m == 2
    if factor == 1:
        return on_wall, on_free
    near = np.float32(ring * wall[2])
    for row in range(height):
        for column in range(width):
            if some[row, column]:
                for r in range(max(0, row - 1), min(height, row + 2)):
                    for c in range(max(0, column - 1), min(width, column + 2)):
                        if not some[r, c]:
                            on_wall[r, c] = near
                on_wall[row, column] = wall[2]
    return on_wall, on_free


@njit(cache=True)
def splat(
    points: NDArray[np.float64], weight: float, yaws: NDArray[np.float64], unit: float, out: NDArray[np.float32]
) -> None:
    """Add the points (n, 2), turned by each of k yaws, to periodic grids (k, height, width) with cell (0, 0) around 0."""
    height, width = out.shape[1], out.shape[2]
    w = np.float32(weight)
    for k in range(yaws.size):
        c, s = math.cos(yaws[k]) / unit, math.sin(yaws[k]) / unit
        for i in range(points.shape[0]):
            x = math.floor(c * points[i, 0] - s * points[i, 1] + 0.5)
            y = math.floor(s * points[i, 0] + c * points[i, 1] + 0.5)
            out[k, y + height if y < 0 else y, x + width if x < 0 else x] += w


@njit(cache=True)
def multiply(target: NDArray[np.complex64], source: NDArray[np.complex64], out: NDArray[np.complex64]) -> None:
    """Cross spectra: target (2, h, w), source (2, k, h, w); out (2, k, h, w) for the source and for it turned by 180°."""
    for k in range(source.shape[1]):
        for y in range(source.shape[2]):
            for x in range(source.shape[3]):
                a, b = target[0, y, x], target[1, y, x]
                p, q = source[0, k, y, x], source[1, k, y, x]
                out[0, k, y, x] = a * p.conjugate() + b * q.conjugate()
                out[1, k, y, x] = a * p + b * q


@njit(cache=True)
def peaks(scores: NDArray[np.float32], count: int, least: float) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The best local maxima (of nine) of a periodic grid (h, w): rows and columns (n, 2) and values, best first."""
    height, width = scores.shape
    places = np.empty((count, 2), np.int64)
    values = np.empty(count, np.float32)
    n = 0
    floor = np.float32(least)
    for y in range(height):
        above, below = y - 1 if y else height - 1, y + 1 if y + 1 < height else 0
        for x in range(width):
            v = scores[y, x]
            if v <= floor:
                continue
            left, right = x - 1 if x else width - 1, x + 1 if x + 1 < width else 0
            if (
                v < scores[y, left]
                or v < scores[above, x]
                or v < scores[above, left]
                or v < scores[above, right]
                or v <= scores[y, right]
                or v <= scores[below, x]
                or v <= scores[below, left]
                or v <= scores[below, right]
            ):
                continue
            at = n if n < count else count - 1
            while at > 0 and values[at - 1] < v:
                values[at], places[at, 0], places[at, 1] = values[at - 1], places[at - 1, 0], places[at - 1, 1]
                at -= 1
            values[at], places[at, 0], places[at, 1] = v, y, x
            if n < count:
                n += 1
            if n == count:
                floor = values[count - 1]
    return places[:n], values[:n]


@njit(cache=True)
def climb(
    on_wall: NDArray[np.float32],
    on_free: NDArray[np.float32],
    unit: float,
    walls: NDArray[np.float64],
    free: NDArray[np.float64],
    free_weight: float,
    poses: NDArray[np.float64],
    yaw_step: float,
    yaws: int,
    reach: int,
) -> NDArray[np.float64]:
    """For each pose (k, 3) the best of those around: (k, 4) of x, y, yaw and the score.

    Poses bring the points' origin to (x, y), in metres from the fields' lower-left corner. Around are 2 · ``yaws`` + 1
    yaws and (2 · ``reach`` + 1)² shifts by whole cells.
    """
    height, width = on_wall.shape
    side = 2 * reach + 1
    out = np.empty((poses.shape[0], 4))
    sums = np.empty((side, side))
    for k in range(poses.shape[0]):
        best, found = -1e30, (poses[k, 0], poses[k, 1], poses[k, 2])
        for turn in range(-yaws, yaws + 1):
            yaw = poses[k, 2] + turn * yaw_step
            c, s = math.cos(yaw) / unit, math.sin(yaw) / unit
            x0, y0 = poses[k, 0] / unit, poses[k, 1] / unit
            sums[:] = 0.0
            for kind in range(2):
                field, points = (on_wall, walls) if kind == 0 else (on_free, free)
                weight = 1.0 if kind == 0 else free_weight
                for i in range(points.shape[0]):
                    x = math.floor(c * points[i, 0] - s * points[i, 1] + x0)
                    y = math.floor(s * points[i, 0] + c * points[i, 1] + y0)
                    if reach <= x < width - reach and reach <= y < height - reach:
                        for b in range(side):
                            for a in range(side):
                                sums[b, a] += weight * field[y + b - reach, x + a - reach]
                    elif -reach <= x < width + reach and -reach <= y < height + reach:
                        for b in range(max(0, reach - y), min(side, height + reach - y)):
                            for a in range(max(0, reach - x), min(side, width + reach - x)):
                                sums[b, a] += weight * field[y + b - reach, x + a - reach]
            for b in range(side):
                for a in range(side):
                    if sums[b, a] > best:
                        best = sums[b, a]
                        found = (poses[k, 0] + (a - reach) * unit, poses[k, 1] + (b - reach) * unit, yaw)
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = found[0], found[1], found[2], best
    return out
