"""Simulated robots: true to their world, the same for a seed, bounded in what SLAM and odometry get wrong."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from mapgraft.contracts import Scan, Transform
from mapgraft_recordings.simulator import (
    START_NS,
    Lidar,
    Limits,
    Mount,
    OdometryError,
    Robot,
    SlamError,
    Waypoint,
    World,
    build_world,
    distance_to_walls,
    drive,
    observations,
    parse_plan,
    ros_messages,
    simulate,
    trajectory_of,
)

EXACT = SlamError(0.0, 0.0)
ROUTE = (Waypoint(1, 1), Waypoint(6, 1), Waypoint(6, 3.5), Waypoint(1.5, 3.5, 2.0), Waypoint(1.5, 1.5))


@pytest.fixture(scope="module")
def world() -> World:
    walls = [{"line": [[0, 0], [8, 0], [8, 5], [0, 5], [0, 0]], "doors": [{"at_m": 10.5, "width_m": 1.0}]}]
    furniture = [{"name": "block", "box": [3, 2, 1, 0.6], "yaw_deg": 20}]
    return build_world(parse_plan({"name": "box", "floor": {"walls": walls, "furniture": furniture}}), seed=0)


def robot_with(lidar: Lidar, **changes: object) -> Robot:
    robot = Robot("alpha", lidar, ROUTE, T_world_map=(2.0, -1.0, 0.7), slam_error=EXACT)
    return replace(robot, **changes)


def lidar_with(**changes: object) -> Lidar:
    lidar = Lidar(181, math.pi, 0.1, 6.0, 2.0, noise_sigma_m=0.0, mount=Mount(0.2, 0.1, 0.3, 0.4))
    return replace(lidar, **changes)


@pytest.mark.parametrize(
    "lidar",
    [
        lidar_with(),
        lidar_with(mount=Mount(0.2, 0.1, 0.3, 0.4, upside_down=True)),
        lidar_with(beams=360, field_of_view_rad=2 * math.pi),
        lidar_with(sweep_s=0.1),
        lidar_with(sweep_s=0.1, mount=Mount(0.2, 0.1, 0.3, -0.4, upside_down=True)),
    ],
    ids=["upright", "upside down", "full turn", "sweeping", "sweeping upside down"],
)
def test_hits_placed_by_the_poses_lie_on_walls(world: World, lidar: Lidar) -> None:
    robot = robot_with(lidar, pose_rate_hz=20.0)  # as often as it steers: nothing is interpolated across a turn
    T_world_map = Transform.planar(*robot.T_world_map)
    seen = 0
    for observation in observations([robot], simulate(world, [robot], 0, 25.0)):
        assert isinstance(observation.payload, Scan)
        rays = observation.payload.rays(T_world_map @ observation.T_map_sensor)
        # half a millimetre of range rounding; a sweep is placed by speeds that change during it
        tolerance_m = 0.001 if lidar.sweep_s == 0.0 else 0.05
        assert distance_to_walls(rays.ends_m[rays.hits], world.segments).max() < tolerance_m
        seen += int(rays.hits.sum())
    assert seen > 2000


def test_a_sweep_smeared_over_a_turn_is_mended_by_its_beam_times(world: World) -> None:
    robot = robot_with(lidar_with(sweep_s=0.2))
    T_world_map = Transform.planar(*robot.T_world_map)
    worst_m = 0.0
    for observation in observations([robot], simulate(world, [robot], 0, 25.0)):
        assert isinstance(observation.payload, Scan)
        still = replace(observation.payload, T_sensor_beam=None).rays(T_world_map @ observation.T_map_sensor)
        worst_m = max(worst_m, distance_to_walls(still.ends_m[still.hits], world.segments).max())
    assert worst_m > 0.2


def test_ranges_follow_rep_117(world: World) -> None:
    lidar = lidar_with(range_max_m=3.0, noise_sigma_m=0.01, dropout=0.1)
    scans = [r.ranges_m for r in simulate(world, [robot_with(lidar)], 0, 25.0) if r.ranges_m is not None]
    ranges = np.concatenate(scans)
    assert ranges.dtype == np.float32
    assert np.isnan(ranges).mean() == pytest.approx(0.1, abs=0.01)
    assert np.isposinf(ranges).any()
    finite = ranges[np.isfinite(ranges)].astype(np.float64)
    assert finite.max() <= 3.0 + 1e-6
    assert np.abs(finite * 1000 - np.round(finite * 1000)).max() < 1e-3


def test_noise_has_the_size_it_says(world: World) -> None:
    robots = [robot_with(lidar_with(noise_sigma_m=sigma)) for sigma in (0.0, 0.03)]
    exact, noisy = (
        np.concatenate([r.ranges_m for r in simulate(world, [robot], 0, 25.0) if r.ranges_m is not None])
        for robot in robots
    )
    both = np.isfinite(exact) & np.isfinite(noisy)
    errors = noisy[both].astype(np.float64) - exact[both]
    assert errors.std() == pytest.approx(0.03, rel=0.05)
    assert abs(errors.mean()) < 0.002


def test_the_same_seed_gives_the_same_readings_and_another_does_not(world: World) -> None:
    robots = [robot_with(lidar_with(noise_sigma_m=0.01), slam_error=SlamError())]
    robots.append(replace(robots[0], name="bravo", scan_delay_s=0.011))

    def run(seed: int) -> list[tuple[object, ...]]:
        return [
            (*r[:-1], None if r.ranges_m is None else r.ranges_m.tobytes()) for r in simulate(world, robots, seed, 9)
        ]

    assert run(5) == run(5)
    assert run(5) != run(6)


def test_readings_come_in_time_order_and_do_not_depend_on_other_robots(world: World) -> None:
    alpha = robot_with(lidar_with(noise_sigma_m=0.01), slam_error=SlamError())
    bravo = replace(alpha, name="bravo", scan_delay_s=0.011)
    both = list(simulate(world, [alpha, bravo], 1, 10.0))
    stamps = [reading.stamp_ns for reading in both]
    assert stamps == sorted(stamps)
    assert stamps[0] == START_NS
    alone = list(simulate(world, [alpha], 1, 20.0))
    mine = [reading for reading in both if reading.robot == "alpha"]
    for a, b in zip(mine, islice(alone, len(mine)), strict=True):
        assert a[:-1] == b[:-1]
        assert (a.ranges_m is None and b.ranges_m is None) or np.array_equal(a.ranges_m, b.ranges_m, equal_nan=True)


def test_slam_errs_within_bounds_and_odometry_drifts(world: World) -> None:
    error = SlamError(0.02, 0.005)
    robot = robot_with(
        lidar_with(), slam_error=error, odometry_error=OdometryError(0.03, 0.05), loop=True, T_world_map=(0.0, 0.0, 0.0)
    )
    readings = list(simulate(world, [robot], 2, 300.0))
    truth, slam, odometry = (
        np.array([reading[k] for reading in readings])
        for k in (2, 3, 4)  # T_world_base, T_map_base, T_odom_base
    )
    errors = slam - truth
    assert errors[:, :2].std() == pytest.approx(0.02, rel=0.5)
    assert np.abs(errors[:, :2]).max() < 5 * 0.02
    assert np.abs(errors[:, 2]).max() < 5 * 0.005
    assert odometry[0] == pytest.approx((0, 0, 0))
    turned = truth[:, 2] - truth[0, 2]
    assert abs(odometry[-1, 2] - turned[-1]) > 10 * 0.005


def test_driving_keeps_its_limits_and_reaches_the_end() -> None:
    limits = Limits(speed_m_s=0.7, turn_rad_s=0.9)
    trajectory = drive(ROUTE, limits, 60.0, start_yaw_rad=math.pi)
    assert trajectory.speeds[:, 0].max() <= limits.speed_m_s + 1e-9
    assert np.abs(trajectory.speeds[:, 1]).max() <= limits.turn_rad_s + 1e-9
    changes = np.diff(trajectory.speeds, axis=0) / np.diff(trajectory.times_s)[:, None]
    assert np.abs(changes[:, 0]).max() <= limits.acceleration_m_s2 + 1e-9
    assert np.abs(changes[:, 1]).max() <= limits.turn_acceleration_rad_s2 + 1e-9
    assert np.linalg.norm(trajectory.poses[-1, :2] - (1.5, 1.5)) < 0.3
    for waypoint in ROUTE:
        assert np.hypot(trajectory.poses[:, 0] - waypoint.x_m, trajectory.poses[:, 1] - waypoint.y_m).min() < 0.45


def test_a_stop_is_a_stop() -> None:
    trajectory = drive((Waypoint(0, 0, 4.0), Waypoint(3, 0)), Limits(), 20.0, start_yaw_rad=0.0)
    assert (trajectory.poses[trajectory.times_s <= 4.0] == trajectory.poses[0]).all()
    assert trajectory.poses[-1, 0] == pytest.approx(3.0, abs=0.15)


def test_a_loop_never_ends(world: World) -> None:
    trajectory = trajectory_of(robot_with(lidar_with(), loop=True), 200.0)
    assert np.abs(np.diff(trajectory.poses[-400:, :2], axis=0)).sum() > 3.0


def test_messages_hold_what_the_robot_knows(world: World) -> None:
    robot = robot_with(lidar_with(mount=Mount(0.2, 0.0, 0.3, upside_down=True)))
    readings = list(simulate(world, [robot], 0, 3.0))
    messages = list(ros_messages([robot], readings))
    counts = {topic: sum(m.topic == topic for m in messages) for topic in sorted({m.topic for m in messages})}
    assert counts == {"/alpha/odom": 31, "/alpha/scan": 6, "/tf": 31, "/tf_static": 1}
    static = messages[0].fields["transforms"][0]
    assert static["transform"]["rotation"] == pytest.approx({"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0})
    for message in messages[1:]:
        assert message.stamp_ns >= START_NS
