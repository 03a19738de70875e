"""The demo recording: as the script makes it, small, true to its world, and shipped with the package."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from mapgraft.config import load_config
from mapgraft.contracts import ConfigError, Transform
from mapgraft_recordings import demo_files
from mapgraft_recordings.generate import DEMO, generate, main
from mapgraft_recordings.mission import Mission, build_mission, load_mission_plan
from mapgraft_recordings.simulator import Trajectory, distance_to_walls, load_plan, trajectory_of

SEEDS = range(5)


class Made(NamedTuple):
    mission: Mission
    paths: list[Path]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return Made(*generate(0, tmp_path_factory.mktemp("demo")))


def messages(path: Path, topic: str) -> Iterator[Any]:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("rb") as stream:
        for schema, _, message in make_reader(stream).iter_messages(topics=[topic]):
            assert schema is not None
            yield store.deserialize_cdr(message.data, schema.name)


def pose_of(transform: Any) -> Transform:
    t, q = transform.translation, transform.rotation
    return Transform.from_quaternion((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(made: Made, tmp_path: Path) -> None:
    again = generate(0, tmp_path / "again")[1]
    other = generate(1, tmp_path / "other")[1]
    for first, second, third in zip(made.paths, again, other, strict=True):
        assert first.read_bytes() == second.read_bytes()
        assert first.read_bytes() != third.read_bytes()


def test_the_shipped_recording_is_what_the_script_makes(made: Made) -> None:
    shipped, _, _ = demo_files()
    assert [path.name for path in shipped] == [path.name for path in made.paths]
    for ours, fresh in zip(shipped, made.paths, strict=True):
        assert ours.stat().st_size < 3_000_000
        with ours.open("rb") as a, fresh.open("rb") as b:  # the messages: compressors of other versions pack otherwise
            pairs = zip(make_reader(a).iter_messages(), make_reader(b).iter_messages(), strict=True)
            assert all(x[1].topic == y[1].topic and x[2].data == y[2].data for x, y in pairs)


def test_all_that_a_run_of_the_demo_needs_is_there() -> None:
    recording, config, expected = demo_files()
    assert all(path.is_file() for path in (*recording, config, expected))
    assert {name: robot.map.parameters["resolution_m"] for name, robot in load_config(config).robots.items()} == {
        "alpha": 0.05,
        "bravo": 0.07,
        "charlie": 0.10,
    }


def test_each_file_is_ros_2_mcap_with_one_robot(made: Made) -> None:
    scans = 0
    for path in made.paths:
        with path.open("rb") as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            assert reader.get_header().profile == "ros2"
        assert summary is not None and summary.statistics is not None
        topics = {
            channel.topic: summary.statistics.channel_message_counts[i] for i, channel in summary.channels.items()
        }
        assert set(topics) == {f"/{path.stem}/scan", f"/{path.stem}/odom", "/tf", "/tf_static"}
        assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}
        scans += topics[f"/{path.stem}/scan"]
    assert 400 <= scans <= 900


@pytest.mark.parametrize("robot", [0, 1, 2], ids=["alpha", "bravo", "charlie"])
def test_recorded_scans_placed_by_the_truth_lie_on_walls(made: Made, robot: int) -> None:
    """The whole chain: ranges, angles, beam times and mount as recorded, base poses as they truly were."""
    lidar = made.mission.robots[robot].lidar
    trajectory = trajectory_of(made.mission.robots[robot], made.mission.duration_s)
    path = made.paths[robot]
    T_base_sensor = pose_of(next(messages(path, "/tf_static")).transforms[0].transform).matrix
    seen = 0
    for scan in messages(path, f"/{path.stem}/scan"):
        ranges = scan.ranges.astype(np.float64)
        angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        hits = np.isfinite(ranges) & (ranges > scan.range_min)
        ends = (ranges * np.stack((np.cos(angles), np.sin(angles)))).T[hits] @ T_base_sensor[:2, :2].T
        times_s = (scan.header.stamp.sec - 1_700_000_000) + scan.header.stamp.nanosec * 1e-9
        bases = trajectory.at(times_s + scan.time_increment * np.flatnonzero(hits))
        errors = distance_to_walls(placed(bases, ends + T_base_sensor[:2, 3]), made.mission.world.segments)
        assert errors.max() < 6 * lidar.noise_sigma_m + 0.001
        assert np.sqrt(np.mean(errors**2)) < 1.1 * lidar.noise_sigma_m
        seen += hits.sum()
    assert seen > 20_000


def placed(bases: np.ndarray, points: np.ndarray) -> np.ndarray:
    c, s = np.cos(bases[:, 2]), np.sin(bases[:, 2])
    x = bases[:, 0] + c * points[:, 0] - s * points[:, 1]
    return np.stack((x, bases[:, 1] + s * points[:, 0] + c * points[:, 1]), axis=1)


@pytest.mark.parametrize("robot", [0, 1, 2], ids=["alpha", "bravo", "charlie"])
def test_recorded_poses_are_of_slam_quality_in_a_frame_of_their_own(made: Made, robot: int) -> None:
    truth = made.mission.robots[robot]
    trajectory = trajectory_of(truth, made.mission.duration_s)
    T_world_map = Transform.planar(*truth.T_world_map)
    shifts, turns = [], []
    for message in messages(made.paths[robot], "/tf"):
        map_odom, odom_base = (pose_of(stamped.transform) for stamped in message.transforms)
        stamp = message.transforms[0].header.stamp
        true = trajectory.at(np.array([stamp.sec - 1_700_000_000 + stamp.nanosec * 1e-9]))[0]
        shift_m, turn_rad = Transform.planar(*true).difference(T_world_map @ map_odom @ odom_base)
        shifts.append(shift_m)
        turns.append(turn_rad)
    assert 0.002 < np.sqrt(np.mean(np.square(shifts))) < 0.03
    assert max(shifts) < 0.08
    assert max(turns) < math.radians(1.0)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_robot_drives_through_anything(seed: int) -> None:
    mission = build_mission(load_plan(DEMO / "floor.yaml"), load_mission_plan(DEMO / "mission.yaml"), seed)
    for robot in mission.robots:
        trajectory: Trajectory = trajectory_of(robot, mission.duration_s)
        assert distance_to_walls(trajectory.poses[:, :2], mission.world.segments).min() > 0.15


def test_map_frames_differ_between_robots_and_seeds() -> None:
    plans = load_plan(DEMO / "floor.yaml"), load_mission_plan(DEMO / "mission.yaml")
    frames = [pose for seed in SEEDS for pose in build_mission(*plans, seed).T_world_map.values()]
    assert len({round(yaw, 3) for _, _, yaw in frames}) == 3 * len(SEEDS)


def test_the_script_says_what_it_wrote(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--seed", "3", "-o", str(tmp_path)]) == 0
    assert capsys.readouterr().out.count(" MB") == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "alpha.mcap",
        "bravo.mcap",
        "charlie.mcap",
        "config.yaml",
    ]


def test_a_bad_mission_file_says_all_that_is_wrong(tmp_path: Path) -> None:
    bad = tmp_path / "mission.yaml"
    bad.write_text("duration_s: -1\nrobots: {alpha: {lidar: {beams: 1}, speed_m_s: 1, route: [[0, 0]], colour: red}}\n")
    with pytest.raises(ConfigError) as caught:
        load_mission_plan(bad)
    for place in ("duration_s", "lidar.beams", "lidar.range_m", "robots.alpha.route", "robots.alpha.colour"):
        assert place in str(caught.value)
