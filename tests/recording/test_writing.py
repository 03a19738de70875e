"""Recordings written and converted: read back by us and by rosbags, the same bytes each time."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from mapgraft.contracts.sources import ScanMessage
from mapgraft.errors import OutputError, RecordingError, UsageError
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.opening import open_source
from mapgraft.recording.decoding.poses import poses_of
from mapgraft.recording.decoding.records import planar_record
from mapgraft.recording.ros2_types import laser_scan, odometry, transforms
from mapgraft.recording.writing import RecordingWriter, convert

LOG = """\
PARAM robot_use_laser on nohost 0
ODOM 1 2 0.5 0 0 0 1.5 r 1.5
FLASER 3 1 2 81.91 4 5 0.25 1 2 0.5 2 r 2
RLASER 2 1 2 4 5 3.25 1 2 0.5 3 r 3
FLASER 3 1 2 nan nan 5 0.25 1 2 0.5 4 r 4
"""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "kitchen.log"
    path.write_text(LOG)
    return path


def read_by_rosbags(path: Path) -> list[tuple[str, int, Any]]:
    with AnyReader([path]) as reader:
        return [(c.topic, log_ns, reader.deserialize(data, c.msgtype)) for c, log_ns, data in reader.messages()]


def test_what_is_written_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "new" / "out.mcap"
    scan = ScanMessage(5, "laser", -1.0, 0.5, 0.001, 0.1, 30.0, np.array([1, np.inf, 3], np.float32))
    with RecordingWriter(path) as writer:
        writer.write("/tf_static", transforms([planar_record(5, "base", "laser", (1, 2, 0.5))]), 5, latched=True)
        writer.write("/scan", laser_scan(scan), 5)
        writer.write("/odom", odometry(planar_record(6, "odom", "base", (1, 2, 0.5))), 6)
        assert not path.exists()
    assert [entry.name for entry in path.parent.iterdir()] == ["out.mcap"]
    source = open_source(path)
    assert {c.topic: (c.latched, c.count) for c in source.channels} == {
        "/tf_static": (True, 1),
        "/scan": (False, 1),
        "/odom": (False, 1),
    }
    (recorded,) = source.scans()
    assert recorded.scan[:2] == scan[:2]
    assert np.allclose(recorded.scan[2:7], scan[2:7])
    assert recorded.scan.ranges_m.tolist() == [1, math.inf, 3]
    assert len(read_by_rosbags(path)) == 3


def test_a_failed_writing_leaves_nothing_behind(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    path.write_bytes(b"what was there before")
    with pytest.raises(KeyError), RecordingWriter(path) as writer:
        writer.write("/tf", transforms([]), 5)
        raise KeyError
    assert path.read_bytes() == b"what was there before"
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.mcap"]


def test_places_that_cannot_be_written(tmp_path: Path, log: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        convert([log], tmp_path / "file" / "out.mcap")


def test_a_carmen_log(tmp_path: Path, log: Path) -> None:
    out = tmp_path / "out.mcap"
    report = convert([log], out)
    assert [(row.topic, row.message_type, row.count) for row in report.written] == [
        ("/odom", "nav_msgs/msg/Odometry", 1),
        ("/scan", "sensor_msgs/msg/LaserScan", 1),
        ("/scan_rear_laser", "sensor_msgs/msg/LaserScan", 1),
        ("/tf", "tf2_msgs/msg/TFMessage", 2),
        ("/tf_static", "tf2_msgs/msg/TFMessage", 1),
    ]
    assert {fault.cause: fault.count for _, fault in report.faults} == {"message_unconvertible": 1}
    assert "/scan (sensor_msgs/msg/LaserScan): 1" in str(report)
    rows = read_by_rosbags(out)
    assert Counter(topic for topic, _, _ in rows) == {row.topic: row.count for row in report.written}
    source = open_source(out)
    records = [
        record
        for raw in source.messages(["/tf", "/tf_static", "/odom"])
        for record in poses_of(raw.channel.message_type, source.decode(raw))
    ]
    edges = {(record.frame, record.child): record.transform() for record in records}
    assert sorted(edges) == [
        ("base_link", "front_laser"),
        ("map", "base_link"),
        ("map", "rear_laser"),
        ("odom", "base_link"),
    ]
    placed = edges["map", "base_link"]
    assert (placed.x_m, placed.y_m, placed.yaw_rad) == pytest.approx((4, 5, 0.25))
    assert edges["odom", "base_link"].yaw_rad == pytest.approx(0.5)
    front, rear = (recorded.scan for recorded in source.scans())
    assert (front.frame_id, front.stamp_ns, rear.frame_id) == ("front_laser", 2 * 10**9, "rear_laser")
    assert front.ranges_m.tolist() == [1, 2, math.inf]
    assert front.range_max_m == pytest.approx(81.8)


def test_equal_inputs_give_equal_bytes(tmp_path: Path, log: Path) -> None:
    outs = [tmp_path / name for name in ("a.mcap", "b.mcap")]
    for out in outs:
        convert([log], out)
    assert outs[0].read_bytes() == outs[1].read_bytes()
    again = tmp_path / "c.mcap"
    convert([outs[0]], again)
    assert [(m.channel.topic, m.log_ns, bytes(m.data)) for m in open_source(again).messages()] == [
        (m.channel.topic, m.log_ns, bytes(m.data)) for m in open_source(outs[0]).messages()
    ]


def test_where_no_message_is_left_no_file_is_made(tmp_path: Path, write_mcap: Any, ros2_scans: Any) -> None:
    path = write_mcap([[ros2_scans.sample(1, "/two")]])
    (out := tmp_path / "out.mcap").write_bytes(b"an earlier one")
    sentence = r"nothing in .* can be converted to ROS 2: no message is left; recording\.mcap: the chunk at .*limits"
    with pytest.raises(RecordingError, match=sentence):
        convert([path], out, limits=ReadLimits(chunk_bytes=10))
    assert out.read_bytes() == b"an earlier one"
    assert not list(tmp_path.glob(".*"))


def test_robots_with_equal_topics_stay_apart(tmp_path: Path, log: Path) -> None:
    other = tmp_path / "2nd floor.log"
    other.write_text(LOG)
    poses = tmp_path / "slam.tum"
    poses.write_text("3.5 1 2 0 0 0 0 1\n-1 1 2 0 0 0 0 1\n4 nan 2 0 0 0 0 1\n")
    report = convert([log, other, log, poses], tmp_path / "out.mcap")
    topics = [row.topic for row in report.written if row.message_type.endswith(("LaserScan", "PoseStamped"))]
    assert topics == [
        "/file_2nd_floor/scan",
        "/file_2nd_floor/scan_rear_laser",
        "/kitchen/scan",
        "/kitchen/scan_rear_laser",
        "/kitchen_2/scan",
        "/kitchen_2/scan_rear_laser",
        "/slam/trajectory",
    ]
    assert {fault.cause: fault.count for _, fault in report.faults if fault.topic == "trajectory"} == {
        "lines_out_of_order": 1,
        "message_unconvertible": 1,
    }
    log_times = [log_ns for _, log_ns, _ in read_by_rosbags(tmp_path / "out.mcap")]
    assert log_times == sorted(log_times)


def test_what_cannot_be_told_in_ros_2_is_left_out_and_counted(
    tmp_path: Path, write_mcap: Any, ros2_scans: Any, ros1_scans: Any
) -> None:
    json = ros2_scans.sample(3, "/json")._replace(encoding="json", schema=("x", "jsonschema", b""), data=b"{}")
    short = ros1_scans.sample(4, "/one")._replace(data=b"short")
    path = write_mcap([[ros2_scans.sample(1, "/two"), ros1_scans.sample(2, "/one"), json, short]], profile="")
    report = convert([path], tmp_path / "out.mcap")
    assert [(row.topic, row.count) for row in report.written] == [("/one", 1), ("/two", 1)]
    (left_out,) = report.skipped
    assert (left_out.file, left_out.topic, left_out.count) == ("recording.mcap", "/json", 1)
    assert left_out.reason == "json messages are not converted"
    assert "left out of recording.mcap: /json (x), 1 message(s): json messages are not converted" in str(report)
    assert {fault.cause for _, fault in report.faults} == {"message_unconvertible"}
    assert "\n  recording.mcap: /one: " in str(report)
    both = list(open_source(tmp_path / "out.mcap").scans())
    originals = list(open_source(path).scans())[:2]
    for new, old in zip(both, originals, strict=True):
        assert new.scan[:7] == old.scan[:7]
        assert new.scan.ranges_m.tobytes() == old.scan.ranges_m.tobytes()
    with pytest.raises(RecordingError, match=r"nothing in .* can be converted"):
        convert([write_mcap([[json]], name="json.mcap")], tmp_path / "none.mcap")


def test_wrong_usage(tmp_path: Path, log: Path) -> None:
    with pytest.raises(UsageError, match=r"must end in \.mcap, found 'out\.bag'"):
        convert([log], tmp_path / "out.bag")
    with pytest.raises(UsageError, match="at least one recording"):
        convert([], tmp_path / "out.mcap")
    out = tmp_path / "out.mcap"
    convert([log], out)
    with pytest.raises(UsageError, match="is one of the recordings"):
        convert([out], out)


@pytest.mark.parametrize("name", ["bags/three_robots_sim/robot1.bag", "bags/turtlebot4/macfirst_floor_take_2"])
def test_real_bags_keep_every_message(tmp_path: Path, shared_data: Path, name: str) -> None:
    out = tmp_path / "out.mcap"
    report = convert([shared_data / name], out)
    old, new = open_source(shared_data / name), open_source(out)
    assert report.skipped == report.faults == ()
    assert [recorded.log_ns for recorded in new.scans()] == [recorded.log_ns for recorded in old.scans()]
    for before, after in zip(old.scans(), new.scans(), strict=True):
        assert before.scan[:7] == after.scan[:7]
        assert before.scan.ranges_m.tobytes() == after.scan.ranges_m.tobytes()
    poses_before = [poses_of(m.channel.message_type, old.decode(m)) for m in old.messages(["/tf", "/odom"])]
    poses_after = [poses_of(m.channel.message_type, new.decode(m)) for m in new.messages(["/tf", "/odom"])]
    assert poses_before == poses_after
    rows = read_by_rosbags(out)
    assert len(rows) == sum(channel.count or 0 for channel in old.channels)


def test_a_link_in_the_place_of_the_unfinished_file_is_not_written_through(tmp_path: Path, log: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / ".out.mcap.partial").symlink_to(tmp_path / "mine")
    convert([log], tmp_path / "out.mcap")
    assert (tmp_path / "mine").read_text() == "mine"
    assert (tmp_path / "out.mcap").stat().st_size and not (tmp_path / "out.mcap").is_symlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kitchen.log", "mine", "out.mcap"]
