"""The merge recording: readable by others, complete, in order, and the same bytes for the same mission."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import time
from collections import defaultdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, Header, MessageIndex, Metadata, Schema
from mcap.stream_reader import StreamReader
from plots import ALPHA, AT, RESOLUTION_M, START_NS, UNDERSCORE, S, provenance, tell, told
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

from mapgraft.config import LimitsConfig
from mapgraft.contracts import Observation, OutputMessage, Scan, Transform
from mapgraft.events import Event, Snapshot
from mapgraft.guard import Guard
from mapgraft.outputs.event_message import event_of, sentence
from mapgraft.outputs.read_back import read_events
from mapgraft.outputs.run_folder import RunFolder
from mapgraft_schemas import VERSION

Read = dict[str, list[tuple[int, Any]]]  # topic → (log time, message)
ROS = {ALPHA: "alpha", AT: "beta_2", UNDERSCORE: "beta_2_2"}


def read(path: Path) -> Read:
    """Everything in the file, through rosbags, with the types that the file itself defines."""
    out: Read = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, stamp_ns, data in reader.messages():
            out[connection.topic].append((stamp_ns, reader.deserialize(data, connection.msgtype)))
    return out


@pytest.fixture(scope="module")
def topics(merge_file: Path) -> Read:
    return read(merge_file)


def stamp_of(header: Any) -> int:
    return int(header.stamp.sec * S + header.stamp.nanosec)


def pose_of(T: Any) -> Transform:
    t, r = T.transform.translation, T.transform.rotation
    return Transform.from_quaternion((t.x, t.y, t.z), (r.x, r.y, r.z, r.w))


def frames(topics: Read) -> dict[str, list[tuple[int, Transform]]]:
    """Child frame → its places in world, in the order of the file."""
    out: dict[str, list[tuple[int, Transform]]] = defaultdict(list)
    for _, message in topics["/tf_static"]:
        for T in message.transforms:
            assert T.header.frame_id == "world"
            out[T.child_frame_id].append((stamp_of(T.header), pose_of(T)))
    return out


def test_rosbags_reads_every_message_with_the_types_in_the_file(merge_file: Path, topics: Read) -> None:
    with merge_file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    assert sum(map(len, topics.values())) == summary.statistics.message_count
    assert set(topics) == {
        *("/tf", "/tf_static", "/merge/events", "/merge/links", "/rosout"),
        *(f"/{name}/map" for name in ROS.values()),
        *(f"/{name}/merged/map" for name in ROS.values()),
        *("/alpha/donors/beta_2/map", "/beta_2_2/donors/alpha/map"),
    }


def test_the_events_are_those_that_were_told(topics: Read, merge_file: Path, events: list[Event]) -> None:
    read_events_ = [event_of(message) for _, message in topics["/merge/events"]]
    assert [e.seq for e in read_events_] == [e.seq for e in events]
    assert [e.T_receiver_donor for e in read_events_] == [e.T_receiver_donor for e in events]
    assert [
        (stamp, e.kind, e.reason, e.exactness)
        for (stamp, _), e in zip(topics["/merge/events"], read_events_, strict=True)
    ] == [(e.stamp_ns, e.kind, e.reason, e.exactness) for e in events]
    assert [e.seq for e in read_events(merge_file)] == [e.seq for e in events]
    assert [(message.msg, message.level) for _, message in topics["/rosout"]] == [
        (sentence(e), {"offered": 10, "verified": 10, "ambiguous": 30, "reverted": 30}.get(e.kind, 20)) for e in events
    ]
    assert topics["/merge/events"][0][1].header.frame_id == "alpha/map"


def test_data_time_everywhere_and_a_sequence_that_rises_over_all_topics(merge_file: Path) -> None:
    with merge_file.open("rb") as stream:
        messages = [message for _, _, message in make_reader(stream).iter_messages(log_time_order=False)]
    assert all(message.log_time == message.publish_time for message in messages)
    assert [message.sequence for message in messages] == list(range(len(messages)))
    times = [message.log_time for message in messages]
    assert times == sorted(times)
    assert times[0] >= START_NS and times[-1] <= START_NS + 30 * S


def test_maps_are_grids_in_the_robots_frames_each_where_it_changed(topics: Read) -> None:
    own, merged = topics["/alpha/map"], topics["/alpha/merged/map"]
    assert [stamp for stamp, _ in own] == [START_NS + 10 * S, START_NS + 599 * S // 20]
    assert [stamp for stamp, _ in merged] == [START_NS + 10 * S, START_NS + 10 * S, START_NS + 599 * S // 20]
    grid = own[0][1]
    assert (grid.header.frame_id, stamp_of(grid.header)) == ("alpha/map", own[0][0])
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (10, 10, RESOLUTION_M)
    cells = grid.data.reshape(10, 10)
    assert (cells[:, 0] == 100).all() and (cells[:, 1:] == 0).all()
    assert merged[0][1].data.tolist() == grid.data.tolist() and merged[1][1].info.width == 41


def test_what_came_in_is_a_grid_in_the_receivers_frame_said_when_it_changed(topics: Read) -> None:
    given = topics["/alpha/donors/beta_2/map"]
    assert [stamp for stamp, _ in given] == [START_NS + 10 * S] * 2
    assert {message.header.frame_id for _, message in given} == {"alpha/map"}
    assert [(message.info.width, message.info.height) for _, message in given] == [(1, 1), (34, 2)]
    assert len(topics["/beta_2_2/donors/alpha/map"]) == 3  # before the merge, after it, the same again, as it was


def test_every_robot_has_a_place_in_world_before_it_moves(topics: Read) -> None:
    first = {T.child_frame_id for T in topics["/tf_static"][0][1].transforms}
    assert first == {f"{name}/map" for name in ROS.values()}
    assert topics["/tf_static"][0][0] <= topics["/tf"][0][0]
    for _, message in topics["/tf_static"]:  # the last message alone must place everybody: listeners get only that
        assert {T.child_frame_id for T in message.transforms} == first


def test_merged_frames_follow_the_merge_and_the_first_never_jumps(topics: Read, events: list[Event]) -> None:
    places = frames(topics)
    merged = next(e for e in events if e.kind == "merged")
    assert merged.T_receiver_donor is not None
    assert {T for _, T in places["alpha/map"]} == {Transform.identity()}
    after = [T for stamp, T in places["beta_2/map"] if stamp >= merged.stamp_ns]
    assert after and all(T.difference(merged.T_receiver_donor)[0] < 1e-9 for T in after)


def test_a_frame_changes_in_a_step_not_gradually(topics: Read, events: list[Event]) -> None:
    merged = next(e for e in events if e.kind == "merged")
    places = frames(topics)["beta_2/map"]
    before = [T for stamp, T in places if stamp == merged.stamp_ns - 1]
    assert before and before[0] == places[0][1]
    assert next(T for stamp, T in places if stamp == merged.stamp_ns) != before[0]


def test_a_reverted_robot_goes_aside_again(topics: Read, events: list[Event]) -> None:
    reverted = next(e for e in events if e.kind == "reverted")
    joined = [T for stamp, T in frames(topics)["beta_2_2/map"] if stamp < reverted.stamp_ns]
    last = frames(topics)["beta_2_2/map"][-1]
    assert any(abs(T.yaw_rad) > 1.0 for T in joined)
    assert last[0] >= reverted.stamp_ns and last[1].yaw_rad == 0.0


def test_bodies_move_in_their_map_frames_at_most_ten_times_a_second(topics: Read) -> None:
    story = {(o.robot, o.stamp_ns): o.T_map_base for o in told() if isinstance(o, Observation)}
    stamps: dict[str, list[int]] = defaultdict(list)
    for log_time, message in topics["/tf"]:
        (T,) = message.transforms
        name = T.child_frame_id.removesuffix("/base_link")
        robot = next(robot for robot, ros in ROS.items() if ros == name)
        assert T.header.frame_id == f"{name}/map" and stamp_of(T.header) == log_time
        assert pose_of(T).difference(story[robot, log_time])[0] < 1e-9
        stamps[robot].append(log_time)
    for robot in ROS:
        assert len(stamps[robot]) == 300  # 30 s of 20 Hz, thinned to 10 Hz
        assert np.diff(stamps[robot]).min() >= S // 10


def test_links_join_the_bodies_of_merged_robots_in_world(topics: Read, events: list[Event]) -> None:
    merged = next(e for e in events if e.kind == "merged")
    stamp, message = topics["/merge/links"][0]
    wipe, line = message.markers
    assert stamp == merged.stamp_ns and wipe.action == 3
    assert (line.ns, line.header.frame_id, line.type, len(line.points)) == (merged.merge_id, "world", 4, 2)
    counts = [len(message.markers) - 1 for _, message in topics["/merge/links"]]
    assert counts[0] == 1 and max(counts) == 2 and counts[-1] == 1


def test_the_profile_of_ros_2_is_kept(merge_file: Path) -> None:
    with merge_file.open("rb") as stream:
        records = list(StreamReader(stream).records)
    header = next(r for r in records if isinstance(r, Header))
    assert (header.profile, header.library) == ("ros2", "mapgraft/0.1.0")
    assert {r.encoding for r in records if isinstance(r, Schema)} == {"ros2msg"}
    for channel in (r for r in records if isinstance(r, Channel)):
        assert channel.message_encoding == "cdr"
        assert re.fullmatch(r"(/[A-Za-z][A-Za-z0-9_]*)+", channel.topic)
        (qos,) = YAML(typ="safe", pure=True).load(channel.metadata["offered_qos_profiles"])
        latched = channel.topic.endswith("/map") or channel.topic in ("/tf_static", "/merge/links")
        assert qos["durability"] == (1 if latched else 2)
        assert set(qos) == {
            *("history", "depth", "reliability", "durability", "deadline", "lifespan", "liveliness"),
            *("liveliness_lease_duration", "avoid_ros_namespace_conventions"),
        }


def test_metadata_and_attachments_tell_what_was_run(merge_file: Path) -> None:
    with merge_file.open("rb") as stream:
        reader = make_reader(stream)
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        attachments = {record.name: record for record in reader.iter_attachments()}
    run = metadata["merge_run"]
    assert run["started_at"] == "2026-01-02T00:00:00.000000Z" and run["host"] == "here"
    assert json.loads(run["inputs"])[1] == {"path": "b.bag", "sha256": "cd" * 32, "size_bytes": 99}
    assert run["config_sha256"] == hashlib.sha256(attachments["config.yaml"].data).hexdigest()
    assert metadata["merge_schema"] == {"version": VERSION}
    assert metadata["merge_names"] == {ros: robot for robot, ros in ROS.items()}
    assert attachments["decision_table.yaml"].data == b"- name: all\n"
    panel = json.loads(attachments["layout.json"].data)["configById"]["3D!mapgraft"]
    assert panel["followTf"] == "world"
    for name in ROS.values():
        assert not panel["topics"].get(f"/{name}/donors/alpha/map", {"visible": False})["visible"]
        assert panel["topics"][f"/{name}/map"]["visible"] and panel["topics"][f"/{name}/merged/map"]["frameLocked"]


def records_of(path: Path) -> list[object]:
    with path.open("rb") as stream:
        return [
            (type(record).__name__, vars(record))
            for record in StreamReader(stream, emit_chunks=True).records
            if not (isinstance(record, Metadata) and record.name == "merge_run")
        ]


def test_the_same_mission_gives_the_same_bytes_but_for_the_clock(tmp_path: Path, merge_file: Path) -> None:
    later = provenance(started_at=datetime(2031, 7, 8, 9, 10, 11, 123, tzinfo=UTC))
    with RunFolder(tmp_path / "b", "demo", "r0123456789abcde", later) as sink:
        tell(sink, told())
    a, b = merge_file.read_bytes(), (tmp_path / "b/demo.merge.mcap").read_bytes()
    different = np.flatnonzero(np.frombuffer(a, np.uint8) != np.frombuffer(b, np.uint8))
    at = a.index(b"2026-01-02T00:00:00.000000Z")
    assert len(different) > 0
    assert at <= different.min() and different.max() < at + 27
    assert records_of(merge_file) == records_of(tmp_path / "b/demo.merge.mcap")


def test_another_host_changes_the_record_of_the_run_only(tmp_path: Path, merge_file: Path) -> None:
    with RunFolder(tmp_path / "b", "demo", "r0123456789abcde", provenance(host="somewhere far away")) as sink:
        tell(sink, told())
    kinds = (Attachment, Chunk, MessageIndex)
    with merge_file.open("rb") as a, (tmp_path / "b/demo.merge.mcap").open("rb") as b:
        ours, theirs = (
            [vars(r) for r in StreamReader(stream, emit_chunks=True).records if isinstance(r, kinds)]
            for stream in (a, b)
        )
    assert ours == theirs


def test_scans_are_written_as_points_when_asked_for(tmp_path: Path) -> None:
    angles = np.linspace(0, 1, 4)
    scan = Scan(
        np.stack((np.cos(angles), np.sin(angles)), axis=1),
        np.array([1.0, 2.0, np.nan, 3.0], dtype=np.float32),
        np.array([True, True, True, False]),
    )
    T = Transform.planar(1.0, 2.0, 0.5)
    with RunFolder(tmp_path / "out", "demo", "r1", provenance(), scans=True) as sink:
        sink.observed(Observation("a", START_NS, START_NS, "laser", "scan", scan, T, T))
    topics = read(tmp_path / "out/demo.merge.mcap")
    ((_, cloud),) = topics["/a/scan"]
    points = cloud.data.view(np.float32).reshape(-1, 3)
    rays = scan.rays(T)
    assert points[:, :2] == pytest.approx(rays.ends_m[rays.hits], abs=1e-6)
    assert (cloud.width, cloud.header.frame_id, [f.name for f in cloud.fields]) == (2, "a/map", ["x", "y", "z"])


class Misspelt:
    """A map type that shows itself in a field that no message has."""

    name = "misspelt"

    def messages(self, map_: object) -> list[OutputMessage]:
        return [OutputMessage("map", "nav_msgs/msg/OccupancyGrid", {"cells": []})]


def test_a_run_that_was_killed_before_its_first_record_left_no_events(tmp_path: Path) -> None:
    (tmp_path / "begun.merge.mcap.partial").write_bytes(b"\x89MCAP0\r\n")
    assert read_events(tmp_path / "begun.merge.mcap.partial") == []


def test_a_map_type_that_shows_nonsense_is_named_and_what_was_decided_stays(
    tmp_path: Path, events: list[Event]
) -> None:
    snapshot = next(item for item in told() if isinstance(item, Snapshot))
    wrong = Snapshot(**{name: getattr(snapshot, name) for name in Snapshot.__slots__} | {"map_type": Misspelt()})
    merged = next(e for e in events if e.kind == "merged")
    with RunFolder(tmp_path / "out", "demo", "r1", provenance()) as sink:
        sink.happened(merged)
        sink.mapped(wrong)
    assert any(
        "map type 'misspelt' cannot be shown: " in said and "has no field cells" in said for said in sink.unshown
    )
    assert [e.seq for e in read_events(tmp_path / "out/demo.merge.mcap")] == [merged.seq]


class Sleeping:
    """A map type that never comes back: from its messages, from its files, or from both."""

    name = "sleeping"

    def __init__(self, *slow: str) -> None:
        self.slow, self.asked = slow, list[str]()

    def messages(self, map_: object) -> list[OutputMessage]:
        self._take_time("messages")
        return []

    def files(self, map_: object, stem: str) -> dict[str, bytes]:
        self._take_time("files")
        return {}

    def _take_time(self, method: str) -> None:
        self.asked.append(method)
        until = time.monotonic() + 60.0
        while method in self.slow and time.monotonic() < until:
            pass


@pytest.mark.parametrize("slow", [("messages",), ("files",), ("messages", "files")])
def test_a_map_type_that_never_comes_back_is_left_out_and_the_recording_is_whole(
    tmp_path: Path, events: list[Event], slow: tuple[str, ...]
) -> None:
    guard, sleeping = Guard(LimitsConfig(plugin_s=0.05)), Sleeping(*slow)
    snapshot = next(item for item in told() if isinstance(item, Snapshot))
    hanging = dataclasses.replace(snapshot, map_type=sleeping, why="end")
    merged = next(e for e in events if e.kind == "merged")
    with guard.armed(), RunFolder(tmp_path / "out", "demo", "r1", provenance(), guard=guard) as sink:
        sink.happened(merged)
        sink.mapped(hanging)
        sink.mapped(hanging)
    assert [sleeping.asked.count(method) for method in slow] == [1] + [0] * (len(slow) - 1), "not again"
    assert any(
        "the map type 'sleeping' took longer than 0.05 s: raise limits.plugin_s" in said for said in sink.unshown
    )
    assert [e.seq for e in read_events(tmp_path / "out/demo.merge.mcap")] == [merged.seq]


def test_a_map_type_that_fails_to_show_a_map_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> list[OutputMessage]:
        raise ZeroDivisionError("boom")

    monkeypatch.setattr(Misspelt, "messages", broken)
    snapshot = next(item for item in told() if isinstance(item, Snapshot))
    with RunFolder(tmp_path / "out", "demo", "r1", provenance()) as sink:
        sink.mapped(dataclasses.replace(snapshot, map_type=Misspelt()))
    said = (
        f"the map on /{ROS[snapshot.robot]} could not be shown: the map type 'misspelt' failed: ZeroDivisionError: boom"
    )
    assert said in sink.unshown
