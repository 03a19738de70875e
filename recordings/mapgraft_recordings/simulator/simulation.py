"""Robots with lidars in a world, as one stream of readings in time order."""

from __future__ import annotations

import heapq
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import SCAN, Observation, Scan, Transform
from mapgraft_recordings.simulator.driving import Limits, Poses, Trajectory, Waypoint, drive
from mapgraft_recordings.simulator.estimation import (
    OdometryError,
    SlamError,
    in_frame,
    inverse,
    odometry_poses,
    slam_poses,
)
from mapgraft_recordings.simulator.lidar import Lidar
from mapgraft_recordings.simulator.world import World

Pose = tuple[float, float, float]  # x, y in metres, yaw in radians

START_NS = 1_700_000_000_000_000_000

_LIMITS, _SLAM_ERROR, _ODOMETRY_ERROR = Limits(), SlamError(), OdometryError()


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot to simulate.

    ``T_world_map`` is where its own map frame lies, which nobody tells it. ``pose_rate_hz`` is how often it says where
    it is; ``scan_delay_s`` shifts its scans against its poses. With ``loop`` it drives its route over and over.
    """

    name: str
    lidar: Lidar
    route: tuple[Waypoint, ...]
    limits: Limits = _LIMITS
    start_yaw_rad: float = 0.0
    T_world_map: Pose = (0.0, 0.0, 0.0)
    slam_error: SlamError = _SLAM_ERROR
    odometry_error: OdometryError = _ODOMETRY_ERROR
    pose_rate_hz: float = 10.0
    scan_delay_s: float = 0.037
    loop: bool = False


class Reading(NamedTuple):
    """What a robot knows, and what is true, at one moment; poses are (x, y, yaw).

    ``T_world_base`` is the truth; ``T_map_base`` what its SLAM says and ``T_odom_base`` what its odometry says.
    ``speed_m_s`` and ``turn_rad_s`` are true. ``ranges_m`` (n,) float32 is the scan taken at that moment, or None.
    """

    robot: str
    stamp_ns: int
    T_world_base: Pose
    T_map_base: Pose
    T_odom_base: Pose
    speed_m_s: float
    turn_rad_s: float
    ranges_m: NDArray[np.float32] | None = None


def simulate(world: World, robots: Sequence[Robot], seed: int, duration_s: float) -> Iterator[Reading]:
    """All robots' readings in time order, made while they are asked for.

    Every robot has its own streams of noise, so that adding a robot or lengthening the run changes no other reading.
    Stamps count from ``START_NS``.
    """
    each = [_readings(world, robot, seed, duration_s) for robot in robots]
    return heapq.merge(*each, key=lambda reading: reading.stamp_ns)


def trajectory_of(robot: Robot, duration_s: float) -> Trajectory:
    """The robot's true way through the world."""
    return drive(robot.route, robot.limits, duration_s, robot.start_yaw_rad, robot.loop)


def observations(robots: Sequence[Robot], readings: Iterable[Reading]) -> Iterator[Observation]:
    """The scans among the readings as observations placed by SLAM poses, as reading a file would give them."""
    by_name = {robot.name: robot for robot in robots}
    directions = {}
    for robot in robots:
        angles = robot.lidar.angles_rad()
        directions[robot.name] = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    for reading in readings:
        if reading.ranges_m is None:
            continue
        lidar = by_name[reading.robot].lidar
        ranges, hits = reading.ranges_m.copy(), np.isfinite(reading.ranges_m)
        ranges[np.isposinf(ranges)] = lidar.range_max_m
        ranges[ranges < lidar.range_min_m] = np.nan
        T_map_base = Transform.planar(*reading.T_map_base)
        yield Observation(
            robot=reading.robot,
            stamp_ns=reading.stamp_ns,
            recorded_ns=reading.stamp_ns,
            sensor=f"/{reading.robot}/scan",
            kind=SCAN,
            payload=Scan(directions[reading.robot], ranges, hits, _sensor_motion(lidar, reading)),
            T_map_sensor=T_map_base @ lidar.mount.T_base_sensor,
            T_map_base=T_map_base,
        )


def _sensor_motion(lidar: Lidar, reading: Reading) -> NDArray[np.float64] | None:
    """Where the sensor was when each beam was fired, seen from where it was at the first (n, 3), at constant speed."""
    if lidar.sweep_s == 0.0:
        return None
    times_s = lidar.time_increment_s * np.arange(lidar.beams)
    turned = reading.turn_rad_s * times_s
    moved = np.tile(np.eye(4), (lidar.beams, 1, 1))
    moved[:, 0, 0], moved[:, 0, 1] = np.cos(turned), -np.sin(turned)
    moved[:, 1, 0], moved[:, 1, 1] = np.sin(turned), np.cos(turned)
    moved[:, 0, 3] = reading.speed_m_s * times_s * np.cos(turned / 2)
    moved[:, 1, 3] = reading.speed_m_s * times_s * np.sin(turned / 2)
    T_base_sensor = lidar.mount.T_base_sensor
    seen = T_base_sensor.inverse().matrix @ moved @ T_base_sensor.matrix
    return np.stack((seen[:, 0, 3], seen[:, 1, 3], np.arctan2(seen[:, 1, 0], seen[:, 0, 0])), axis=1)


def _readings(world: World, robot: Robot, seed: int, duration_s: float) -> Iterator[Reading]:
    slam_rng, odometry_rng, lidar_rng = _streams(seed, robot.name)
    trajectory = trajectory_of(robot, duration_s + 1.0)
    pose_times = np.arange(int(duration_s * robot.pose_rate_hz) + 1) / robot.pose_rate_hz
    scan_times = np.arange(int(duration_s * robot.lidar.rate_hz)) / robot.lidar.rate_hz + robot.scan_delay_s
    scan_times = scan_times[scan_times + robot.lidar.sweep_s <= pose_times[-1]]
    times = np.concatenate((pose_times, scan_times))
    order = np.argsort(times, kind="stable")
    times, is_scan = times[order], (order >= len(pose_times)).tolist()

    truth = trajectory.at(pose_times)
    believed = slam_poses(truth, 1.0 / robot.pose_rate_hz, robot.slam_error, slam_rng)
    rolled = odometry_poses(truth, robot.odometry_error, odometry_rng)
    T_map_base = in_frame(inverse(np.array(robot.T_world_map)), _between(pose_times, believed, times))
    columns = (trajectory.at(times), T_map_base, _between(pose_times, rolled, times), trajectory.speeds_at(times))
    rows = zip(times.tolist(), is_scan, *(column.tolist() for column in columns), strict=True)
    for time_s, scans, world_base, map_base, odom_base, (speed, turning) in rows:
        ranges = robot.lidar.sense(world.segments, trajectory, time_s, lidar_rng) if scans else None
        stamp_ns = START_NS + round(time_s * 1e9)
        poses = (tuple(world_base), tuple(map_base), tuple(odom_base))
        yield Reading(robot.name, stamp_ns, *poses, speed, turning, ranges)


def _between(known_s: NDArray[np.float64], poses: Poses, times_s: NDArray[np.float64]) -> Poses:
    return np.stack([np.interp(times_s, known_s, poses[:, i]) for i in range(3)], axis=1)


def _streams(seed: int, name: str) -> list[np.random.Generator]:
    root = np.random.SeedSequence([seed, zlib.crc32(name.encode())])
    return [np.random.default_rng(child) for child in root.spawn(3)]
