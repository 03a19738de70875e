"""Opening whatever a person may name."""

from __future__ import annotations

import gzip
import os
from pathlib import Path
from typing import Any

import pytest

from mapgraft.contracts.sources import Source
from mapgraft.errors import RecordingError, UsageError
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.opening import Reader, open_source
from mapgraft.recording.containers.tum_file import TumSource


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "is empty (0 bytes)"),
        (b"\0" * 100, "is not a recording"),
        (b"hello\nworld\n", "is not a recording"),
        (b"\x89MCAP", "does not begin like one"),
        (b"#ROSBAG V1.1\n", "old format"),
        (b"#ROSBAG V2.0\n", None),
        (b"SQLite format 3\0", "cannot be read as a ROS 2 bag"),
        (b"BZh91AY", "unpack it first (bunzip2)"),
        (b"\x28\xb5\x2f\xfd....", "unpack it first (unzstd)"),
        (b"PK\x03\x04....", "unpack it first (unzip)"),
        (gzip.compress(b"#ROSBAG V2.0\n", mtime=0), "unpack it first (gunzip)"),
        (gzip.compress(b"hello", mtime=0), "is not a recording"),
        (b"\x1f\x8b\x08nonsense", "cannot be unpacked"),
    ],
)
def test_files_that_are_no_recordings(tmp_path: Path, content: bytes, sentence: str | None) -> None:
    path = tmp_path / "some.file"
    path.write_bytes(content)
    if sentence is None:
        source = open_source(path)
        assert source.channels == ()
        assert list(source.messages()) == []
        return
    with pytest.raises(RecordingError) as caught:
        open_source(path)
    assert sentence in str(caught.value)
    assert str(path) in str(caught.value)


def test_places_that_are_no_files(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"missing.mcap does not exist"):
        open_source(tmp_path / "missing.mcap")
    with pytest.raises(RecordingError, match=r"without a ROS 2 bag"):
        open_source(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RecordingError, match=r"neither a file nor a folder"):
        open_source(tmp_path / "pipe")
    with pytest.raises(RecordingError, match=r"cannot be read"):
        open_source(tmp_path / ("x" * 300))


def test_the_content_decides_and_not_the_name(tmp_path: Path, write_mcap: Any, ros2_scans: Any) -> None:
    path = write_mcap([[ros2_scans.sample(1)]], name="misnamed.log")
    assert open_source(path).container == "mcap"
    (tmp_path / "poses.bag").write_text("1 0 0 0 0 0 0 1\n")
    assert open_source(str(tmp_path / "poses.bag")).container == "tum"
    (tmp_path / "robot.txt").write_text("PARAM a b\nODOM 0 0 0 0 0 0 1 r 1\n")
    assert open_source(tmp_path / "robot.txt").container == "carmen"


def test_every_source_keeps_the_seam(shared_data: Path, tmp_path: Path) -> None:
    (tmp_path / "poses.tum").write_text("1 0 0 0 0 0 0 1\n")
    paths = [
        shared_data / "mcap" / "nav2_turtlebot.mcap",
        shared_data / "bags" / "three_robots_sim" / "robot1.bag",
        shared_data / "bags" / "turtlebot4" / "macfirst_floor_take_2",
        shared_data / "carmen" / "freiburg-101-corrected.log.gz",
        tmp_path / "poses.tum",
    ]
    for path in paths:
        with open_source(path) as source:
            assert isinstance(source, Source)
            assert source.path == path
            counts = dict.fromkeys((channel.id for channel in source.channels), 0)
            last_ns = source.start_ns or 0
            for message in source.messages():
                assert message.log_ns >= last_ns
                last_ns = message.log_ns
                counts[message.channel.id] += 1
                source.decode(message)
            assert counts == {channel.id: channel.count for channel in source.channels}
            assert last_ns == source.end_ns


def test_a_real_recording_without_scans(shared_data: Path) -> None:
    source = open_source(shared_data / "mcap" / "nav2_turtlebot.mcap")
    assert {c.topic: c.latched for c in source.channels} == {
        "/odom": False,
        "/tf": False,
        "/tf_static": True,
        "/amcl_pose": True,
    }
    assert list(source.scans()) == []


def test_plugins_readers_come_first(tmp_path: Path) -> None:
    path = tmp_path / "run.trajectory"
    path.write_text("1 0 0 0 0 0 0 1\n")
    asked: list[Path] = []

    def open_it(found: Path) -> TumSource:
        asked.append(found)
        return TumSource(found)

    assert open_source(path, readers=[Reader((".other",), open_it), Reader((".trajectory",), open_it)]).path == path
    assert asked == [path]
    with pytest.raises(RecordingError, match=r"gives a int, which is no source"):
        open_source(path, readers=[Reader((".trajectory",), lambda found: 3)])


def test_an_unknown_typestore_is_wrong_usage(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"there is no typestore 'humble'"):
        open_source(tmp_path, typestore="humble")


def test_a_text_that_unpacks_without_end_is_read_as_far_as_the_limits_allow(tmp_path):
    line = b"FLASER 2 1.0 2.0 0 0 0 0 0 0 %d.0 host %d.0\n"
    logged = b"".join(line % (n, n) for n in range(1000))
    packed = tmp_path / "bomb.log.gz"
    packed.write_bytes(gzip.compress(logged + b"\n" * (40 << 20)))
    with open_source(packed) as source:
        assert len(list(source.messages())) == 1000
        (fault,) = source.faults
    assert fault.cause == "unpacks_too_far" and "raise limits.expansion" in fault.sentence
    with open_source(packed, limits=ReadLimits(expansion=1e5)) as source:
        assert len(list(source.messages())) == 1000 and not len(source.faults)
    endless = tmp_path / "endless.log.gz"
    endless.write_bytes(gzip.compress(logged + b"x" * (40 << 20)))
    with open_source(endless) as source:
        assert len(list(source.messages())) == 1000
        assert {fault.cause for fault in source.faults} == {"unpacks_too_far"}
