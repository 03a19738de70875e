"""Moving a placed plan downhill on fields of distances to walls: robust Gauss-Newton over x, y, yaw and scale."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def _lookup(distances: NDArray[np.float32], column: float, row: float, out: NDArray[np.float64]) -> bool:
    """Distance and its slope per cell at a place between cell centres, into ``out`` (3,); False outside the field."""
    height, width = distances.shape
    left, low = math.floor(column), math.floor(row)
    if not (0 <= left < width - 1 and 0 <= low < height - 1):
        return False
    a, b = column - left, row - low
    d00, d01 = distances[low, left], distances[low, left + 1]
    d10, d11 = distances[low + 1, left], distances[low + 1, left + 1]
    out[0] = (1 - b) * ((1 - a) * d00 + a * d01) + b * ((1 - a) * d10 + a * d11)
    out[1] = (1 - b) * (d01 - d00) + b * (d11 - d10)
    out[2] = (1 - a) * (d10 - d00) + a * (d11 - d01)
    return True


@njit(cache=True)
def _count(j: NDArray[np.float64], r: float, sigma: float, share: float, normal: NDArray[np.float64]) -> None:
    """Add one equation to the normal equations (4, 5): JᵀWJ and JᵀWr."""
    weight = share / (1.0 + (r / sigma) ** 2) ** 2
    for i in range(4):
        for k in range(4):
            normal[i, k] += weight * j[i] * j[k]
        normal[i, 4] += weight * j[i] * r


@njit(cache=True)
def _forward(
    field: NDArray[np.float32],
    unit: float,
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    sigma: float,
    share: float,
    normal: NDArray[np.float64],
) -> int:
    """The plan's points (n, 2), from its centre, on the robot's field; how many count."""
    c, s, scale = math.cos(pose[2]), math.sin(pose[2]), pose[3]
    at, j = np.empty(3), np.empty(4)
    n = 0
    for i in range(points.shape[0]):
        u, v = c * points[i, 0] - s * points[i, 1], s * points[i, 0] + c * points[i, 1]
        x, y = scale * u + pose[0], scale * v + pose[1]
        if not _lookup(field, x / unit - 0.5, y / unit - 0.5, at) or at[0] > 4.0 * sigma:
            continue
        g_x, g_y = at[1] / unit, at[2] / unit
        j[0], j[1] = g_x, g_y
        j[2] = scale * (g_y * u - g_x * v)
        j[3] = g_x * u + g_y * v
        _count(j, at[0], sigma, share, normal)
        n += 1
    return n


@njit(cache=True)
def _backward(
    field: NDArray[np.float32],
    unit: float,
    corner: NDArray[np.float64],
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    sigma: float,
    share: float,
    normal: NDArray[np.float64],
) -> int:
    """The robot's points (n, 2) on the plan's field, whose distances and cells grow with the scale."""
    c, s, scale = math.cos(pose[2]), math.sin(pose[2]), pose[3]
    at, j = np.empty(3), np.empty(4)
    n = 0
    for i in range(points.shape[0]):
        dx, dy = points[i, 0] - pose[0], points[i, 1] - pose[1]
        u, v = (c * dx + s * dy) / scale, (-s * dx + c * dy) / scale
        if not _lookup(field, (u - corner[0]) / unit - 0.5, (v - corner[1]) / unit - 0.5, at):
            continue
        r = at[0] * scale
        if r > 4.0 * sigma:
            continue
        g_u, g_v = at[1] / unit, at[2] / unit
        j[0], j[1] = -(c * g_u - s * g_v), -(s * g_u + c * g_v)
        j[2] = scale * (g_u * v - g_v * u)
        j[3] = at[0] - (g_u * u + g_v * v)
        _count(j, r, sigma, share, normal)
        n += 1
    return n


@njit(cache=True)
def fit(
    robot_field: NDArray[np.float32],
    robot_unit: float,
    robot_points: NDArray[np.float64],
    plan_field: NDArray[np.float32],
    plan_unit: float,
    plan_points: NDArray[np.float64],
    plan_corner: NDArray[np.float64],
    poses: NDArray[np.float64],
    sigmas: NDArray[np.float64],
    steps: int,
    free_scale: bool,
) -> NDArray[np.float64]:
    """The poses (k, 4) of x, y, yaw and scale moved to where the walls of robot and plan lie on each other.

    A pose brings the plan's centre to (x, y), in metres from the lower-left corner of the robot's field, stretched by
    scale and turned by yaw. ``plan_points`` (n, 2) and ``plan_corner``, that of its field, are from the plan's centre
    in its own units, ``robot_points`` (m, 2) from the robot's corner; the fields hold distances at cell centres in the
    units of their side. Of each sigma (m, Geman and McClure's loss) at most ``steps`` steps are taken. Without
    ``free_scale`` the scale stays.
    """
    out = poses.copy()
    lever = 1e-6
    for i in range(plan_points.shape[0]):
        lever += math.hypot(plan_points[i, 0], plan_points[i, 1]) / plan_points.shape[0]
    there, back = 1.0 / max(1, plan_points.shape[0]), 1.0 / max(1, robot_points.shape[0])
    normal = np.empty((4, 5))
    for k in range(out.shape[0]):
        for sigma in sigmas:
            for _ in range(steps):
                normal[:] = 0.0
                _forward(robot_field, robot_unit, plan_points, out[k], sigma, there, normal)
                _backward(plan_field, plan_unit, plan_corner, robot_points, out[k], sigma, back, normal)
                arm = lever * out[k, 3]
                damping = 1e-2 * (normal[0, 0] + normal[1, 1]) + 1e-12
                matrix = normal[:, :4].copy()
                for i in range(4):
                    matrix[i, i] += damping * (1.0 if i < 2 else arm * arm if i == 2 else lever * lever)
                if not free_scale:
                    matrix[3, :] = 0.0
                    matrix[:, 3] = 0.0
                    matrix[3, 3] = 1.0
                    normal[3, 4] = 0.0
                step = np.linalg.solve(matrix, -np.ascontiguousarray(normal[:, 4]))
                step[3] = min(max(step[3], -0.05 * out[k, 3]), 0.05 * out[k, 3])
                out[k] += step
                if abs(step[0]) + abs(step[1]) + arm * abs(step[2]) + lever * abs(step[3]) < 1e-4:
                    break
    return out


@njit(cache=True)
def information(
    robot_field: NDArray[np.float32],
    robot_unit: float,
    plan_points: NDArray[np.float64],
    pose: NDArray[np.float64],
    sigma: float,
) -> tuple[NDArray[np.float64], int]:
    """JᵀWJ (4, 4) of x, y, yaw and scale over the plan's points near a wall of the robot's, and how many they are."""
    normal = np.zeros((4, 5))
    n = _forward(robot_field, robot_unit, plan_points, pose, sigma, 1.0, normal)
    return normal[:, :4].copy(), n
