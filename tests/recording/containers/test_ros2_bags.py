"""ROS 2 bags: databases and folders, real and made."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

from mapgraft.contracts.sources import Source
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.bag_folder import BagFolderSource
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.sqlite_file import SqliteSource

REAL = "bags/turtlebot4/macfirst_floor_take_2"


def told(source: Source, **window: Any) -> list[tuple[str, int, int]]:
    return [(m.channel.topic, m.log_ns, crc32(m.data)) for m in source.messages(**window)]


def causes(source: Source) -> set[str]:
    return {fault.cause for fault in source.faults}


@pytest.fixture
def write_bag(tmp_path: Path, ros2_scans: Any) -> Any:
    """``write_bag(name, ...)``: a bag folder with ten scans on two topics, and what it holds."""

    def write(name: str = "made", plugin: Any = StoragePlugin.SQLITE3, mode: Any = None, first: int = 0) -> Any:
        path, rows = tmp_path / name, []
        writer = Writer(path, version=9, storage_plugin=plugin)
        if mode is not None:
            writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            connections = [
                writer.add_connection(topic, ros2_scans.name, typestore=ros2_scans.store) for topic in ("/a", "/b")
            ]
            for n in range(first, first + 10):
                sample = ros2_scans.sample(100 * n + 1, "/b" if n % 2 else "/a")
                writer.write(connections[n % 2], sample.log_ns, sample.data)
                rows.append((sample.topic, sample.log_ns, crc32(sample.data)))
        return path, rows

    return write


@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("mode", [None, CompressionMode.MESSAGE, CompressionMode.FILE, CompressionMode.STORAGE])
def test_every_storage_and_compression(write_bag: Any, plugin: Any, mode: Any) -> None:
    if plugin is StoragePlugin.SQLITE3 and mode is CompressionMode.STORAGE:
        pytest.skip("databases have no compression of their own")
    path, rows = write_bag(plugin=plugin, mode=mode)
    with BagFolderSource(path) as source:
        assert told(source) == rows
        assert told(source, topics=["/b"], start_ns=300, end_ns=701) == [
            row for row in rows if row[0] == "/b" and 300 <= row[1] <= 701
        ]
        assert [(c.topic, c.message_type, c.count) for c in source.channels] == [
            ("/a", "sensor_msgs/msg/LaserScan", 5),
            ("/b", "sensor_msgs/msg/LaserScan", 5),
        ]
        assert (source.start_ns, source.end_ns) == (1, 901)
        assert [scan.log_ns for scan in source.scans()] == [row[1] for row in rows]
        assert source.decode_scan(next(source.messages())).frame_id == "laser"
        assert causes(source) == set()


def test_a_bare_database(write_bag: Any) -> None:
    path, rows = write_bag()
    with SqliteSource(path / "made.db3") as source:
        assert told(source) == rows
        assert source.container == "rosbag2"
        schema = source.schema(source.channels[0])
        assert schema is not None
        assert schema.encoding == "ros2msg"
        assert b"angle_min" in schema.data


def test_a_folder_without_metadata_and_several_parts(write_bag: Any) -> None:
    path, early = write_bag("made")
    other, late = write_bag("late", first=5)
    (path / "metadata.yaml").unlink()
    (path / "made.db3").rename(path / "made_0.db3")
    shutil.copy(other / "late.db3", path / "made_10.db3")
    shutil.copy(other / "late.db3", path / "made_2.db3")
    source = BagFolderSource(path)
    assert causes(source) == {"metadata_missing"}
    assert told(source) == sorted(early + late + late, key=lambda row: row[1])
    assert [(c.id, c.topic, c.count) for c in source.channels] == [(0, "/a", 15), (1, "/b", 15)]
    (path / "made_0.db3").rename(path / "kitchen.db3")
    with pytest.raises(RecordingError, match=r"several recordings .* name the files"):
        BagFolderSource(path)


@pytest.mark.parametrize("text", ["", "{", "rosbag2_bagfile_information: 3", "x: [\x00"])
def test_damaged_metadata_is_left_aside(write_bag: Any, text: str) -> None:
    path, rows = write_bag()
    (path / "metadata.yaml").write_text(text)
    source = BagFolderSource(path)
    assert told(source) == rows
    assert "metadata_missing" in causes(source)


def test_missing_and_unreadable_parts(write_bag: Any) -> None:
    path, rows = write_bag()
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("- made.db3", "- gone.db3\n  - made.db3\n  - torn.db3"))
    (path / "torn.db3").write_bytes(b"torn")
    source = BagFolderSource(path)
    assert told(source) == rows
    assert causes(source) == {"part_missing", "part_unreadable"}
    (path / "made.db3").unlink()
    with pytest.raises(RecordingError, match=r"torn.db3 is not a database"):
        BagFolderSource(path)
    (path / "torn.db3").unlink()
    with pytest.raises(RecordingError, match=r"no file that .*metadata.yaml names is there"):
        BagFolderSource(path)


def test_folders_that_are_no_bags(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"without a ROS 2 bag"):
        BagFolderSource(tmp_path)


def test_databases_that_are_no_bags(tmp_path: Path, write_bag: Any) -> None:
    other = tmp_path / "music.db3"
    with sqlite3.connect(other) as database:
        database.execute("CREATE TABLE songs(name TEXT)")
    database.close()
    with pytest.raises(RecordingError, match=r"is a database but no ROS 2 bag"):
        SqliteSource(other)
    path, _ = write_bag()
    whole = (path / "made.db3").read_bytes()
    for length in (0, 10, 100, 5000):
        (path / "made.db3").write_bytes(whole[:length])
        with pytest.raises(
            RecordingError, match=r"made.db3 (is empty|is not a database|cannot be read as a ROS 2 bag)"
        ):
            SqliteSource(path / "made.db3")


def test_a_database_damaged_in_the_middle_is_read_as_far_as_possible(tmp_path: Path, shared_data: Path) -> None:
    path = tmp_path / "hurt.db3"
    shutil.copy(shared_data / REAL / "macfirst_floor_take_2_0.db3", path)
    everything = told(SqliteSource(path))
    whole = bytearray(path.read_bytes())
    middle = len(whole) // 2 // 4096 * 4096
    for at in range(middle, middle + 60 * 4096, 4096):
        whole[at : at + 8] = b"\xff" * 8  # the heads of pages: of the tree, or the pointers to the rest of a message
    path.write_bytes(whole)
    source = SqliteSource(path)
    found = told(source)
    assert len(everything) // 4 < len(found) < len(everything)
    assert {row[:2] for row in found} <= {row[:2] for row in everything}
    assert causes(source) == {"database_damaged"}


def test_what_a_killed_recorder_left_in_its_log_is_read(tmp_path: Path, write_bag: Any) -> None:
    path, rows = write_bag()
    database = sqlite3.connect(path / "made.db3")
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 5000, x'00')")
    database.commit()
    for suffix in ("", "-wal"):
        shutil.copy(path / f"made.db3{suffix}", tmp_path / f"killed.db3{suffix}")
    database.close()
    with SqliteSource(tmp_path / "killed.db3") as source:
        assert [row[1] for row in told(source)] == [*(row[1] for row in rows), 5000]


def test_a_real_bag_reads_as_rosbags_reads_it(shared_data: Path) -> None:
    with Reader(shared_data / REAL) as reader:
        theirs = [(c.topic, log_ns, crc32(data)) for c, log_ns, data in reader.messages()]
    source = BagFolderSource(shared_data / REAL)
    assert told(source) == theirs
    assert {c.topic: c.latched for c in source.channels}["/tf_static"] is True
    scans = [recorded.scan for recorded in source.scans()]
    assert len(scans) == 357
    assert {len(scan.ranges_m) for scan in scans} == {720}
    bare = SqliteSource(shared_data / REAL / "macfirst_floor_take_2_0.db3")
    assert told(bare) == theirs


def test_a_part_that_is_named_again_counts_once(write_bag: Any) -> None:
    path, rows = write_bag()
    (path / "link.db3").symlink_to(path / "made.db3")
    metadata = path / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("- made.db3", "- made.db3\n  - ./made.db3\n  - link.db3"))
    with BagFolderSource(path) as source:
        assert told(source) == rows
        assert [(fault.cause, fault.count) for fault in source.faults] == [("metadata_damaged", 2)]


def test_all_parts_of_a_folder_together_unpack_to_no_more_than_the_limits(
    write_bag: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, rows = write_bag(mode=CompressionMode.FILE)
    packed = path / "made.db3.zstd"
    for n in range(1, 4):
        shutil.copy(packed, path / f"more_{n}.db3.zstd")
    metadata = path / "metadata.yaml"
    names = "".join(f"\n  - more_{n}.db3.zstd" for n in range(1, 4))
    metadata.write_text(metadata.read_text().replace("- made.db3.zstd", f"- made.db3.zstd{names}"))
    with BagFolderSource(path) as source:
        assert len(told(source)) == 4 * len(rows)
    monkeypatch.setattr("mapgraft.recording.containers.limits.FREE_BYTES", 60_000)
    with BagFolderSource(path, limits=ReadLimits(expansion=1.0)) as source:
        kept = [fault for fault in source.faults if "raise limits.expansion" in fault.sentence]
        assert [fault.count for fault in kept] == [4 - len(told(source)) // len(rows)]


def test_unpacking_leaves_room_on_the_disk(write_bag: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    path, _ = write_bag(mode=CompressionMode.FILE)
    monkeypatch.setattr("mapgraft.recording.containers.zstd_files.LEFT_FREE_BYTES", 1 << 62)
    with pytest.raises(RecordingError, match=r"there is no room in .* set TMPDIR"):
        BagFolderSource(path)
