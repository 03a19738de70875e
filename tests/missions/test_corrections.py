"""Robots that learn late where they had been: a drive with drift, and the path after the loop was closed."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

import mapgraft
from mapgraft.audit import same_map
from mapgraft.config import parse_config
from mapgraft.contracts import Transform
from mapgraft.correction import Correction, Recollection
from mapgraft.recording.mission import open_mission
from mapgraft_recordings import demo_files

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
PATH = "nav_msgs/msg/Path"
CLOSED_S = 100.5  # when the loop is closed
ALPHA, BRAVO = demo_files()[0][:2]


def drift(since_start_s: float) -> Transform:
    """How far off the mapper was, growing from scan to scan; it never changes within a sweep."""
    steps = math.floor(since_start_s + 0.25)
    return Transform.planar(0.004 * steps, -0.002 * steps, 0.0006 * steps)


def pose_of(T: Transform) -> Any:
    quaternion = TYPES["geometry_msgs/msg/Quaternion"](*T.quaternion_xyzw())
    return TYPES["geometry_msgs/msg/Pose"](TYPES["geometry_msgs/msg/Point"](T.x_m, T.y_m, T.z_m), quaternion)


def header(stamp_ns: int, frame: str) -> Any:
    return TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9)), frame)


def path_message(stamp_ns: int, poses: Mapping[int, Transform], frame: str) -> Any:
    stamped = TYPES["geometry_msgs/msg/PoseStamped"]
    return TYPES[PATH](header(stamp_ns, frame), [stamped(header(ns, frame), pose_of(T)) for ns, T in poses.items()])


def drifting(data: bytes, since_start_s: float) -> bytes:
    """A tf message whose map → odom is off."""
    message = STORE.deserialize_cdr(data, "tf2_msgs/msg/TFMessage")
    for k, one in enumerate(message.transforms):
        if one.child_frame_id == "alpha/odom":
            v, q = one.transform.translation, one.transform.rotation
            off = drift(since_start_s) @ Transform.from_quaternion((v.x, v.y, v.z), (q.x, q.y, q.z, q.w))
            pose = pose_of(off)
            vector = TYPES["geometry_msgs/msg/Vector3"](pose.position.x, pose.position.y, pose.position.z)
            moved = TYPES["geometry_msgs/msg/Transform"](vector, pose.orientation)
            message.transforms[k] = dataclasses.replace(one, transform=moved)
    return bytes(STORE.serialize_cdr(message, "tf2_msgs/msg/TFMessage"))


@pytest.fixture(scope="module")
def true_poses() -> Mapping[int, Transform]:
    """Where alpha's mapper says in the end that it was, by the stamps of its scans until the loop was closed."""
    with open_mission([ALPHA], parse_config({})) as mission:
        seen = [(one.recorded_ns, one.T_map_base) for one in mission.places()]
    return {ns: T for ns, T in seen if ns < seen[0][0] + CLOSED_S * 1e9}


@pytest.fixture(scope="module")
def drifted(true_poses, tmp_path_factory) -> Callable[..., Path]:
    """``drifted(every=1, times=1, frame="alpha/map")`` records alpha with drift; each nth pose is in the path."""

    def make(every: int = 1, times: int = 1, frame: str = "alpha/map") -> Path:
        target = tmp_path_factory.mktemp("drifted") / "alpha.mcap"
        poses = dict(list(true_poses.items())[::-1][::every][::-1])
        with ALPHA.open("rb") as source, target.open("wb") as out:
            writer, channels = Writer(out), {}
            writer.start(profile="ros2")
            started_ns = None
            for schema, channel, message in make_reader(source).iter_messages():
                started_ns = message.log_time if started_ns is None else started_ns
                since_s = (message.log_time - started_ns) / 1e9
                if channel.topic not in channels:
                    known = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.topic] = writer.register_channel(channel.topic, "cdr", known, channel.metadata)
                off = channel.topic == "/tf" and since_s < CLOSED_S
                data = drifting(message.data, since_s) if off else message.data
                writer.add_message(channels[channel.topic], message.log_time, data, message.publish_time)
            text = STORE.generate_msgdef(PATH, ros_version=2)[0].encode()
            topic = writer.register_channel("/alpha/path", "cdr", writer.register_schema(PATH, "ros2msg", text))
            for n in range(times):
                told_ns = started_ns + round((CLOSED_S + 0.1 + 20 * n) * 1e9)
                data = bytes(STORE.serialize_cdr(path_message(told_ns, poses, frame), PATH))
                writer.add_message(topic, told_ns, data, told_ns)
            writer.finish()
        return target

    return make


