"""ROS 1 bags: real ones, and made ones that were cut or damaged."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Reader, Writer

from mapgraft.contracts.sources import Source
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.bag_file import BagSource

THOROUGH = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def told(source: Source, **window: Any) -> list[tuple[str, int, int]]:
    return [(m.channel.topic, m.log_ns, crc32(m.data)) for m in source.messages(**window)]


@pytest.fixture(params=[None, Writer.CompressionFormat.LZ4, Writer.CompressionFormat.BZ2], ids=["none", "lz4", "bz2"])
def bag(request: Any, tmp_path: Path, ros1_scans: Any) -> tuple[Path, list[tuple[str, int, int]]]:
    """Five chunks of three scans on two topics, one of them latched, and what they hold."""
    path, rows = tmp_path / "made.bag", []
    writer = Writer(path)
    writer.chunk_threshold = 3 * 350
    if request.param is not None:
        writer.set_compression(request.param)
    with writer:
        connections = [
            writer.add_connection(topic, ros1_scans.name, typestore=ros1_scans.store, latching=latching)
            for topic, latching in (("/a", 0), ("//b", 1))
        ]
        for n in range(15):
            sample = ros1_scans.sample(1000 * (n + 1), "/b" if n % 3 == 0 else "/a", beams=60)
            writer.write(connections[n % 3 == 0], sample.log_ns, sample.data)
            rows.append((sample.topic, sample.log_ns, crc32(sample.data)))
    return path, rows


def test_made_bags(bag: Any) -> None:
    path, rows = bag
    with BagSource(path) as source:
        assert told(source) == rows
        channels = [(c.topic, c.message_type, c.encoding, c.count, c.latched) for c in source.channels]
        assert channels == [
            ("/a", "sensor_msgs/msg/LaserScan", "ros1", 10, False),
            ("/b", "sensor_msgs/msg/LaserScan", "ros1", 5, True),
        ]
        assert (source.start_ns, source.end_ns, len(source.faults)) == (1000, 15000, 0)
        assert told(source, topics=["/b"], start_ns=4000, end_ns=10000) == [
            row for row in rows if row[0] == "/b" and 4000 <= row[1] <= 10000
        ]
        assert [scan.log_ns for scan in source.scans(["/a"])] == [row[1] for row in rows if row[0] == "/a"]


@THOROUGH
@given(where=st.floats(0, 1))
def test_cut_anywhere(bag: Any, where: float) -> None:
    path, rows = bag
    whole = path.read_bytes()
    length = int(where * (len(whole) - 1))
    cut = path.with_name("cut.bag")
    cut.write_bytes(whole[:length])
    if length < len(b"#ROSBAG V2.0\n"):
        with pytest.raises(RecordingError):
            BagSource(cut)
        return
    source = BagSource(cut)
    found = told(source)
    assert found == rows[: len(found)]
    assert source.faults.count("index_damaged") == 1
    complete = [place.end_ns for place in BagSource(path)._places if place.end <= length]
    assert len(found) >= sum(log_ns <= max(complete, default=0) for _, log_ns, _ in rows)


@THOROUGH
@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_any_bit_turned(bag: Any, where: float, bit: int) -> None:
    """Bags have no checksums, so a wrong bit in a message cannot be seen; but nothing crashes, and little is lost."""
    path, rows = bag
    whole = bytearray(path.read_bytes())
    at = int(where * len(whole))
    whole[at] ^= 1 << bit
    hurt = path.with_name("hurt.bag")
    hurt.write_bytes(whole)
    try:
        source = BagSource(hurt)
    except RecordingError:
        assert at < 4200  # the magic, or the head with its fields
        return
    found = told(source)
    list(source.scans())
    assert sum((Counter(found) & Counter(rows)).values()) >= len(rows) - 4 or len(source.faults)


@pytest.mark.parametrize("name", ["arena/arena_raw_1", "arena/arena_gmapping_1", "three_robots_sim/robot1"])
def test_real_bags_read_as_rosbags_reads_them(shared_data: Path, name: str) -> None:
    path = shared_data / "bags" / f"{name}.bag"
    with Reader(path) as reader:
        theirs = [(connection.topic, log_ns, crc32(data)) for connection, log_ns, data in reader.messages()]
        counts = Counter(row[0] for row in theirs)
    source = BagSource(path)
    ours = told(source)
    assert Counter(ours) == Counter(theirs)
    assert [row[1] for row in ours] == [row[1] for row in theirs]
    assert sum((Counter({c.topic: c.count or 0}) for c in source.channels), Counter()) == counts
    assert len(source.faults) == 0
    assert len(list(source.scans())) == sum(
        c.count or 0 for c in source.channels if c.message_type.endswith("LaserScan")
    )


def test_a_real_bag_with_a_broken_index_and_old_definitions(shared_data: Path) -> None:
    path = shared_data / "bags" / "damaged" / "broken_index.bag"
    with pytest.raises(AssertionError):
        Reader(path).open()
    source = BagSource(path)
    scans = [recorded.scan for recorded in source.scans()]
    assert len(scans) == 360
    assert {(scan.frame_id, len(scan.ranges_m)) for scan in scans} == {("laser", 681)}


def test_a_real_bag_of_an_old_format(shared_data: Path) -> None:
    with pytest.raises(RecordingError, match=r"old format \(#ROSRECORD V1\.2\): rewrite it as format 2\.0"):
        BagSource(shared_data / "bags" / "damaged" / "rosrecord_v1.2.bag")


def test_an_encrypted_bag(tmp_path: Path) -> None:
    fields = b"".join(
        len(field).to_bytes(4, "little") + field for field in (b"op=\x03", b"index_pos=" + bytes(8), b"encryptor=gpg")
    )
    path = tmp_path / "secret.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + len(fields).to_bytes(4, "little") + fields + bytes(4))
    with pytest.raises(RecordingError, match=r"is encrypted \(gpg\)"):
        BagSource(path)
