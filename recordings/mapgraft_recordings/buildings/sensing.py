"""What a planar lidar reports in a building: glass, people, edges between two things, noise, lost beams."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Scan
from mapgraft_recordings.buildings.shapes import Segments
from mapgraft_recordings.simulator.raycast import cast_fan, unit_vectors

_EDGE_M = 0.25


@dataclass(frozen=True, slots=True)
class Sensor:
    """A lidar on the robot's middle; ``field_rad`` from the first beam to the last.

    ``step_m`` is the resolution of its ranges; ``edge`` the share of beams at the edge of a thing that report a range
    between the thing and what is behind it; ``outliers`` of any nearer range, ``lost`` of none at all, ``faint`` of
    no return where there was something.
    """

    beams: int
    field_rad: float
    max_m: float
    noise_m: float
    step_m: float
    edge: float
    outliers: float
    lost: float
    faint: float

    @property
    def increment_rad(self) -> float:
        return self.field_rad / (self.beams - 1)

    def directions(self) -> NDArray[np.float64]:
        """Unit vectors (n, 2) of the beams in the sensor's frame."""
        return unit_vectors(np.arange(self.beams, dtype=np.float64) * self.increment_rad - self.field_rad / 2)


def draw_sensor(rng: np.random.Generator) -> Sensor:
    """A lidar: most see half a circle, as the lidars of most public logs do."""
    beams, degrees = _LAYOUTS[int(rng.choice(len(_LAYOUTS), p=_SHARES))]
    return Sensor(
        beams=beams,
        field_rad=math.radians(degrees),
        max_m=float(rng.choice(_REACHES_M, p=_REACH_SHARES)),
        noise_m=float(rng.uniform(0.005, 0.03)),
        step_m=float(rng.choice([0.001, 0.01, 0.05], p=[0.3, 0.5, 0.2])),
        edge=float(rng.uniform(0.0, 0.4)),
        outliers=float(rng.choice([0.0, rng.uniform(0.0, 0.003)])),
        lost=float(rng.choice([0.0, rng.uniform(0.0, 0.01)])),
        faint=float(rng.choice([0.0, rng.uniform(0.0, 0.02)])),
    )


_LAYOUTS = ((180, 179.0), (181, 180.0), (360, 179.5), (361, 180.0), (541, 270.0), (360, 359.0), (720, 359.5))
_SHARES = (0.4, 0.14, 0.14, 0.12, 0.08, 0.08, 0.04)
_REACHES_M = (8.0, 12.0, 20.0, 30.0, 50.0, 80.0)
_REACH_SHARES = (0.1, 0.1, 0.15, 0.2, 0.2, 0.25)


def sense(
    sensor: Sensor,
    pose: tuple[float, float, float],
    solid: Segments,
    glass: Segments,
    reflects: float,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Ranges (n,) in metres from a true pose: inf where nothing came back, NaN where a beam was lost."""
    x, y, yaw = pose
    first = yaw - sensor.field_rad / 2
    directions = unit_vectors(first + sensor.increment_rad * np.arange(sensor.beams, dtype=np.float64))
    ranges = cast_fan(x, y, first, sensor.increment_rad, directions, solid, sensor.max_m)
    if len(glass):
        panes = cast_fan(x, y, first, sensor.increment_rad, directions, glass, sensor.max_m)
        seen = (panes < ranges) & (rng.random(sensor.beams) < reflects)
        ranges = np.where(seen, panes, ranges)
    ranges = _edges(ranges, sensor, rng)
    ranges = ranges + rng.normal(0.0, sensor.noise_m, sensor.beams)
    near = rng.random(sensor.beams) < sensor.outliers
    ranges[near] = rng.uniform(0.1, np.minimum(ranges[near], sensor.max_m))
    ranges = np.round(np.maximum(ranges, 0.02) / sensor.step_m) * sensor.step_m
    ranges[(ranges >= sensor.max_m) | (rng.random(sensor.beams) < sensor.faint)] = np.inf
    ranges[rng.random(sensor.beams) < sensor.lost] = np.nan
    return ranges.astype(np.float32)


def _edges(ranges: NDArray[np.float64], sensor: Sensor, rng: np.random.Generator) -> NDArray[np.float64]:
    """Some beams that graze an edge report a mixture of both ranges."""
    reach = np.minimum(ranges, sensor.max_m)
    jump = np.diff(reach)
    mixed = np.flatnonzero((np.abs(jump) > _EDGE_M) & (np.abs(jump) < 4.0) & (rng.random(len(jump)) < sensor.edge))
    share = rng.random(len(mixed))
    blended = ranges.copy()
    blended[mixed] = reach[mixed] + share * jump[mixed]
    return blended


def as_scan(sensor: Sensor, directions: NDArray[np.float64], ranges: NDArray[np.float32]) -> Scan:
    """Reported ranges as the engine has them: no return is free up to the longest range."""
    hits = np.isfinite(ranges)
    return Scan(directions, np.where(np.isposinf(ranges), np.float32(sensor.max_m), ranges), hits)


class People:
    """Persons who walk or stand about near the robot, as the two legs each that a low lidar sees."""

    def __init__(self, share: float, rng: np.random.Generator) -> None:
        self._share, self._rng = share, rng
        self._persons: list[list[float]] = []  # x, y, heading, metres per scan

    def legs(self, pose: tuple[float, float, float]) -> Segments:
        """The legs (m, 4) that stand around the pose now; persons never come closer than 0.6 m."""
        rng = self._rng
        if rng.random() < self._share:
            bearing, away = pose[2] + rng.normal(0.0, 0.8), rng.uniform(1.0, 6.0)
            speed = float(rng.choice([0.0, rng.uniform(0.2, 1.0)]))
            x, y = pose[0] + away * math.cos(bearing), pose[1] + away * math.sin(bearing)
            self._persons.append([x, y, float(rng.uniform(-math.pi, math.pi)), speed])
        found = []
        staying = []
        for x, y, heading, speed in self._persons:
            x, y = x + speed * math.cos(heading), y + speed * math.sin(heading)
            if rng.random() < 0.2 or math.hypot(x - pose[0], y - pose[1]) < 0.6:
                continue
            staying.append([x, y, heading, speed])
            stride = float(rng.uniform(0.08, 0.2))
            sides = (-stride, stride)
            found += [_leg(x - side * math.sin(heading), y + side * math.cos(heading), 0.06) for side in sides]
        self._persons = staying
        return np.vstack(found) if found else np.empty((0, 4))


def _leg(x: float, y: float, radius: float) -> Segments:
    bearing = 2.0 * math.pi * np.arange(6) / 6
    ring = np.stack((np.cos(bearing), np.sin(bearing)), axis=1) * radius + (x, y)
    return np.hstack((ring, np.roll(ring, -1, axis=0)))