def config(**more: Any) -> dict[str, Any]:
    robots = {"alpha": {"poses": {"corrections": "/alpha/path"}, **more.pop("alpha", {})}}
    return {"robots": robots, "exchange": {"use": "every", "seconds": 60}, "mission": {"end_s": 200}, **more}


def without_corrections(**more: Any) -> dict[str, Any]:
    return {**config(**more), "robots": {"alpha": more.get("alpha", {})}}


def kinds(result: mapgraft.Result, receiver: str) -> list[str]:
    return [event.kind for event in result.events if event.receiver == receiver]


@pytest.mark.parametrize("reversal", ("ledger", "multi_map", "single_map"))
def test_a_corrected_map_is_that_of_a_robot_that_knew_from_the_start(drifted, reversal):
    alone = {"reversal": reversal}
    corrected = mapgraft.run([drifted()], config(**alone), verify_ledger=True)
    knew = mapgraft.run([ALPHA], without_corrections(**alone))
    smeared = mapgraft.run([drifted()], without_corrections(**alone))
    assert corrected.maps["alpha"].layer == knew.maps["alpha"].layer
    one, other = corrected.maps["alpha"], knew.maps["alpha"]
    assert same_map(one.map_type, one.fused, other.fused) and same_map(one.map_type, one.own, other.own)
    assert corrected.maps["alpha"].version == knew.maps["alpha"].version + 1
    assert smeared.maps["alpha"].layer != knew.maps["alpha"].layer
    assert all(finding.sound for finding in corrected.ledgers)
    (event,) = [event for event in corrected.events if event.kind == "corrected"]
    assert event.evidence["observations"] == 101
    assert event.evidence["observations_moved"] == 100  # the first one was right
    assert event.evidence["most_rad"] == pytest.approx(0.06, abs=1e-6)
    assert event.reason.startswith("100 of 101 observations moved, by up to ")


@pytest.mark.parametrize("reversal", ("ledger", "multi_map"))
def test_others_swap_what_they_have_of_it(drifted, reversal, tmp_path):
    result = mapgraft.run([drifted(), BRAVO], config(reversal=reversal), tmp_path / "out", verify_ledger=True)
    assert all(finding.sound for finding in result.ledgers), result.ledgers
    knew = mapgraft.run([ALPHA, BRAVO], without_corrections(reversal=reversal))
    assert {name: one.layer for name, one in result.maps.items()} == {n: one.layer for n, one in knew.maps.items()}
    (told,) = [event for event in result.events if event.kind == "corrected"]
    standing = {event.receiver: event for event in result.standing.values()}
    assert standing["bravo"].donor_version == result.maps["alpha"].version
    merged = next(event for event in result.events if event.kind == "merged" and event.receiver == "bravo")
    assert merged.stamp_ns < told.stamp_ns
    swaps = [event.stamp_ns for event in result.events if event.kind == "updated" and event.receiver == "bravo"]
    assert any(stamp_ns > told.stamp_ns for stamp_ns in swaps)


def test_its_own_merges_are_registered_and_tested_anew(drifted):
    once = {"exchange": {"use": "at", "seconds": [60], "at_end": False}, "mission": {"end_s": 115}}
    result = mapgraft.run([drifted(), BRAVO], config(**once))
    after = [event for event in result.events if event.receiver == "alpha"]
    at = next(k for k, event in enumerate(after) if event.kind == "corrected")
    assert after[at + 1].kind == "updated" and after[at + 1].by == "correction"
    assert after[at + 1].reason.startswith("the own map was corrected; found again, moved by ")
    assert after[at + 2].kind == "verified" and after[at + 2].reason == "no new evidence yet"
    (stands,) = [event for event in result.standing.values() if event.receiver == "alpha"]
    knew = mapgraft.run([ALPHA, BRAVO], without_corrections(**once))
    (true,) = [event for event in knew.standing.values() if event.receiver == "alpha"]
    shift_m, turn_rad = stands.T_receiver_donor.difference(true.T_receiver_donor)
    assert shift_m < 0.05 and turn_rad < 0.005


