"""Virtual robots cut from one recording: every scan once, each with a map frame that begins at its first pose."""

from __future__ import annotations

import numpy as np
import pytest

from mapgraft.contracts import ConfigError, RecordingError

CUT = {
    "a": {"source": "run", "window": {"end_s": 3.0}},
    "b": {"source": "run", "window": {"start_s": 3.0, "end_s": 7.0}},
    "c": {"source": "run", "window": {"start_s": 7.0}},
}


def test_windows_cut_every_scan_once_and_keep_its_place(record, mission):
    path = record().drive(10).write()
    whole = {one.recorded_ns: one for one in mission(path).observations()}
    found = mission(path, CUT)
    seen = list(found.observations())
    assert sorted(one.recorded_ns for one in seen) == sorted(whole)
    assert {name: sum(one.robot == name for one in seen) for name in CUT} == {"a": 15, "b": 20, "c": 15}
    for one in seen:
        for own, known in ((one.T_map_sensor, "T_map_sensor"), (one.T_map_base, "T_map_base")):
            there = found.T_world_map[one.robot] @ own
            assert np.allclose(there.matrix, getattr(whole[one.recorded_ns], known).matrix, atol=1e-9)


def test_only_what_lies_in_a_window_is_counted(record, mission):
    """Files are read a little beyond a window, for poses around it."""
    found = mission(record().drive(10).write(), CUT)
    assert len(list(found.observations())) == 50
    assert {name: found.tally.of_robot(name) for name in CUT} == {"a": (15, 15), "b": (20, 20), "c": (15, 15)}
    assert sum(topic.read for topic in found.tally) > 50


def test_each_map_frame_begins_at_the_first_pose_and_all_begin_together(record, mission):
    found = mission(record().drive(10).write(), CUT)
    first = {one.robot: one for one in reversed(list(found.observations()))}
    for name in CUT:
        assert np.allclose(first[name].T_map_base.matrix, np.eye(4), atol=1e-12)
        assert first[name].stamp_ns == found.start_ns
    assert [robot.shift_ns for robot in found.robots] == [0, -3_000_000_000, -7_000_000_000]


def test_map_frames_do_not_depend_on_what_is_asked_for(record, mission):
    path = record().drive(10).write()
    all_of_it = mission(path, CUT).T_world_map
    some_of_it = mission(path, CUT, start_s=1.0, end_s=2.0, every=2).T_world_map
    assert all_of_it == some_of_it


def test_recorded_start_keeps_windows_one_after_another(record, mission):
    found = mission(record().drive(10).write(), CUT, start="recorded")
    seen = list(found.observations())
    assert all(one.stamp_ns == one.recorded_ns for one in seen)
    assert [one.robot for one in seen] == ["a"] * 15 + ["b"] * 20 + ["c"] * 15


def test_a_map_frame_stays_level_on_a_robot_that_is_not(record, mission):
    file = record()
    file.static("base_link", "laser")
    for k in range(101):
        file.tf(k / 20, "odom", "base_link", 1.0, 2.0, 0.3, upside_down=True)
    for k in range(20):
        file.scan(0.1 + k / 5)
    found = mission(file.write(), {"a": {"source": "run", "window": {"end_s": 9.0}}})
    one = next(iter(found.observations()))
    assert one.T_map_base.matrix[2, 2] == pytest.approx(-1.0)
    assert (one.T_map_base.x_m, one.T_map_base.y_m) == pytest.approx((0.0, 0.0))


def test_windows_that_hold_nothing(record, mission):
    path = record().drive(10).write()
    with pytest.raises(RecordingError, match="robot a cannot be mapped: nothing on /scan lies in its window"):
        mission(path, {"a": {"source": "run", "window": {"start_s": 500.0}}})
    blind = record("blind").drive(10)
    for k in range(10):
        blind.scan(20.0 + k)
    with pytest.raises(RecordingError, match=r"no scan in its window has a pose .*after_last"):
        mission(blind.write(), {"a": {"source": "blind", "window": {"start_s": 15.0}}})


def test_the_same_data_twice_is_refused(record, mission):
    path = record().drive(10).write()
    with pytest.raises(ConfigError, match="robots a and b are both taken from 'run': give each a window"):
        mission(path, {"a": {"source": "run"}, "b": {"source": "run", "window": {"end_s": 3.0}}})


def test_a_window_of_ready_maps_keeps_their_frame(record, mission):
    file = record("maps").drive(10, scans=False)
    for k in range(10):
        file.grid(0.5 + k)
    found = mission(file.write(), {"a": {"source": "maps", "window": {"start_s": 2.0, "end_s": 5.0}}})
    seen = list(found.observations())
    assert len(seen) == 3
    assert all(np.array_equal(one.T_map_sensor.matrix, np.eye(4)) for one in seen)
