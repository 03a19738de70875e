"""What names tell."""

from __future__ import annotations

from pathlib import PurePath

import pytest

from mapgraft.config import check_robot_name
from mapgraft.recording.naming import (
    frame_prefix,
    is_base,
    is_map,
    is_odom,
    is_wish,
    robot_name,
    robot_namespace,
    stem,
    told_apart,
)


@pytest.mark.parametrize(
    ("topic", "namespace"),
    [
        ("/scan", ()),
        ("scan", ()),
        ("/base_scan", ()),
        ("/robot_1/scan", ("robot_1",)),
        ("/fleet/robot_1/front_laser/scan", ("fleet", "robot_1")),
        ("/front/scan", ()),
        ("/lidar2/points", ()),
        ("/tb3_0/scan", ("tb3_0",)),
    ],
)
def test_namespaces(topic, namespace):
    assert robot_namespace(topic) == namespace


@pytest.mark.parametrize(
    ("frame", "prefix"),
    [
        ("base_link", ""),
        ("robot_1/base_link", "robot_1"),
        ("fleet/r1/base_link", "fleet_r1"),
        ("robot_1_base_footprint", "robot_1"),
        ("r1_map", "r1"),
        ("camera_link", ""),
    ],
)
def test_prefixes(frame, prefix):
    assert frame_prefix(frame) == prefix


def test_frames_by_their_names():
    assert all(map(is_map, ["map", "r1/map", "r1_map", "map_frame", "Map"]))
    assert not any(map(is_map, ["base_link", "mapper_link", "odom"]))
    assert all(map(is_odom, ["odom", "odom_combined", "r/odom", "odometry"]))
    assert all(map(is_base, ["base_link", "r1/base_footprint", "r1_base_link", "body"]))
    assert not any(map(is_base, ["base_laser_link", "laser", "odom"]))


def test_wishes_are_no_poses():
    assert all(map(is_wish, ["/goal_pose", "/move_base_simple/goal", "/initialpose", "/waypoints", "/cmd_pose"]))
    assert not any(map(is_wish, ["/amcl_pose", "/slam_pose", "/odom", "/goalkeeper/pose"]))


def test_stems_and_robot_names():
    assert stem(PurePath("a/intel-corrected.log.gz")) == "intel-corrected"
    assert stem(PurePath("a/run.mcap")) == "run"
    assert stem(PurePath("a/run.bag.active")) == "run"
    assert stem(PurePath("a/rosbag2_2024")) == "rosbag2_2024"
    for text in ("a b/c", "ü", "..", "", "x" * 300, "r@day.1"):
        assert check_robot_name(robot_name(text))


def test_files_told_apart_by_as_few_folders_as_it_takes():
    paths = [PurePath(p) for p in ("/d/a/run.bag", "/d/b/run.bag", "/d/b/other.bag")]
    assert told_apart(paths) == ["a_run", "b_run", "other"]
    assert told_apart([PurePath("/run.bag")] * 2) == ["run", "run_1"]
    assert told_apart([PurePath("/x/a/run.bag"), PurePath("/y/a/run.bag")]) == ["x_a_run", "y_a_run"]
