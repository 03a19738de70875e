"""Ray casting against line segments: arrays in, arrays out, the same bits whichever way a beam is found.

A beam from ``o`` along the unit vector ``d`` meets the segment from ``a`` to ``b`` where ``o + t d = a + s (b - a)``
with ``t >= 0`` and ``0 <= s <= 1``. Both functions use this one formula, so they agree bit for bit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Segments = NDArray[np.float64]  # (m, 4) x_a, y_a, x_b, y_b in metres
Directions = NDArray[np.float64]  # (n, 2) unit vectors
Ranges = NDArray[np.float64]  # (n,) metres, inf where the beam meets nothing

_SEAM = 1e-9  # how far beyond its ends a segment still stops a beam, as a share of its length: no leaks at corners
_TOUCHING = 1e-6  # m², (1 mm)²: the origin lies on the segment


@njit(cache=True, inline="always")
def _meet(ox: float, oy: float, dx: float, dy: float, ax: float, ay: float, bx: float, by: float) -> float:
    ex, ey = bx - ax, by - ay
    denominator = dx * ey - dy * ex
    if denominator == 0.0:
        return np.inf
    wx, wy = ax - ox, ay - oy
    s = (wx * dy - wy * dx) / denominator
    if s < -_SEAM or s > 1.0 + _SEAM:
        return np.inf
    t = (wx * ey - wy * ex) / denominator
    return t if t >= 0.0 else np.inf


@njit(cache=True)
def unit_vectors(bearings_rad: NDArray[np.float64]) -> Directions:
    """Unit vectors (n, 2) along bearings (n,), with the same ``cos`` and ``sin`` on every instruction set."""
    directions = np.empty((bearings_rad.shape[0], 2))
    for i in range(bearings_rad.shape[0]):
        directions[i, 0] = math.cos(bearings_rad[i])
        directions[i, 1] = math.sin(bearings_rad[i])
    return directions


@njit(cache=True)
def cast_rays(origins_m: NDArray[np.float64], directions: Directions, segments: Segments, max_m: float) -> Ranges:
    """Distance along every beam, each from its own origin, to the nearest segment: every beam against every segment.

    ``origins_m`` (n, 2) and ``directions`` (n, 2) in the frame of ``segments`` (m, 4); inf beyond ``max_m``.
    """
    ranges = np.full(directions.shape[0], np.inf)
    for i in range(directions.shape[0]):
        nearest = np.inf
        for j in range(segments.shape[0]):
            t = _meet(
                origins_m[i, 0],
                origins_m[i, 1],
                directions[i, 0],
                directions[i, 1],
                segments[j, 0],
                segments[j, 1],
                segments[j, 2],
                segments[j, 3],
            )
            nearest = min(nearest, t)
        if nearest <= max_m:
            ranges[i] = nearest
    return ranges


@njit(cache=True)
def cast_fan(
    x_m: float,
    y_m: float,
    first_rad: float,
    increment_rad: float,
    directions: Directions,
    segments: Segments,
    max_m: float,
) -> Ranges:
    """Distance along every beam of a fan from one point: every segment against the beams that can meet it.

    Beam *i* points to ``first_rad + i * increment_rad`` (negative increments turn clockwise), and ``directions``
    (n, 2) is that bearing as unit vectors; the fan spans at most a full turn. Equal, bit for bit, to ``cast_rays``.
    """
    n = directions.shape[0]
    ranges = np.full(n, np.inf)
    turn = 2.0 * math.pi / abs(increment_rad)  # beams in a full turn
    for j in range(segments.shape[0]):
        ax, ay, bx, by = segments[j, 0], segments[j, 1], segments[j, 2], segments[j, 3]
        squared = _distance_squared(x_m, y_m, ax, ay, bx, by)
        if squared > max_m * max_m * (1.0 + 1e-9):
            continue
        start = (math.atan2(ay - y_m, ax - x_m) - first_rad) / increment_rad
        width = (math.atan2(by - y_m, bx - x_m) - first_rad) / increment_rad - start
        width -= turn * math.floor(width / turn + 0.5)
        if width < 0.0:
            start, width = start + width, -width
        if squared < _TOUCHING or width > 0.5 * turn - 1.0:  # bearings mean little from (nearly) on the segment
            start, width = 0.0, turn
        start -= turn * math.floor(start / turn)
        for k in range(-1, 2):  # the same window one turn earlier and later, with a beam to spare on both sides
            first = max(0, math.floor(start + k * turn) - 1)
            last = min(n - 1, math.ceil(start + width + k * turn) + 1)
            for i in range(first, last + 1):
                t = _meet(x_m, y_m, directions[i, 0], directions[i, 1], ax, ay, bx, by)
                if t < ranges[i] and t <= max_m:
                    ranges[i] = t
    return ranges


@njit(cache=True, inline="always")
def _distance_squared(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    ex, ey = bx - ax, by - ay
    length_squared = ex * ex + ey * ey
    s = 0.0
    if length_squared > 0.0:
        s = min(1.0, max(0.0, ((px - ax) * ex + (py - ay) * ey) / length_squared))
    dx, dy = ax + s * ex - px, ay + s * ey - py
    return dx * dx + dy * dy


@njit(cache=True)
def distance_to_walls(points_m: NDArray[np.float64], segments: Segments) -> NDArray[np.float64]:
    """Distance of every point (n, 2) to the nearest segment (m, 4), metres (n,)."""
    distances = np.full(points_m.shape[0], np.inf)
    for i in range(points_m.shape[0]):
        nearest = np.inf
        for j in range(segments.shape[0]):
            squared = _distance_squared(
                points_m[i, 0], points_m[i, 1], segments[j, 0], segments[j, 1], segments[j, 2], segments[j, 3]
            )
            nearest = min(nearest, squared)
        distances[i] = math.sqrt(nearest)
    return distances
