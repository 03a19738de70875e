"""Robots driven along waypoints: speed limits, smooth turning, and what odometry and SLAM make of the way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Poses = NDArray[np.float64]  # (n, 3) x, y in metres, yaw in radians without jumps

_STEP_S = 0.05
_CARROT_STEP_M = 0.02
_ARRIVED_M = 0.08


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A place to drive by, in the world's frame; the robot stops there for ``wait_s`` when it is not 0."""

    x_m: float
    y_m: float
    wait_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Limits:
    """How fast a robot drives, turns, speeds up and brakes; it steers to a point ``lookahead_m`` ahead on its way."""

    speed_m_s: float = 0.6
    acceleration_m_s2: float = 0.5
    turn_rad_s: float = 1.0
    turn_acceleration_rad_s2: float = 2.0
    lookahead_m: float = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Where a robot truly was: ``times_s`` (n,), ``poses`` (n, 3) in the world, ``speeds`` (n, 2) in m/s and rad/s."""

    times_s: NDArray[np.float64]
    poses: Poses
    speeds: NDArray[np.float64]

    def at(self, times_s: NDArray[np.float64]) -> Poses:
        """Poses (k, 3) at any times; before the start and after the end the robot stands still."""
        return np.stack([np.interp(times_s, self.times_s, self.poses[:, i]) for i in range(3)], axis=1)

    def speeds_at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Forward speed and turn rate (k, 2) at any times."""
        return np.stack([np.interp(times_s, self.times_s, self.speeds[:, i]) for i in range(2)], axis=1)


def drive(
    route: Sequence[Waypoint], limits: Limits, duration_s: float, start_yaw_rad: float, loop: bool = False
) -> Trajectory:
    """Follow the way for ``duration_s``; at its end the robot stands still, or starts over when ``loop`` is True.

    The robot starts at the first waypoint. It is a unicycle that steers towards a point ahead on the way (pure
    pursuit) and turns on the spot when that point lies behind it.
    """
    steps = math.ceil(duration_s / _STEP_S) + 1
    poses, speeds = np.empty((steps, 3)), np.empty((steps, 2))
    legs = _legs(route, loop)
    follower = _Follower(route[0].x_m, route[0].y_m, start_yaw_rad, limits)
    leg, wait_s = 0, route[0].wait_s
    for k in range(steps):
        poses[k] = follower.x, follower.y, follower.yaw
        speeds[k] = follower.speed, follower.turning
        if wait_s > 0.0 or leg >= len(legs):
            follower.halt()
            wait_s -= _STEP_S
            continue
        if follower.follow(legs[leg][0]):
            wait_s = legs[leg][1]
            leg = (leg + 1) % len(legs) if loop else leg + 1
    return Trajectory(np.arange(steps, dtype=np.float64) * _STEP_S, poses, speeds)


def _legs(route: Sequence[Waypoint], loop: bool) -> list[tuple[NDArray[np.float64], float]]:
    """The way cut at its stops: dense points (n, 2) of every leg, and how long to wait at its end."""
    stops = [*route, route[0]] if loop else list(route)
    legs = []
    corners = [(stops[0].x_m, stops[0].y_m)]
    for index, stop in enumerate(stops[1:], start=1):
        corners.append((stop.x_m, stop.y_m))
        if stop.wait_s > 0.0 or index == len(stops) - 1:
            legs.append((dense_line(np.array(corners), _CARROT_STEP_M), stop.wait_s))
            corners = corners[-1:]
    return legs


def dense_line(corners: NDArray[np.float64], step_m: float) -> NDArray[np.float64]:
    """Points (n, 2) along a polyline (k, 2), at most ``step_m`` apart, both ends included."""
    pieces = [corners[:1]]
    for a, b in pairwise(corners):
        count = max(1, math.ceil(math.dist(a, b) / step_m))
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.vstack(pieces)


class _Follower:
    """A unicycle on its way along one leg."""

    def __init__(self, x: float, y: float, yaw: float, limits: Limits) -> None:
        self.x, self.y, self.yaw = x, y, yaw
        self.speed = self.turning = 0.0
        self._limits = limits
        self._carrot = 0

    def halt(self) -> None:
        self._move(0.0, 0.0)

    def follow(self, line: NDArray[np.float64]) -> bool:
        """One step along the leg; True when its end is reached, and the next leg may begin."""
        last = len(line) - 1
        reach = self._limits.lookahead_m
        while self._carrot < last and math.hypot(*(line[self._carrot] - (self.x, self.y))) < reach:
            self._carrot += 1
        dx, dy = float(line[self._carrot][0]) - self.x, float(line[self._carrot][1]) - self.y
        error = math.remainder(math.atan2(dy, dx) - self.yaw, 2.0 * math.pi)
        left_m = (last - self._carrot) * _CARROT_STEP_M + math.hypot(dx, dy)
        if self._carrot == last and (left_m < _ARRIVED_M or (left_m < reach and abs(error) > math.pi / 2)):
            self._carrot = 0
            return True
        limit = self._limits
        towards = max(0.0, math.cos(error)) ** 3
        speed = min(limit.speed_m_s * towards, math.sqrt(2.0 * limit.acceleration_m_s2 * left_m))
        self._move(speed, max(-limit.turn_rad_s, min(limit.turn_rad_s, 2.5 * error)))
        return False

    def _move(self, speed: float, turning: float) -> None:
        faster, sharper = (
            self._limits.acceleration_m_s2 * _STEP_S,
            self._limits.turn_acceleration_rad_s2 * _STEP_S,
        )
        self.speed += max(-faster, min(faster, speed - self.speed))
        self.turning += max(-sharper, min(sharper, turning - self.turning))
        middle = self.yaw + 0.5 * self.turning * _STEP_S
        self.x += self.speed * _STEP_S * math.cos(middle)
        self.y += self.speed * _STEP_S * math.sin(middle)
        self.yaw += self.turning * _STEP_S