@pytest.mark.parametrize("every_s", (30, 60))
def test_what_was_wrong_on_the_old_map_is_found_out_and_what_is_right_on_the_new_one_stands(drifted, every_s):
    """The two begin in rooms that look alike: both merges are wrong at first, and the map of one is bent."""
    meetings = {"exchange": {"use": "every", "seconds": every_s}, "mission": {"end_s": 260}}
    result = mapgraft.run([drifted(), BRAVO], config(**meetings), verify_ledger=True)
    lie = json.loads(demo_files()[2].read_text())["T_world_map"]
    alpha, bravo = Transform.planar(*lie["alpha"]), Transform.planar(*lie["bravo"])
    true = {"alpha": alpha.inverse() @ bravo, "bravo": bravo.inverse() @ alpha}
    standing = {event.receiver: event for event in result.standing.values()}
    assert {event.state for event in standing.values()} == {"confirmed"} and len(standing) == 2
    for receiver, event in standing.items():
        shift_m, turn_rad = event.T_receiver_donor.difference(true[receiver])
        assert shift_m < 0.2 and turn_rad < 0.01
    assert all(finding.sound for finding in result.ledgers)
    assert not [event for event in result.events if event.kind == "reverted" and event.by == "consistency"]
    out = [event for event in result.events if event.kind == "reverted" and event.receiver == "bravo"]
    if every_s == 60:  # nobody had found out before the correction
        assert [event.by for event in out] == ["correction"] and "the two meet elsewhere now" in out[0].reason
    else:
        assert [event.by for event in out] == ["sequential"] and "alpha says: alpha.bravo.1 was there" in out[0].reason


def test_a_single_map_with_others_in_it_says_that_it_cannot(drifted):
    result = mapgraft.run([drifted(), BRAVO], config(alpha={"reversal": "single_map"}))
    assert "merged" in kinds(result, "alpha") and "corrected" not in kinds(result, "alpha")
    (event,) = [event for event in result.events if event.by == "correction"]
    assert event.kind == "failed" and "others were merged into its single map" in event.reason


def test_the_same_path_once_more_says_nothing_new(drifted):
    once, often = (mapgraft.run([drifted(times=n)], config()) for n in (1, 4))
    assert once.maps["alpha"].layer == often.maps["alpha"].layer
    assert [e.kind for e in once.events] == [e.kind for e in often.events] == ["corrected"]


def test_between_the_poses_of_a_sparse_path_the_robot_moved_as_it_thought(drifted, true_poses):
    with open_mission([drifted(every=7)], parse_config(config())) as mission:
        *_, (observed, correction) = _until_told(mission.timeline())
    recollection = Recollection(observed)
    placed = recollection.corrected(correction).observations
    errors = [one.T_map_base.difference(true_poses[one.recorded_ns]) for one in placed if one.recorded_ns in true_poses]
    late = errors[errors.index(min(errors)) :]  # what was before the first pose stays as it was
    assert max(shift_m for shift_m, _ in late) < 0.02 and max(turn_rad for _, turn_rad in late) < 0.002


def _until_told(timeline):
    observed = []
    for entry in timeline:
        if isinstance(entry, Correction):
            yield observed, entry
            return
        observed.append(entry)


def test_poses_in_another_frame_are_left_out_and_counted(drifted):
    result = mapgraft.run([drifted(frame="elsewhere")], config())
    assert not [event for event in result.events if event.kind == "corrected"]
    assert any("a corrected pose lies in the frame 'elsewhere', not in 'alpha/map'" in line for line in result.lost)


def test_a_run_folder_tells_of_it(drifted, tmp_path):
    result = mapgraft.run([drifted(), BRAVO], config(), tmp_path / "out")
    table = pq.read_table(tmp_path / "out" / "events")
    assert table.column("kind").to_pylist() == [event.kind for event in result.events]
    assert "corrected" in table.column("kind").to_pylist()
    page = (tmp_path / "out" / "report.html").read_text()
    assert "alpha learnt where it had been" in page
