"""Poses from every message type that tells them."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace as Object
from typing import Any

import numpy as np
import pytest

from mapgraft.errors import RecordingError, TransformError
from mapgraft.recording.containers.opening import open_source
from mapgraft.recording.decoding.poses import POSE_READERS, poses_of
from mapgraft.recording.decoding.records import PoseRecord, planar_record

XYZ, XYZW = (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0)
STAMP = Object(sec=5, nanosec=7)
STAMP_NS = 5_000_000_007


def header(frame: str) -> Any:
    return Object(stamp=STAMP, frame_id=frame)


def pose() -> Any:
    return Object(position=Object(x=1, y=2, z=3), orientation=Object(x=0, y=0, z=0, w=1))


def transform(frame: str, child: str) -> Any:
    moved = Object(translation=Object(x=1, y=2, z=3), rotation=Object(x=0, y=0, z=0, w=1))
    return Object(header=header(frame), child_frame_id=child, transform=moved)


COVARIANCE = np.arange(36.0)
FOXGLOVE = Object(
    timestamp=Object(seconds=5, nanos=7),
    parent_frame_id="/a",
    child_frame_id="b",
    translation=pose().position,
    rotation=pose().orientation,
)
MESSAGES: list[tuple[str, Any, list[tuple[str, str]]]] = [
    (
        "tf2_msgs/msg/TFMessage",
        Object(transforms=[transform("/a", "b"), transform("c", "/d")]),
        [("a", "b"), ("c", "d")],
    ),
    ("tf/msg/tfMessage", Object(transforms=[]), []),
    ("geometry_msgs/msg/TransformStamped", transform("a", "b"), [("a", "b")]),
    (
        "nav_msgs/msg/Odometry",
        Object(header=header("/odom"), child_frame_id="", pose=Object(pose=pose(), covariance=COVARIANCE)),
        [("odom", "")],
    ),
    ("geometry_msgs/msg/PoseStamped", Object(header=header("map"), pose=pose()), [("map", "")]),
    (
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        Object(header=header("map"), pose=Object(pose=pose(), covariance=COVARIANCE)),
        [("map", "")],
    ),
    (
        "nav_msgs/msg/Path",
        Object(
            header=header("/map"),
            poses=[Object(header=header(""), pose=pose()), Object(header=header("odom"), pose=pose())],
        ),
        [("map", ""), ("odom", "")],
    ),
    ("foxglove/msg/FrameTransform", FOXGLOVE, [("a", "b")]),
    ("foxglove/msg/FrameTransforms", Object(transforms=[FOXGLOVE]), [("a", "b")]),
    ("foxglove/msg/PoseInFrame", Object(timestamp=Object(sec=5, nsec=7), frame_id="a", pose=pose()), [("a", "")]),
]


@pytest.mark.parametrize(("kind", "message", "frames"), MESSAGES, ids=[kind for kind, _, _ in MESSAGES])
def test_every_type(kind: str, message: Any, frames: list[tuple[str, str]]) -> None:
    records = poses_of(kind, message)
    assert [(record.frame, record.child) for record in records] == frames
    for record in records:
        assert (record.stamp_ns, record.xyz_m, record.xyzw) == (STAMP_NS, XYZ, XYZW)
        has_covariance = "Covariance" in kind or "Odometry" in kind
        assert record.covariance == (tuple(range(36)) if has_covariance else None)


def test_the_types_of_text_formats_are_covered_too() -> None:
    assert set(POSE_READERS) == {
        *(kind for kind, _, _ in MESSAGES),
        "carmen/msg/LaserScan",
        "carmen/msg/Odometry",
        "tum/msg/Pose",
    }


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("nav_msgs/msg/Odometry", Object(header=header("a"))),
        ("tf2_msgs/msg/TFMessage", Object(transforms=None)),
        ("geometry_msgs/msg/PoseStamped", Object(header=Object(stamp=3, frame_id="a"), pose=pose())),
        ("foxglove/msg/PoseInFrame", Object(timestamp=Object(sec=5, nsec=7), frame_id="a", pose=None)),
    ],
)
def test_messages_without_the_fields_of_their_type(kind: str, message: Any) -> None:
    with pytest.raises(RecordingError, match="does not have the fields of its type"):
        poses_of(kind, message)


@pytest.mark.parametrize(
    ("xyz_m", "xyzw", "valid"),
    [
        (XYZ, XYZW, True),
        (XYZ, (0.0, 0.0, 0.0, 2.0), True),
        (XYZ, (0.0, 0.0, 0.0, 0.0), False),
        ((math.nan, 0.0, 0.0), XYZW, False),
        ((math.inf, 0.0, 0.0), XYZW, False),
        (XYZ, (0.0, math.nan, 0.0, 1.0), False),
        (XYZ, (0.0, math.inf, 0.0, 1.0), False),
    ],
)
def test_which_records_are_valid(xyz_m: Any, xyzw: Any, valid: bool) -> None:
    record = PoseRecord(0, "a", "b", xyz_m, xyzw)
    assert record.valid is valid
    if valid:
        assert record.transform().x_m == 1.0
    else:
        with pytest.raises(TransformError):
            record.transform()


def test_planar_records() -> None:
    record = planar_record(3, "map", "base", (1.0, 2.0, -2.5))
    assert record.transform().yaw_rad == pytest.approx(-2.5)
    assert not planar_record(3, "map", "base", (1.0, 2.0, math.nan)).valid


def test_real_transforms_and_odometry(shared_data: Path) -> None:
    source = open_source(shared_data / "bags" / "arena" / "arena_raw_1.bag")
    edges, odometry = set(), []
    for raw in source.messages(["/tf", "/odom"]):
        records = poses_of(raw.channel.message_type, source.decode(raw))
        assert all(record.valid for record in records)
        if raw.channel.topic == "/tf":
            edges |= {(record.frame, record.child) for record in records}
        else:
            odometry += records
    assert not any(name.startswith("/") for edge in edges for name in edge)
    assert ("base_link", "laser") in edges
    assert len(odometry) == 1368
    assert {(record.frame, record.child) for record in odometry} == {("odom", "")}  # the child is left empty there
    assert all(record.covariance is not None and len(record.covariance) == 36 for record in odometry)
