"""Topics on which robots tell where others are, and meetings that somebody knows of."""

from __future__ import annotations

import math

import pytest

from mapgraft.contracts import ConfigError
from mapgraft.rendezvous import Sighted

TOLD = {"run": {"sightings": [{"robot": "other", "topic": "/sees", "sigma_m": 0.3}]}}


def seen(found) -> list[Sighted]:
    return [entry for entry in found.timeline() if isinstance(entry, Sighted)]


def told(record, frame="base_link"):
    file = record("run").drive(6)
    file.pose(2.5, frame, 3.0, 1.0, 0.5, "/sees")
    file.pose(4.5, frame, 2.0, 1.0, 0.5, "/sees")
    return file.write()


def test_a_topic_tells_it_between_the_observations(record, mission):
    found = mission(told(record), TOLD)
    entries = list(found.timeline())
    first, second = [entry for entry in entries if isinstance(entry, Sighted)]
    at = entries.index(first)
    assert entries[at - 1].stamp_ns <= first.stamp_ns <= entries[at + 1].stamp_ns
    assert (first.robot, first.other, first.seen_ns) == ("run", "other", first.stamp_ns)
    assert second.seen_ns - first.seen_ns == 2 * 10**9
    assert first.seen[:2] == (3.0, 1.0) and math.isnan(first.seen.yaw_rad) and first.seen.sigma_m == 0.3
    assert sum(1 for _ in found.observations()) == len(entries) - 2
    assert "/sees" in {topic for topic in ("/sees",) if found.readers_of(found.glimpses[0].source.path, topic)}


def test_with_a_standard_deviation_the_heading_counts(record, mission):
    config = {"run": {"sightings": [{"robot": "other", "topic": "/sees", "sigma_yaw_rad": 0.2}]}}
    first, _ = seen(mission(told(record), config))
    assert first.seen == pytest.approx((3.0, 1.0, 0.5, 0.2, 0.2))


def test_what_a_sensor_sees_is_seen_from_the_base(record, mission):
    first, _ = seen(mission(told(record, "laser"), TOLD))  # mounted 0.2 m before the base
    assert first.seen[:2] == pytest.approx((3.2, 1.0))


def test_what_lies_in_a_frame_that_moves_is_counted(record, mission):
    found = mission(told(record, "odom"), TOLD)
    assert not seen(found)
    (fault,) = [fault for _, fault in found.faults if fault.cause == "sighting_frame"]
    assert fault.count == 2 and "'odom', which is not fixed to 'base_link'" in fault.sentence


def test_what_comes_before_or_after_the_mission_is_not_told(record, mission):
    assert len(seen(mission(told(record), TOLD, end_s=3.0))) == 1
    assert len(seen(mission(told(record), TOLD, start_s=3.0))) == 1


def test_a_topic_that_is_not_there_is_refused(record, mission):
    config = {"run": {"sightings": [{"robot": "other", "topic": "/nowhere"}]}}
    with pytest.raises(ConfigError, match=r"robots.run.sightings: there is no topic of poses '/nowhere': .* has /sees"):
        mission(told(record), config)
