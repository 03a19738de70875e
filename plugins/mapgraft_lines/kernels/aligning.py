"""Least squares of the distances between walls that lie on each other."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_SHORTEST_M = 0.15  # an overlap that says something
_SHARE = 1.0 / math.sqrt(12.0)  # two places so far from the middle stand for all places along an overlap


@njit(cache=True)
def equations(
    target: NDArray[np.float64],
    target_faced: NDArray[np.bool_],
    target_variance: NDArray[np.float64],
    source: NDArray[np.float64],
    source_faced: NDArray[np.bool_],
    source_variance: NDArray[np.float64],
    pose: NDArray[np.float64],
    across_m: float,
    turn_cosine: float,
) -> NDArray[np.float64]:
    """One equation for either half of each overlap: (k, 8) of x, y (place in the target's frame), nx, ny (the target
    wall's normal), how far the source's wall is off along it (m), length (m), variance (m²), number of the overlap.

    ``target`` (n, 4), ``source`` (m, 4), ``pose`` x, y, yaw of T_target_source; walls that are further than
    ``across_m`` from each other at the middle of their overlap give none.
    """
    x, y, c, s = pose[0], pose[1], math.cos(pose[2]), math.sin(pose[2])
    rows = np.empty((64, 8))
    n, overlaps = 0, 0
    for j in range(source.shape[0]):
        x0, y0 = c * source[j, 0] - s * source[j, 1] + x, s * source[j, 0] + c * source[j, 1] + y
        x1, y1 = c * source[j, 2] - s * source[j, 3] + x, s * source[j, 2] + c * source[j, 3] + y
        long = math.hypot(x1 - x0, y1 - y0)
        ux, uy = (x1 - x0) / long, (y1 - y0) / long
        for i in range(target.shape[0]):
            tx, ty = target[i, 0], target[i, 1]
            length = math.hypot(target[i, 2] - tx, target[i, 3] - ty)
            vx, vy = (target[i, 2] - tx) / length, (target[i, 3] - ty) / length
            q0, q1 = vx * (y0 - ty) - vy * (x0 - tx), vx * (y1 - ty) - vy * (x1 - tx)
            if min(q0, q1) > across_m or max(q0, q1) < -across_m:
                continue
            dot = ux * vx + uy * vy
            if (dot if source_faced[j] and target_faced[i] else abs(dot)) < turn_cosine:
                continue
            t0, t1 = vx * (x0 - tx) + vy * (y0 - ty), vx * (x1 - tx) + vy * (y1 - ty)
            low, high = max(min(t0, t1), 0.0), min(max(t0, t1), length)
            if high - low < _SHORTEST_M:
                continue
            middle, slope = 0.5 * (low + high), (q1 - q0) / (t1 - t0)
            if abs(q0 + (middle - t0) * slope) > across_m:
                continue
            if n + 2 > rows.shape[0]:
                more = np.empty((2 * rows.shape[0], 8))
                more[:n] = rows[:n]
                rows = more
            for side in (-1.0, 1.0):
                t = middle + side * _SHARE * (high - low)
                rows[n, 0], rows[n, 1] = tx + t * vx, ty + t * vy
                rows[n, 2], rows[n, 3] = -vy, vx
                rows[n, 4] = q0 + (t - t0) * slope
                rows[n, 5] = 0.5 * (high - low)
                rows[n, 6] = target_variance[i] + source_variance[j]
                rows[n, 7] = overlaps
                n += 1
            overlaps += 1
    return rows[:n]


@njit(cache=True)
def information(rows: NDArray[np.float64], weights: NDArray[np.float64], x0: float, y0: float) -> NDArray[np.float64]:
    """The normal equations (3, 4) of x, y, yaw about (x0, y0): matrix and right side."""
    out = np.zeros((3, 4))
    jacobian = np.empty(3)
    for k in range(rows.shape[0]):
        nx, ny = rows[k, 2], rows[k, 3]
        jacobian[0], jacobian[1] = nx, ny
        jacobian[2] = -(rows[k, 1] - y0) * nx + (rows[k, 0] - x0) * ny
        for a in range(3):
            for b in range(3):
                out[a, b] += weights[k] * jacobian[a] * jacobian[b]
            out[a, 3] -= weights[k] * jacobian[a] * rows[k, 4]
    return out
