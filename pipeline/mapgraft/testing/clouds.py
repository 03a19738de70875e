"""The little rooms in three dimensions: what a spinning lidar sees in them, and what a ready-made map of points is."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Cloud, Points, Transform
from mapgraft.testing.rooms import REACH_M, Room, distances

HEIGHT_M: Final = 2.4  # of the rooms
SENSOR_M: Final = 1.0  # above the floor
RINGS: Final = 22
BEARINGS: Final = 120
DOWN_RAD: Final = math.radians(-75.0)  # steep enough to see the lower floor from near the step
UP_RAD: Final = math.radians(30.0)
SPACING_M: Final = 0.1  # of the points of a ready-made map


def look_around(room: Room, x: float, y: float, yaw: float) -> Cloud:
    """One sweep of a lidar whose sensor stands at a pose on the upper floor: floors, ceiling, walls and posts.

    It looks down as far as domes of beams do, so that over a near step it sees the lower floor.
    """
    bearings = -math.pi + math.tau * np.arange(BEARINGS) / BEARINGS
    flat = np.stack((np.cos(bearings + yaw), np.sin(bearings + yaw)), axis=1)
    away = np.minimum(distances(room.segments(), np.array([x, y]), flat), REACH_M)
    slopes = np.tan(np.linspace(DOWN_RAD, UP_RAD, RINGS))
    rise = np.where(slopes > 0, HEIGHT_M - SENSOR_M, -SENSOR_M) / slopes  # how far until the floor or the ceiling
    deeper = np.where(slopes > 0, rise, -(SENSOR_M + room.lower) / slopes)
    over_the_step = x + rise[:, None] * flat[:, 0] > room.step_x
    flat_m = np.minimum(away[None, :], np.where(over_the_step, deeper[:, None], rise[:, None]))
    points = np.stack((flat_m * np.cos(bearings), flat_m * np.sin(bearings), flat_m * slopes[:, None]), axis=-1)
    return Cloud(points.reshape(-1, 3).astype(np.float32))


def points_of(room: Room, x: float, y: float, sight_m: float) -> Cloud:
    """A ready-made map of the points within sight of a place: walls and posts up to the ceiling, and the floors."""
    flat = []
    for x0, y0, x1, y1 in room.segments().tolist():
        steps = max(1, round(math.hypot(x1 - x0, y1 - y0) / SPACING_M))
        share = (np.arange(steps) + 0.5)[:, None] / steps
        flat.append(np.array([x0, y0]) + share * np.array([x1 - x0, y1 - y0]))
    walls = np.concatenate(flat)
    standing = _raised(walls, np.arange(SPACING_M / 2, HEIGHT_M, SPACING_M))
    across, along = (np.arange(SPACING_M / 2, size, SPACING_M) for size in (room.wide, room.deep))
    floor = np.stack(np.meshgrid(across, along), axis=-1).reshape(-1, 2)
    floor = floor[room.inside(floor)]
    low = floor[:, 0] > room.step_x
    points = [standing, np.column_stack((floor, np.where(low, -room.lower, 0.0)))]
    if room.lower:
        edge = np.column_stack((np.full(len(along), room.step_x), along))
        below = np.concatenate((walls[walls[:, 0] > room.step_x], edge[room.inside(edge)]))
        points.append(_raised(below, np.arange(-SPACING_M / 2, -room.lower, -SPACING_M)))
    near = np.concatenate(points)
    near = near[np.hypot(near[:, 0] - x, near[:, 1] - y) <= sight_m]
    return Cloud(near.astype(np.float32), origin_m=None)


def _raised(places: Points, levels: NDArray[np.float64]) -> Points:
    """Every place (n, 2) on every level (m,): (n · m, 3)."""
    return np.concatenate((np.repeat(places, len(levels), axis=0), np.tile(levels, len(places))[:, None]), axis=1)


def raised(T: Transform) -> Transform:
    """The pose of the sensor above the floor."""
    matrix = T.matrix.copy()
    matrix[2, 3] += SENSOR_M
    return Transform(matrix)
