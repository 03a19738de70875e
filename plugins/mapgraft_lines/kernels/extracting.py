"""Segments in one scan: split and merge, then a total least squares fit with its variances.

Breakpoints by the incidence angle that a wall may be seen under at worst: G. A. Borges and M.-J. Aldon, Line
extraction in 2D range images for mobile robotics, Journal of Intelligent and Robotic Systems 40 (2004). Split and merge
as compared in V. Nguyen et al., A comparison of line extraction algorithms using 2D laser rangefinder for indoor mobile
robotics, IROS 2005. Variances of the fit: K. O. Arras, Feature-based robot navigation in known and unknown environments
(2003).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FACED_COLUMNS = 4  # x0, y0, x1, y1


@njit(cache=True)
def break_up(
    origins: NDArray[np.float64],
    ends: NDArray[np.float64],
    usable: NDArray[np.bool_],
    incidence_rad: float,
    jump_m: float,
    sigma_m: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The usable beams (k,) in their order, and where among them runs of one surface begin (r + 1,).

    ``origins`` (1, 2) or (n, 2), ``ends`` (n, 2), ``usable`` (n,). Two neighbours are of one surface when they lie no
    further apart than on a wall seen under ``incidence_rad``, and never further than ``jump_m``.
    """
    order = np.flatnonzero(usable)
    starts = np.empty(order.size + 1, np.int64)
    runs = 0
    for k in range(order.size):
        if k == 0 or not _one_surface(origins, ends, order[k - 1], order[k], incidence_rad, jump_m, sigma_m):
            starts[runs] = k
            runs += 1
    starts[runs] = order.size
    return order, starts[: runs + 1]


@njit(cache=True)
def _one_surface(
    origins: NDArray[np.float64],
    ends: NDArray[np.float64],
    a: int,
    b: int,
    incidence_rad: float,
    jump_m: float,
    sigma_m: float,
) -> bool:
    o = origins[b if origins.shape[0] > 1 else 0]
    ax, ay, bx, by = ends[a, 0] - o[0], ends[a, 1] - o[1], ends[b, 0] - o[0], ends[b, 1] - o[1]
    ra = math.hypot(ax, ay)
    turn = abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
    apart = math.hypot(bx - ax, by - ay)
    if turn >= incidence_rad:
        return apart <= jump_m
    allowed = ra * math.sin(turn) / math.sin(incidence_rad - turn) + 3.0 * sigma_m
    return apart <= min(max(allowed, 6.0 * sigma_m), jump_m)


