"""Topics on which robots tell anew where they were."""

from __future__ import annotations

import pytest

from mapgraft.contracts import ConfigError
from mapgraft.correction import Correction


def told(record, frame="map", log_s=3.5, **given):
    file = record("run").drive(6, **given)
    file.path_of({k / 5 + 0.017: (float(k), 1.0, 0.0) for k in range(5, 15)}, frame, log_s)
    return file.write()


def corrections(found):
    return [entry for entry in found.timeline() if isinstance(entry, Correction)]


def test_a_path_comes_between_the_observations_when_it_was_recorded(record, mission):
    found = mission(told(record), {"run": {"poses": {"corrections": "/path"}}})
    assert found.robots[0].corrections == "/path"
    entries = list(found.timeline())
    (at,) = [k for k, entry in enumerate(entries) if isinstance(entry, Correction)]
    assert entries[at - 1].stamp_ns <= entries[at].stamp_ns < entries[at + 1].stamp_ns
    assert len(entries) == 31
    one = entries[at]
    assert len(one.recorded_ns) == 10 and one.T_map_base[3][:3] == (8.0, 1.0, 0.0)
    assert set(one.recorded_ns) <= {seen.recorded_ns for seen in found.observations()}


def test_without_configuration_nobody_listens(record, mission):
    found = mission(told(record))
    assert not corrections(found) and found.robots[0].corrections == ""


def test_poses_in_another_frame_are_counted(record, mission):
    found = mission(told(record, frame="odom"), {"run": {"poses": {"corrections": "/path"}}})
    assert not corrections(found)
    (fault,) = [fault for _, fault in found.faults if fault.cause == "correction_frame"]
    assert fault.count == 10
    assert fault.sentence == "a corrected pose lies in the frame 'odom', not in 'map': it is left out"


def test_what_comes_before_or_after_the_mission_is_not_told(record, mission):
    path = told(record)
    robots = {"run": {"poses": {"corrections": "/path"}}}
    assert not corrections(mission(path, robots, end_s=3.0))
    assert not corrections(mission(path, robots, start_s=4.0))
    assert len(corrections(mission(path, robots, start_s=3.0, end_s=4.0))) == 1


def test_a_window_moves_the_corrected_poses_into_its_own_frame(record, mission):
    window = {"source": "run", "window": {"start_s": 1.0, "end_s": 5.0}, "poses": {"corrections": "/path"}}
    (whole,) = corrections(mission(told(record), {"run": {"poses": {"corrections": "/path"}}}))
    found = mission(told(record), {"cut": window})
    (cut,) = corrections(found)
    assert cut.robot == "cut" and cut.recorded_ns == whole.recorded_ns
    assert cut.T_map_base != whole.T_map_base


@pytest.mark.parametrize(
    ("poses", "robot", "sentence"),
    [
        ({"corrections": "/nowhere"}, {}, r"there is no topic '/nowhere' of type nav_msgs/msg/Path: .* has /path$"),
        ({"corrections": "/scan"}, {}, r"there is no topic '/scan' of type nav_msgs/msg/Path"),
        ({"corrections": "/path"}, {"clock": "log"}, r"what tells the time of run's scans is their time of recording"),
    ],
)
def test_what_cannot_be_used_is_refused(record, mission, poses, robot, sentence):
    with pytest.raises(ConfigError, match=sentence):
        mission(told(record), {"run": {"poses": poses, **robot}})
