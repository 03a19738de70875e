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
    points: NDArray[np.float64], weight: float, yaw: float, unit: float, plane: int, out: NDArray[np.float32]
) -> None:
    """Add the points (n, 2), turned, to one plane of a periodic grid (h, w, 2) whose cell (0, 0) lies around 0."""
    height, width = out.shape[:2]
    c, s = math.cos(yaw) / unit, math.sin(yaw) / unit
    for i in range(points.shape[0]):
        x = math.floor(c * points[i, 0] - s * points[i, 1] + 0.5)
        y = math.floor(s * points[i, 0] + c * points[i, 1] + 0.5)
        out[y + height if y < 0 else y, x + width if x < 0 else x, plane] += np.float32(weight)


@njit(cache=True, fastmath=True)
def multiply(target: NDArray[np.float32], source: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """The spectrum (h, w, 2) of all scores from that of the source (h, w, 2) and two of the target (2, h, w, 2).

    All are complex, as pairs. The source's is that of S = walls + i · free; the target's are U, half that of what both
    tell, and i · U̅ at the opposite frequency. With D = S − i · S at the opposite frequency, U · D̅ + (i · U̅) · D is
    the spectrum of scores + i · scores of the source turned by 180°, both real.
    """
    height, width = out.shape[:2]
    for y in range(height):
        back = height - y if y else 0
        for x in range(width):
            left = width - x if x else 0
            re = source[y, x, 0] + source[back, left, 1]
            im = source[y, x, 1] - source[back, left, 0]
            u_re, u_im, v_re, v_im = target[0, y, x, 0], target[0, y, x, 1], target[1, y, x, 0], target[1, y, x, 1]
            out[y, x, 0] = (u_re + v_re) * re + (u_im - v_im) * im
            out[y, x, 1] = (u_im + v_im) * re + (v_re - u_re) * im


@njit(cache=True)
def _is_peak(scores: NDArray[np.float32], plane: int, y: int, x: int) -> bool:
    """Whether no cell of the eight around (periodic) is higher; of equal ones the last is the peak."""
    height, width = scores.shape[:2]
    v = scores[y, x, plane]
    above, below = y - 1 if y else height - 1, y + 1 if y + 1 < height else 0
    left, right = x - 1 if x else width - 1, x + 1 if x + 1 < width else 0
    if v < scores[y, left, plane] or v <= scores[y, right, plane]:
        return False
    if v < scores[above, left, plane] or v < scores[above, x, plane] or v < scores[above, right, plane]:
        return False
    return bool(v > scores[below, left, plane] and v > scores[below, x, plane] and v > scores[below, right, plane])


@njit(cache=True, fastmath=True)
def _highest(scores: NDArray[np.float32], plane: int, y: int) -> np.float32:
    """The highest value of a row."""
    best: np.float32 = scores[y, 0, plane]
    for x in range(1, scores.shape[1]):
        if scores[y, x, plane] > best:
            best = scores[y, x, plane]
    return best


@njit(cache=True)
def peaks(
    scores: NDArray[np.float32], plane: int, count: int, least: float
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The best local maxima above ``least`` of one plane of a periodic grid (h, w, planes), best first.

    Row and column (n, 2), and values.
    """
    height, width = scores.shape[:2]
    places = np.empty((count, 2), np.int64)
    values = np.empty(count, np.float32)
    n, floor = 0, np.float32(least)
    for y in range(height):
        if _highest(scores, plane, y) <= floor:
            continue
        for x in range(width):
            v = scores[y, x, plane]
            if v <= floor or not _is_peak(scores, plane, y, x):
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
def keep(best: NDArray[np.float64], n: int, places: NDArray[np.int64], yaw: float, values: NDArray[np.float32]) -> int:
    """Put places with their yaw and values among the ``n`` best (k, 4), which are best first; how many these then are.

    Of equal values the earlier comes first, and what is not among the best k is dropped.
    """
    for i in range(values.size):
        if n == best.shape[0] and values[i] <= best[n - 1, 3]:
            continue
        n = min(n + 1, best.shape[0])
        at = n - 1
        while at > 0 and best[at - 1, 3] < values[i]:
            best[at] = best[at - 1]
            at -= 1
        best[at, 0], best[at, 1], best[at, 2], best[at, 3] = places[i, 0], places[i, 1], yaw, values[i]
    return n


@njit(cache=True)
def _bordered(field: NDArray[np.float32], border: int) -> NDArray[np.float32]:
    """The field with zeros around."""
    out = np.zeros((field.shape[0] + 2 * border, field.shape[1] + 2 * border), np.float32)
    out[border : border + field.shape[0], border : border + field.shape[1]] = field
    return out


@njit(cache=True)
def _sum(
    bordered: NDArray[np.float32],
    points: NDArray[np.float64],
    pose: tuple[float, float, float],
    weight: float,
    sums: NDArray[np.float64],
) -> None:
    """Add what the points tell on the field, with its border of 2, when brought there and to the eight cells around."""
    height, width = bordered.shape
    x0, y0, c, s = pose[0] + 1.0, pose[1] + 1.0, math.cos(pose[2]), math.sin(pose[2])
    low_left = low = low_right = left = here = right = high_left = high = high_right = np.float32(0.0)
    for i in range(points.shape[0]):
        x = math.floor(c * points[i, 0] - s * points[i, 1] + x0)
        y = math.floor(s * points[i, 0] + c * points[i, 1] + y0)
        if x < 0 or y < 0 or x + 3 > width or y + 3 > height:
            continue
        low_left += bordered[y, x]
        low += bordered[y, x + 1]
        low_right += bordered[y, x + 2]
        left += bordered[y + 1, x]
        here += bordered[y + 1, x + 1]
        right += bordered[y + 1, x + 2]
        high_left += bordered[y + 2, x]
        high += bordered[y + 2, x + 1]
        high_right += bordered[y + 2, x + 2]
    sums[0, 0] += weight * low_left
    sums[0, 1] += weight * low
    sums[0, 2] += weight * low_right
    sums[1, 0] += weight * left
    sums[1, 1] += weight * here
    sums[1, 2] += weight * right
    sums[2, 0] += weight * high_left
    sums[2, 1] += weight * high
    sums[2, 2] += weight * high_right


@njit(cache=True)
def climb(
    on_wall: NDArray[np.float32],
    on_free: NDArray[np.float32],
    walls: NDArray[np.float64],
    free: NDArray[np.float64],
    weights: tuple[float, float],
    poses: NDArray[np.float64],
    yaw_step: float,
    reach: int,
) -> NDArray[np.float64]:
    """For each pose (k, 3) the best of those around: (k, 4) of x, y, yaw and the score.

    All lengths are in the fields' cells. A pose brings the points' origin to (x, y) from the fields' lower-left corner;
    around it are, with ``reach`` 1, three yaws and nine shifts of one cell; with 0 it stands alone. ``weights`` are
    those of a wall and a free point.
    """
    walls_there, free_there = _bordered(on_wall, 2), _bordered(on_free, 2)
    out = np.empty((poses.shape[0], 4))
    sums = np.empty((3, 3))
    for k in range(poses.shape[0]):
        out[k, 3] = -np.inf
        for turn in range(-reach, reach + 1):
            pose = (poses[k, 0], poses[k, 1], poses[k, 2] + turn * yaw_step)
            sums[:] = 0.0
            _sum(walls_there, walls, pose, weights[0], sums)
            _sum(free_there, free, pose, weights[1], sums)
            for b in range(1 - reach, 2 + reach):
                for a in range(1 - reach, 2 + reach):
                    if sums[b, a] > out[k, 3]:
                        out[k, 0], out[k, 1] = pose[0] + (a - 1), pose[1] + (b - 1)
                        out[k, 2], out[k, 3] = pose[2], sums[b, a]
    return out