@njit(cache=True)
def _sums(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Running sums (n + 1, 5) of x, y, xx, xy, yy."""
    out = np.zeros((points.shape[0] + 1, 5))
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        out[i + 1, 0] = out[i, 0] + x
        out[i + 1, 1] = out[i, 1] + y
        out[i + 1, 2] = out[i, 2] + x * x
        out[i + 1, 3] = out[i, 3] + x * y
        out[i + 1, 4] = out[i, 4] + y * y
    return out


@njit(cache=True)
def _fit(sums: NDArray[np.float64], a: int, b: int) -> tuple[float, float, float, float, float, float]:
    """The total least squares line of points a … b - 1: centre, direction, mean squares across and along it."""
    n = b - a
    x, y = (sums[b, 0] - sums[a, 0]) / n, (sums[b, 1] - sums[a, 1]) / n
    xx = (sums[b, 2] - sums[a, 2]) / n - x * x
    xy = (sums[b, 3] - sums[a, 3]) / n - x * y
    yy = (sums[b, 4] - sums[a, 4]) / n - y * y
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    c, s = math.cos(angle), math.sin(angle)
    along = c * c * xx + 2.0 * c * s * xy + s * s * yy
    across = max(s * s * xx - 2.0 * c * s * xy + c * c * yy, 0.0)
    return x, y, c, s, across, along


@njit(cache=True)
def _split(points: NDArray[np.float64], split_m: float, cuts: NDArray[np.bool_]) -> None:
    """Mark where each straight part of points (n, 2) begins: cut at what lies farthest from the chord."""
    n = points.shape[0]
    stack = np.empty((n + 1, 2), np.int64)
    stack[0, 0], stack[0, 1] = 0, n
    depth = 1
    while depth:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        if b - a < 3:
            continue
        dx, dy = points[b - 1, 0] - points[a, 0], points[b - 1, 1] - points[a, 1]
        length = math.hypot(dx, dy)
        worst, where = 0.0, -1
        for i in range(a + 1, b - 1):
            x, y = points[i, 0] - points[a, 0], points[i, 1] - points[a, 1]
            off = abs(dx * y - dy * x) / length if length > 1e-9 else math.hypot(x, y)
            if off > worst:
                worst, where = off, i
        if worst > split_m:
            cuts[where] = True
            stack[depth, 0], stack[depth, 1] = a, where
            stack[depth + 1, 0], stack[depth + 1, 1] = where, b
            depth += 2


@njit(cache=True)
def _merged(sums: NDArray[np.float64], bounds: NDArray[np.int64], count: int, across_m: float) -> int:
    """Join neighbouring parts, first to last, that one line fits as well; returns how many are left."""
    kept = 1
    for k in range(1, count):
        a, m, b = bounds[kept - 1], bounds[k], bounds[k + 1]
        whole = _fit(sums, a, b)
        if m - a >= 2 and b - m >= 2 and whole[4] <= across_m * across_m:
            left, right = _fit(sums, a, m), _fit(sums, m, b)
            cosine = abs(left[2] * right[2] + left[3] * right[3])
            if cosine > 0.97:  # about 14°
                continue
        bounds[kept] = m
        kept += 1
    bounds[kept] = bounds[count]
    return kept


@njit(cache=True)
def extract(
    points: NDArray[np.float64],
    origins: NDArray[np.float64],
    starts: NDArray[np.int64],
    split_m: float,
    across_m: float,
    length_min_m: float,
    points_min: int,
    sigma_m: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Segments of the runs of one scan.

    ``points`` and ``origins`` (n, 2) of the usable beams in their order, ``starts`` (r + 1,) where runs begin. Returns
    ends (k, 4) x0, y0, x1, y1 with the sensor on the left; (k, 2) variances of the offset at the middle of the points
    (m²) and of the angle (rad²); and (k, 2): where along the segment, from its middle, the middle of the points and the
    foot of the sensor lie (m).
    """
    ends = np.empty((points.shape[0] // 2 + 1, 4))
    variances, places = np.empty((ends.shape[0], 2)), np.empty((ends.shape[0], 2))
    made = 0
    for r in range(starts.size - 1):
        a, b = starts[r], starts[r + 1]
        if b - a < points_min:
            continue
        run, cuts = points[a:b], np.zeros(b - a, np.bool_)
        _split(run, split_m, cuts)
        inner = np.flatnonzero(cuts)
        bounds = np.empty(inner.size + 2, np.int64)
        bounds[0], bounds[inner.size + 1] = 0, b - a
        bounds[1 : inner.size + 1] = inner
        sums = _sums(run - run[0])
        for k in range(_merged(sums, bounds, inner.size + 1, across_m)):
            i, j = bounds[k], bounds[k + 1]
            if j - i < points_min:
                continue
            x, y, c, s, across, along = _fit(sums, i, j)
            x, y = x + run[0, 0], y + run[0, 1]
            t0 = (run[i, 0] - x) * c + (run[i, 1] - y) * s
            t1 = (run[j - 1, 0] - x) * c + (run[j - 1, 1] - y) * s
            if abs(t1 - t0) < length_min_m or across > across_m * across_m:
                continue
            ox, oy = origins[a + (i + j) // 2, 0] - x, origins[a + (i + j) // 2, 1] - y
            if (c * oy - s * ox) * (1.0 if t1 > t0 else -1.0) < 0.0:
                t0, t1 = t1, t0
            middle = 0.5 * (t0 + t1)
            sign = 1.0 if t1 > t0 else -1.0
            ends[made, 0], ends[made, 1] = x + t0 * c, y + t0 * s
            ends[made, 2], ends[made, 3] = x + t1 * c, y + t1 * s
            noise = max(sigma_m * sigma_m, across * (j - i) / max(j - i - 2, 1))
            variances[made, 0] = noise / (j - i)
            variances[made, 1] = noise / max((j - i) * along, 1e-12)
            places[made, 0] = -middle * sign
            places[made, 1] = (ox * c + oy * s - middle) * sign
            made += 1
    return ends[:made], variances[:made], places[:made]
