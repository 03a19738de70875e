"""Moving a placement downhill on a field of distances to walls: robust Gauss-Newton."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, fastmath=True)
def _add(
    distances: NDArray[np.float32],
    unit: float,
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    corner: NDArray[np.float64],
    backward: bool,
    sigma: float,
    share: float,
    normal: NDArray[np.float64],
) -> None:
    """Add the normal equations of the points: ``normal`` (3, 4) is JᵀWJ and JᵀWr of x, y, yaw.

    ``distances`` (h, w) to the nearest wall at cell centres, with its lower-left corner at ``corner``. The pose brings
    the source's points to the target's field; with ``backward``, its inverse brings the target's to the source's.
    """
    height, width = distances.shape
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        u, v = points[i, 0], points[i, 1]
        if backward:
            u, v = u - pose[0], v - pose[1]
            x, y = c * u + s * v, -s * u + c * v
        else:
            x, y = c * u - s * v + pose[0], s * u + c * v + pose[1]
        column, row = (x - corner[0]) / unit - 0.5, (y - corner[1]) / unit - 0.5
        left, low = math.floor(column), math.floor(row)
        if not (0 <= left < width - 1 and 0 <= low < height - 1):
            continue
        a, b = column - left, row - low
        d00, d01 = distances[low, left], distances[low, left + 1]
        d10, d11 = distances[low + 1, left], distances[low + 1, left + 1]
        r = (1 - b) * ((1 - a) * d00 + a * d01) + b * ((1 - a) * d10 + a * d11)
        if r > 4.0 * sigma:
            continue
        weight = share / (1.0 + (r / sigma) ** 2) ** 2
        g_x = ((1 - b) * (d01 - d00) + b * (d11 - d10)) / unit
        g_y = ((1 - a) * (d10 - d00) + a * (d11 - d01)) / unit
        if backward:
            j_x, j_y = -(c * g_x - s * g_y), -(s * g_x + c * g_y)
            j_yaw = g_x * y - g_y * x
        else:
            j_x, j_y = g_x, g_y
            j_yaw = g_y * (x - pose[0]) - g_x * (y - pose[1])
        normal[0, 0] += weight * j_x * j_x
        normal[0, 1] += weight * j_x * j_y
        normal[0, 2] += weight * j_x * j_yaw
        normal[1, 1] += weight * j_y * j_y
        normal[1, 2] += weight * j_y * j_yaw
        normal[2, 2] += weight * j_yaw * j_yaw
        normal[0, 3] += weight * j_x * r
        normal[1, 3] += weight * j_y * r
        normal[2, 3] += weight * j_yaw * r


@njit(cache=True)
def _solved(normal: NDArray[np.float64], lever: float, damping: float) -> tuple[float, float, float]:
    """The step that solves the damped normal equations; no step where they tell nothing."""
    a, b, c = normal[0, 0] + damping, normal[0, 1], normal[0, 2]
    d, e, f = normal[1, 1] + damping, normal[1, 2], normal[2, 2] + damping * lever * lever
    determinant = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    if not determinant > 0.0:
        return 0.0, 0.0, 0.0
    x, y, z = -normal[0, 3], -normal[1, 3], -normal[2, 3]
    return (
        ((d * f - e * e) * x + (c * e - b * f) * y + (b * e - c * d) * z) / determinant,
        ((c * e - b * f) * x + (a * f - c * c) * y + (b * c - a * e) * z) / determinant,
        ((b * e - c * d) * x + (b * c - a * e) * y + (a * d - b * b) * z) / determinant,
    )


@njit(cache=True)
def refine(
    target_distances: NDArray[np.float32],
    target_unit: float,
    target_points: NDArray[np.float64],
    source_distances: NDArray[np.float32],
    source_unit: float,
    source_points: NDArray[np.float64],
    source_corner: NDArray[np.float64],
    poses: NDArray[np.float64],
    sigmas: NDArray[np.float64],
    steps: int,
) -> NDArray[np.float64]:
    """The poses (k, 3) moved to where the walls of both grids lie on each other.

    A pose brings the source's centre to (x, y), in metres from the lower-left corner of the target's field, turned by
    yaw. ``source_points`` are relative to the source's centre, ``target_points`` to the target's corner, and
    ``source_corner`` (2,) is the source field's corner relative to its centre. Of each sigma (m, the scale of
    Geman and McClure's robust loss) at most ``steps`` steps are taken. Both directions count alike.
    """
    out = poses.copy()
    lever = 1.0
    for i in range(source_points.shape[0]):
        lever += math.hypot(source_points[i, 0], source_points[i, 1]) / source_points.shape[0]
    forward, backward = 1.0 / max(1, source_points.shape[0]), 1.0 / max(1, target_points.shape[0])
    normal = np.empty((3, 4))
    zero = np.zeros(2)
    for k in range(out.shape[0]):
        for sigma in sigmas:
            for _ in range(steps):
                normal[:] = 0.0
                _add(target_distances, target_unit, source_points, out[k], zero, False, sigma, forward, normal)
                _add(source_distances, source_unit, target_points, out[k], source_corner, True, sigma, backward, normal)
                dx, dy, dyaw = _solved(normal, lever, 1e-2 * (normal[0, 0] + normal[1, 1]) + 1e-12)
                out[k, 0] += dx
                out[k, 1] += dy
                out[k, 2] += dyaw
                if abs(dx) + abs(dy) + lever * abs(dyaw) < 1e-4:
                    break
    return out


@njit(cache=True)
def distinct(spots: NDArray[np.float64], least: float) -> NDArray[np.int64]:
    """Which placements k lie, in the mean over their spots (k, n, 2), farther than ``least`` from all such before."""
    out = np.empty(spots.shape[0], np.int64)
    n, limit = 0, least * spots.shape[1]
    for k in range(spots.shape[0]):
        new = True
        for j in range(n):
            total, other = 0.0, out[j]
            for i in range(spots.shape[1]):
                total += math.hypot(spots[k, i, 0] - spots[other, i, 0], spots[k, i, 1] - spots[other, i, 1])
                if total > limit:
                    break
            if total <= limit:
                new = False
                break
        if new:
            out[n] = k
            n += 1
    return out[:n]
