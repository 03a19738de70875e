"""Robots whose map frame begins anew: in another file, at a time, or when a topic says so."""

from __future__ import annotations

import pytest

from mapgraft.contracts import ConfigError


def frame_of(recorder, map_frame: str, until_s: float, from_s: float = 0.0, x: float = 0.0):
    """A robot that drives in a map frame of its own name, beginning at x."""
    recorder.static("base_link", "laser", 0.2, topic="/tf_static")
    for k in range(round((until_s - from_s) * 20) + 1):
        t = from_s + k / 20
        recorder.tf(t, map_frame, "odom", x)
        recorder.tf(t, "odom", "base_link", 0.5 * (t - from_s))
        if k % 4 == 0 and t < until_s:
            recorder.scan(t + 0.017)
    return recorder


def seen(found) -> dict[str, list]:
    """Robot → the x of its observations, and how many there are."""
    out: dict[str, list] = {}
    for one in found.observations():
        out.setdefault(one.robot, []).append(one)
    return out


def test_another_frame_in_a_later_file_is_another_life(record, mission):
    first = frame_of(record("run1"), "map", 4).write()
    second = frame_of(record("run2"), "map_b", 14, from_s=10).write()
    found = mission([first, second], {"anna": {"files": ["run1", "run2"]}}, start="recorded")
    lives = {robot.name: (robot.life, robot.follows, robot.map_frame) for robot in found.robots}
    assert lives == {"anna": (1, "", "map"), "anna~2": (2, "anna", "map_b")}
    by_name = seen(found)
    assert {name: len(them) for name, them in by_name.items()} == {"anna": 20, "anna~2": 20}
    assert by_name["anna~2"][0].stamp_ns - by_name["anna"][0].stamp_ns == 10 * 10**9
    assert not found.T_world_map


def test_lives_keep_their_distance_where_robots_come_to_a_common_start(record, mission):
    files = [frame_of(record("run1"), "map", 4).write(), frame_of(record("run2"), "map_b", 14, from_s=10).write()]
    other = frame_of(record("other"), "map", 104, from_s=100).write()
    found = mission([*files, other], {"anna": {"files": ["run1", "run2"]}, "bert": {"files": ["other"]}})
    starts = {name: them[0].stamp_ns for name, them in seen(found).items()}
    assert starts["anna"] == starts["bert"] and starts["anna~2"] - starts["anna"] == 10 * 10**9


def test_the_same_frame_in_several_files_is_one_life(record, mission):
    files = [frame_of(record("run1"), "map", 4).write(), frame_of(record("run2"), "map", 14, from_s=10).write()]
    found = mission(files, {"anna": {"files": ["run1", "run2"]}})
    assert [robot.name for robot in found.robots] == ["anna"] and len(seen(found)["anna"]) == 40
    anew = mission(files, {"anna": {"files": ["run1", "run2"], "restarts": "files"}})
    assert [robot.name for robot in anew.robots] == ["anna", "anna~2"]


def test_a_time_cuts_the_recording_and_its_transforms(record, mission):
    """The frame jumps by 100 m within 50 ms: nothing is interpolated across."""
    recorder = frame_of(record("run"), "map", 5)
    path = frame_of(recorder, "map", 10, from_s=5.05, x=100.0).write()
    found = mission(path, {"run": {"restarts": [5.03]}})
    by_name = seen(found)
    assert max(one.T_map_base.x_m for one in by_name["run"]) < 3.0
    assert min(one.T_map_base.x_m for one in by_name["run~2"]) >= 100.0
    assert [len(them) for them in by_name.values()] == [25, 25]
    whole = mission(path)
    jumped = [one for one in whole.observations() if 3.0 < one.T_map_base.x_m < 100.0]
    assert jumped or len(seen(whole)["run"]) < 50


def test_a_topic_tells_when(record, mission):
    recorder = frame_of(record("run"), "map", 10)
    recorder.text(3.0, "/slam/reset")
    recorder.text(7.0, "/slam/reset")
    found = mission(recorder.write(), {"run": {"restarts": "/slam/reset"}})
    lives = {name: (them[0].stamp_ns, len(them)) for name, them in seen(found).items()}
    assert list(lives) == ["run", "run~2", "run~3"] and sum(n for _, n in lives.values()) == 50
    assert [robot.follows for robot in found.robots] == ["", "run", "run~2"]


def test_each_life_of_a_window_begins_at_its_own_first_pose(record, mission):
    path = frame_of(record("run"), "map", 10).write()
    robot = {"source": "run", "window": {"start_s": 2.0}, "restarts": [6.0]}
    for them in seen(mission(path, {"cut": robot})).values():
        assert abs(them[0].T_map_base.x_m) < 1e-9


@pytest.mark.parametrize(
    ("restarts", "sentence"),
    [
        ("/nowhere", r"robots.run.restarts: there is no message on '/nowhere'"),
        ("files", r"robots.run.restarts: files says that .* only one"),
        ([k / 100 for k in range(200)], r"begins anew 200 times or more: 99 are allowed"),
    ],
)
def test_what_cannot_be_meant_is_refused(record, mission, restarts, sentence):
    with pytest.raises(ConfigError, match=sentence):
        mission(frame_of(record("run"), "map", 4).write(), {"run": {"restarts": restarts}})


def test_files_of_one_time_are_no_lives(record, mission):
    files = [frame_of(record("run1"), "map", 4).write(), frame_of(record("run2"), "map", 5, from_s=1).write()]
    with pytest.raises(ConfigError, match=r"run1.mcap and run2.mcap were recorded at the same time"):
        mission(files, {"anna": {"files": ["run1", "run2"], "restarts": "files"}})
