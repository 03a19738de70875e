"""Stamps that cannot be true, clocks that disagree, and poses that jump: each is named, counted, and dealt with."""

from __future__ import annotations

import dataclasses
import json
import math
from itertools import pairwise

import pytest

from mapgraft.config import parse_config
from mapgraft.contracts import ConfigError
from mapgraft.recording.losses import losses
from mapgraft.recording.survey import survey

EPOCH_NS = 1_700_000_000 * 10**9


def seconds(seen) -> float:
    return round((seen.stamp_ns - EPOCH_NS) / 1e9, 6)


def noticed(mission) -> dict[str, int]:
    return {cause: odd.count for topic in mission.tally for cause, odd in topic.noticed.items()}


def dropped(mission) -> dict[str, int]:
    return {cause: lost.count for topic in mission.tally for cause, lost in topic.dropped.items()}


def faults(mission) -> dict[tuple[str, str], int]:
    return {(fault.cause, fault.topic): fault.count for _, fault in mission.faults}


def drive(file, until_s=8.0, spoil=lambda k: 0.0, spoil_tf=lambda k: 0.0):
    """map → base_link at 20 Hz (x = t), scans at 10 Hz; ``spoil`` gives what is added to the k-th stamp, in seconds."""
    file.static("base_link", "laser")
    for k in range(round(until_s * 20) + 1):
        t = k / 20
        file.clock_s = spoil_tf(k)
        file.tf(t, "map", "base_link", t)
        file.clock_s = spoil(k // 2)
        if k % 2 == 0:
            file.scan(t + 0.01, ranges=[2.0 + 0.01 * k] * 8, log_s=t + 0.02)
    file.clock_s = 0.0
    return file


def zero_of(t: float) -> float:
    """What makes a stamp zero."""
    return -(1_700_000_000 + t)


def test_stamps_of_zero_among_others_are_put_right(record, mission):
    found = mission(drive(record(), spoil=lambda k: zero_of(k / 10 + 0.01) if k in (20, 21, 40) else 0.0).write())
    seen = list(found.observations())
    assert len(seen) == 80 and noticed(found) == {"stamp_zero": 3}
    assert [seconds(s) for s in seen] == pytest.approx([k / 10 + 0.01 for k in range(80)], abs=1e-6)
    assert all(s.T_map_base.x_m == pytest.approx(seconds(s), abs=1e-6) for s in seen)
    assert any(
        "3 of 81 scans on /scan are odd (stamp_zero); the first, at 1700000002.010 s: its stamp is 0; the time of its "
        "recording counts" in sentence
        for sentence in found.tally.sentences()
    )


@pytest.mark.parametrize(("by_s", "cause"), [(900.0, "stamp_jump"), (-900.0, "stamp_backwards")])
def test_one_scan_with_a_stamp_far_off_is_left_out_and_the_others_stay(record, mission, by_s, cause):
    found = mission(drive(record(), spoil=lambda k: by_s if k == 30 else 0.0).write())
    assert len(list(found.observations())) == 79
    assert dropped(found) == {cause: 1, "after_last": 1}


def test_a_clock_that_is_set_back_on_the_way_goes_on_with_the_recording(record, mission):
    file = drive(record(), 20, lambda k: -3.0 if k >= 100 else 0.0, lambda k: -3.0 if k >= 200 else 0.0)
    found = mission(file.write())
    seen = list(found.observations())
    assert len(seen) >= 185
    assert all(abs(s.T_map_base.x_m - seconds(s)) < 0.02 for s in seen)
    assert noticed(found)["stamp_backwards"] == 92 and dropped(found)["stamp_backwards"] == 9
    assert faults(found)["stamp_backwards", "/tf"] == 201
    as_stamped = mission(file.write(), clock="header")
    list(as_stamped.observations())
    assert dropped(as_stamped)["late"] >= 20  # by their stamps they are
    assert not noticed(as_stamped)


def test_a_clock_that_ends_before_it_began_is_of_no_use(record, mission):
    file = drive(record(), 20, lambda k: -100.0 if k >= 100 else 0.0, lambda k: -100.0 if k >= 200 else 0.0)
    found = mission(file.write())
    seen = list(found.observations())
    assert found.robots[0].clock == "log" and len(seen) == 200
    assert all(abs(s.T_map_base.x_m - seconds(s)) < 0.02 for s in seen)


def test_a_clock_that_is_set_forward_on_the_way_is_believed(record, mission):
    file = drive(record(), 20, lambda k: 500.0 if k >= 100 else 0.0, lambda k: 500.0 if k >= 200 else 0.0)
    found = mission(file.write())
    seen = list(found.observations())
    assert len(seen) >= 185
    assert all(abs(s.T_map_base.x_m - seconds(s) % 500) < 0.02 for s in seen)
    assert faults(found)["stamp_jump", "/tf"] == 9


def test_a_first_stamp_from_nowhere_moves_no_start(record, mission):
    found = mission(drive(record(), spoil=lambda k: -4000.0 if k == 0 else 0.0).write())
    assert len(list(found.observations())) == 79
    assert found.start_ns == EPOCH_NS + 110_000_000


def test_what_was_recorded_twice_counts_once(record, mission):
    file = drive(record())
    for k in range(10):
        file.scan(2.01 + k / 10, ranges=[2.0 + 0.01 * (40 + 2 * k)] * 8, log_s=2.0201 + k / 10)
    found = mission(file.write())
    assert len(list(found.observations())) == 80
    assert dropped(found)["repeated"] == 10


def test_stamps_of_whole_seconds_are_spread_by_the_recording(record, mission):
    found = mission(drive(record(), spoil=lambda k: -((k / 10 + 0.01) % 1)).write())
    seen = list(found.observations())
    assert len(seen) == 81
    assert noticed(found)["stamp_repeated"] >= 70
    steps = [seconds(b) - seconds(a) for a, b in pairwise(seen)]
    assert max(steps) < 0.35 and min(steps) >= 0


def test_the_time_of_recording_where_the_configuration_says_so(record, mission):
    path = drive(record(), spoil=lambda k: 0.3 * math.sin(k), spoil_tf=lambda k: 7.0).write()
    for options in ({"clock": "log"}, {"robots": {"run": {"clock": "log"}}}):
        found = mission(path, options.pop("robots", None), **options)
        seen = list(found.observations())
        assert found.robots[0].clock == "log" and len(seen) == 80
        assert not any("usable" in remark for remark in found.robots[0].remarks)
        assert [seconds(s) for s in seen] == pytest.approx([k / 10 + 0.02 for k in range(80)], abs=1e-6)
        assert all(s.T_map_base.x_m == pytest.approx(seconds(s), abs=1e-6) for s in seen)


def test_one_pose_that_jumps_is_left_out(record, mission):
    file = record()
    file.static("base_link", "laser")
    for k in range(81):
        t = k / 10
        file.tf(t, "map", "base_link", 500.0 if k == 40 else t)
        file.scan(t, ranges=[2.0 + 0.01 * k] * 8)
    found = mission(file.write())
    seen = list(found.observations())
    assert len(seen) == 80 and dropped(found) == {"pose_jump": 1}
    (sentence,) = found.tally.sentences()
    assert "the first, at 1700000004.000 s: its pose lies 496.1 m from the one 0.1 s before" in sentence


def test_a_robot_that_was_carried_goes_on_elsewhere(record, mission):
    file = record()
    file.static("base_link", "laser")
    for k in range(81):
        t = k / 10
        file.tf(t, "map", "base_link", t + (500.0 if k >= 40 else 0.0))
        file.scan(t, ranges=[2.0 + 0.01 * k] * 8)
    found = mission(file.write())
    assert len(list(found.observations())) == 79
    assert dropped(found) == {"pose_jump": 2} and noticed(found) == {"pose_jump": 1}
    fast = mission(file.write(), {"run": {"poses": {"max_speed_m_s": 6000.0}}})
    assert len(list(fast.observations())) == 81


def test_poses_that_are_no_numbers_are_counted_with_the_first(record, mission):
    file = record()
    file.static("base_link", "laser")
    for k in range(81):
        t = k / 10
        file.tf(t, "map", "base_link", math.nan if k in (20, 21) else t)
        file.scan(t, ranges=[2.0 + 0.01 * k] * 8)
    found = mission(file.write())
    seen = list(found.observations())
    assert faults(found) == {("pose_invalid", "/tf"): 2}
    assert "1700000002.000 s" in next(fault.sentence for _, fault in found.faults)
    assert len(seen) == 81 and all(s.T_map_base.x_m == pytest.approx(seconds(s), abs=1e-6) for s in seen)


def test_frames_with_two_parents_and_loops_are_named_with_their_beginning(record, mission):
    file = drive(record())
    file.tf(2.0, "map", "tag")
    file.tf(3.0, "shelf", "tag")
    file.tf(4.0, "cup", "table")
    file.tf(5.0, "table", "cup")
    found = mission(file.write())
    assert len(list(found.observations())) == 80
    assert faults(found) == {("two_parents", ""): 1, ("loop", "/tf"): 1}
    loop, two = (fault.sentence for _, fault in found.faults)
    assert "'tag' hangs on 'map' and from 1700000003.000 s on on 'shelf', too" in two
    assert loop.startswith("at 1700000005.000 s 'table' → 'cup' closes a loop with what was told before")


def test_frames_without_end_are_left_out_and_counted(record, mission, monkeypatch):
    """The robot's own frames are told first; each further one takes memory."""
    for module in ("timeline.feeds", "robots.glimpse"):
        monkeypatch.setattr(f"mapgraft.recording.{module}.MOST_EDGES", 10)
    file = drive(record())
    for k in range(30):
        file.tf(5.0 + k / 10, "map", f"tag{k}")
    found = mission(file.write())
    assert len(list(found.observations())) == 80
    ((key, count),) = faults(found).items()
    assert key == ("too_many_frames", "/tf") and 20 <= count < 30


def test_a_transform_that_closes_a_loop_costs_nothing_but_itself(record, mission):
    file = drive(record())
    for k in range(50):
        file.tf(4.0 + k / 20, "laser", "map", 3.0)
    found = mission(file.write())
    assert len(list(found.observations())) == 80
    assert faults(found) == {("loop", "/tf"): 1}


def test_a_mount_that_changes_is_named_and_the_last_word_counts(record, mission):
    file = drive(record())
    file.static("base_link", "laser", 0.5, log_s=3.0)
    found = mission(file.write())
    assert all((s.T_map_base.inverse() @ s.T_map_sensor).x_m == pytest.approx(0.5) for s in found.observations())
    assert faults(found) == {("static_changed", "/tf_static"): 1}


def two_robots(file, ahead_s):
    file.drive(10, prefix="a/", ns="/a")
    file.clock_s = ahead_s
    file.drive(10, prefix="b/", ns="/b")
    file.clock_s = 0.0
    return file.write()


def test_clocks_of_robots_that_one_recorder_heard_are_brought_together(record, mission):
    path = two_robots(record(), 4.0)
    found = mission(path)
    first = {s.robot: s for s in reversed(list(found.observations()))}
    assert first["b"].stamp_ns == first["a"].stamp_ns
    assert first["b"].recorded_ns - first["a"].recorded_ns == 4 * 10**9
    (remark,) = next(robot for robot in found.robots if robot.name == "b").remarks
    assert "its clock is moved by -4.000 s to that of a, by the recorder that heard both" in remark
    told = mission(path, {"b": {"clock_offset_s": 0.0}})
    first = {s.robot: s for s in reversed(list(told.observations()))}
    assert first["b"].stamp_ns - first["a"].stamp_ns == 4 * 10**9


def test_less_than_two_seconds_may_be_the_network(record, mission):
    found = mission(two_robots(record(), 1.9))
    assert not any(robot.remarks or robot.shift_ns for robot in found.robots)


def test_an_event_that_all_heard_brings_recorders_together(record, mission):
    paths = []
    for name, ahead_s in (("a", 0.0), ("b", 3.0)):
        file = record(name)
        file.drive(10, from_s=0.0)
        for k in range(8):
            file.pose(1.0 + k, "world", float(k), 0.0, 0.0, "/beacon")
        file._messages = [(t + round(ahead_s * 1e9), *rest) for t, *rest in file._messages]
        paths.append(file)
    a, b = paths
    path_a, path_b = a.write(), b.write()
    found = mission([path_a, path_b], common_event="/beacon", clock="log")
    assert all(robot.shift_ns == 0 for robot in found.robots), "times of recording are not moved"
    found = mission([path_a, path_b], common_event="/beacon")
    moved = {robot.name: robot.shift_ns for robot in found.robots}
    assert moved == {"a": 0, "b": -3 * 10**9}
    with pytest.raises(ConfigError, match=r"mission\.common_event: no file has messages on '/bell'"):
        mission([path_a, path_b], common_event="/bell")


@pytest.mark.parametrize(("alike", "said"), [(0, "no message"), (1, "only 1 message"), (2, "only 2 messages")])
def test_an_event_that_too_few_heard_moves_no_clock_and_that_is_said(record, mission, alike, said):
    paths = []
    for name, ahead_s in (("a", 0.0), ("b", 3.0)):
        file = record(name)
        file.drive(10, from_s=0.0)
        for k in range(5):
            file.pose(1.0 + k, "world", float(k) + (0.0 if k < alike else ahead_s), 0.0, 0.0, "/beacon")
        paths.append(file.write())
    found = mission(paths, common_event="/beacon")
    assert all(robot.shift_ns == 0 for robot in found.robots)
    (remark,) = [r for robot in found.robots for r in robot.remarks if "common_event" in r]
    assert remark.startswith(f"mission.common_event: {said} on /beacon came to b.mcap as to a.mcap, byte for byte")


def test_info_tells_it_all(record, mission):
    path = drive(record(), spoil=lambda k: zero_of(k / 10 + 0.01) if k == 20 else 0.0).write()
    found = survey([path], parse_config({}))
    assert any("(stamp_zero)" in problem for problem in found.problems)
    rows = {(loss.where, loss.topic, loss.cause): loss.count for loss in found.lost}
    assert rows["run", "/scan", "stamp_zero"] == 1
    (zero,) = [loss for loss in found.lost if loss.cause == "stamp_zero"]
    assert zero.sentence == "at 1700000002.010 s: its stamp is 0; the time of its recording counts"
    json.dumps(dataclasses.asdict(found))
    opened = mission(path)
    list(opened.observations())
    assert {loss.cause for loss in losses(opened)} == {"stamp_zero", "after_last"}
