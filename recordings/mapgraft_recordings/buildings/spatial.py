"""Drives with a lidar of several rings: walls go up to the ceiling, things end below it, there is a floor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft.contracts import CLOUD, Cloud, Observation, Transform
from mapgraft_recordings.buildings.building import Building
from mapgraft_recordings.buildings.driving import drifted, stops, streams
from mapgraft_recordings.buildings.sensing import People
from mapgraft_recordings.buildings.shapes import Segments
from mapgraft_recordings.simulator.raycast import unit_vectors

_SALT = 0x3D11
_DOOR_M = 2.0
_CEILINGS_M = (2.4, 3.6)
_THINGS_M = (0.35, 1.9)
_PERSON_M = 1.0  # legs and body are one column here


@dataclass(frozen=True, slots=True)
class SpinningLidar:
    """A lidar that turns about the vertical: ``rings`` evenly from ``low_rad`` to ``high_rad``, ``columns`` per turn.

    It sits ``height_m`` above the floor, in the robot's middle. ``lost`` is the share of points that never come back.
    """

    rings: int = 16
    columns: int = 360
    low_rad: float = math.radians(-15.0)
    high_rad: float = math.radians(15.0)
    max_m: float = 30.0
    noise_m: float = 0.015
    lost: float = 0.01
    height_m: float = 0.6

    @property
    def T_base_sensor(self) -> Transform:
        return Transform.from_quaternion((0.0, 0.0, self.height_m), (0.0, 0.0, 0.0, 1.0))

    def slopes(self) -> NDArray[np.float64]:
        """How far each ring (n,) rises per metre of way along the floor."""
        return np.tan(np.linspace(self.low_rad, self.high_rad, self.rings))


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """One turn of the lidar: when, from where in truth (x, y, yaw), and its points (rings, columns, 3) in its frame.

    Points that did not come back are NaN.
    """

    stamp_ns: int
    pose: tuple[float, float, float]
    points_m: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class SpatialDrive:
    """A drive with its truth: ``believed`` (n, 3) are the poses as SLAM has them, in the building's frame."""

    lidar: SpinningLidar
    sweeps: tuple[Sweep, ...]
    believed: NDArray[np.float64]


def record_spatial(
    building: Building, seed: int, sweeps: int = 100, lidar: SpinningLidar | None = None
) -> SpatialDrive:
    """One drive with a spinning lidar. The same building and seed give the same points.

    It goes the way that ``record`` goes with the seed. Raises ConfigError where the building has no room to drive.
    """
    lidar, random = lidar or SpinningLidar(), streams(building, seed)
    heights = Heights.of(building)
    people = People(building.traits.people, random.world)
    found = []
    for stop in stops(building, sweeps, random):
        legs = people.legs(stop.pose)
        seen = np.vstack((stop.solid, legs))
        tops = np.concatenate((heights.tops(stop.solid), np.full(len(legs), heights.ceiling_m - _PERSON_M)))
        points = turn_of(lidar, stop.pose, seen, tops, heights.ceiling_m, random.sensor)
        found.append(Sweep(stop.stamp_ns, stop.pose, points))
    poses = np.array([sweep.pose for sweep in found])
    return SpatialDrive(lidar, tuple(found), drifted(poses, random.poses))


def spatial_observations(made: SpatialDrive, robot: str = "robot") -> list[Observation]:
    """A drive as observations."""
    found = []
    for sweep, (x, y, yaw) in zip(made.sweeps, made.believed.tolist(), strict=True):
        points = sweep.points_m.reshape(-1, 3)
        seen = np.isfinite(points).all(axis=1)
        cloud = Cloud(np.ascontiguousarray(points[seen]), dropped=int(np.count_nonzero(~seen)))
        T_map_base = Transform.planar(x, y, yaw)
        T_map_sensor = T_map_base @ made.lidar.T_base_sensor
        found.append(
            Observation(robot, sweep.stamp_ns, sweep.stamp_ns, "lidar", CLOUD, cloud, T_map_sensor, T_map_base)
        )
    return found


@dataclass(frozen=True, slots=True)
class Heights:
    """How high things reach in one building; each thing has a height of its own that stays."""

    ceiling_m: float
    seed: int
    walls: int
    fixed: int
    doors: int

    @classmethod
    def of(cls, building: Building) -> Heights:
        rng = np.random.default_rng(np.random.SeedSequence([building.seed, _SALT]))
        ceiling_m = float(rng.uniform(*_CEILINGS_M))
        walls = sum(len(outline) for outline in building.walls)
        return cls(ceiling_m, building.seed, walls, len(building.solid), len(building.leaves))

    def tops(self, solid: Segments) -> NDArray[np.float64]:
        """The upper edge (m,) of segments as they stand: walls, fixed things, doors, loose things, in this order."""
        tops = np.full(len(solid), self.ceiling_m)
        fixed, rest = outlines_of(solid[self.walls : self.fixed]), outlines_of(solid[self.fixed :])
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, _SALT, 1]))
        drawn = rng.uniform(*_THINGS_M, fixed.max(initial=-1) + 1)
        tops[self.walls : self.fixed] = drawn[fixed]
        drawn = np.random.default_rng(np.random.SeedSequence([self.seed, _SALT, 2])).uniform(
            *_THINGS_M, rest.max(initial=-1) + 1
        )
        drawn[: self.doors] = min(_DOOR_M, self.ceiling_m)
        tops[self.fixed :] = drawn[rest]
        return tops


def outlines_of(segments: Segments) -> NDArray[np.int64]:
    """To which outline each segment (m,) belongs: one ends where its last corner is its first again."""
    numbers = np.zeros(len(segments), np.int64)
    for k, (before, after) in enumerate(pairwise(segments)):
        numbers[k + 1] = numbers[k] + int(before[2] != after[0] or before[3] != after[1])
    return numbers


def turn_of(
    lidar: SpinningLidar,
    pose: tuple[float, float, float],
    segments: Segments,
    tops: NDArray[np.float64],
    ceiling_m: float,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """One turn at a pose: points (rings, columns, 3) in the lidar's frame, NaN where nothing came back.

    ``segments`` (m, 4) stand upright from the floor to ``tops`` (m,), under a ceiling.
    """
    x, y, yaw = pose
    bearings = 2.0 * math.pi * np.arange(lidar.columns) / lidar.columns
    ahead = unit_vectors(bearings + yaw)
    slopes = lidar.slopes()
    near = _near(x, y, segments, lidar.max_m)
    away = cast_rings(x, y, lidar.height_m, ahead, slopes, segments[near], tops[near], ceiling_m)
    ranges = away * np.sqrt(1.0 + slopes**2)[:, None]
    measured = ranges + rng.normal(0.0, lidar.noise_m, ranges.shape)
    measured[(ranges > lidar.max_m) | (rng.random(ranges.shape) < lidar.lost)] = np.nan
    along = measured / np.sqrt(1.0 + slopes**2)[:, None]
    own = unit_vectors(bearings)
    points = np.stack((along * own[:, 0], along * own[:, 1], along * slopes[:, None]), axis=2)
    return points.astype(np.float32)


def _near(x: float, y: float, segments: Segments, reach_m: float) -> NDArray[np.intp]:
    low = np.minimum(segments[:, :2], segments[:, 2:])
    high = np.maximum(segments[:, :2], segments[:, 2:])
    here = np.array([x, y])
    return np.flatnonzero(((low <= here + reach_m) & (high >= here - reach_m)).all(axis=1))


@njit(cache=True)
def cast_rings(
    x_m: float,
    y_m: float,
    z_m: float,
    directions: NDArray[np.float64],
    slopes: NDArray[np.float64],
    segments: Segments,
    tops_m: NDArray[np.float64],
    ceiling_m: float,
) -> NDArray[np.float64]:
    """The way along the floor (rings, columns) to the first thing, floor or ceiling that a beam meets.

    ``directions`` (columns, 2) unit vectors, ``slopes`` (rings,) rise per metre, ``segments`` (m, 4) upright things
    that reach from the floor to ``tops_m`` (m,).
    """
    out = np.empty((slopes.size, directions.shape[0]))
    for ring in range(slopes.size):
        slope = slopes[ring]
        end = np.inf
        if slope < 0.0:
            end = -z_m / slope
        elif slope > 0.0:
            end = (ceiling_m - z_m) / slope
        out[ring, :] = end
    for column in range(directions.shape[0]):
        dx, dy = directions[column, 0], directions[column, 1]
        for j in range(segments.shape[0]):
            ex, ey = segments[j, 2] - segments[j, 0], segments[j, 3] - segments[j, 1]
            denominator = dx * ey - dy * ex
            if denominator == 0.0:
                continue
            wx, wy = segments[j, 0] - x_m, segments[j, 1] - y_m
            s = (wx * dy - wy * dx) / denominator
            if s < 0.0 or s > 1.0:
                continue
            t = (wx * ey - wy * ex) / denominator
            if t < 0.0:
                continue
            for ring in range(slopes.size):
                if t < out[ring, column] and z_m + slopes[ring] * t <= tops_m[j]:
                    out[ring, column] = t
    return out
