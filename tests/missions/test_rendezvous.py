"""Robots that saw each other: a wrong merge is found out by it, a right one is surer, and all robots hear of it."""

from __future__ import annotations

from typing import Any

import pytest

import mapgraft
from mapgraft.config import parse_config
from mapgraft.contracts import ConfigError, Transform
from mapgraft.recording.mission import open_mission
from mapgraft_recordings import demo_files

FILES = demo_files()[0][:2]
BASE = {"exchange": {"use": "at", "seconds": [40], "at_end": False}, "mission": {"end_s": 60}}


@pytest.fixture(scope="module")
def poses() -> dict[tuple[str, int], Transform]:
    """Where both robots were at some seconds of the mission."""
    with open_mission(FILES, parse_config({})) as mission:
        return {(o.robot, round((o.stamp_ns - mission.start_ns) / 1e9)): o.T_map_base for o in mission.places()}


@pytest.fixture(scope="module")
def alone() -> mapgraft.Result:
    return mapgraft.run(FILES, BASE)


def meetings(poses, T: Transform, *seconds: int, **more: Any) -> list[dict[str, Any]]:
    """What is seen at these times where a transform is right."""
    told = []
    for second in seconds:
        z = poses["alpha", second].inverse() @ T @ poses["bravo", second]
        told.append(
            {"a": "alpha", "b": "bravo", "at_s": second, "x_m": z.x_m, "y_m": z.y_m, "yaw_rad": z.yaw_rad} | more
        )
    return told


def merged(result, receiver: str):
    return next(event for event in result.events if event.kind == "merged" and event.receiver == receiver)


def rendezvous(event) -> float:
    return next(m.value for m in event.measurements if m.name == "rendezvous")


def test_who_met_where_they_should_is_surer_and_both_know(poses, alone):
    T = merged(alone, "alpha").T_receiver_donor
    result = mapgraft.run(FILES, {**BASE, "meetings": meetings(poses, T, 15, 30)}, verify_ledger=True)
    for name in ("alpha", "bravo"):
        event = merged(result, name)
        assert rendezvous(event) > 5.0
        assert event.T_receiver_donor == merged(alone, name).T_receiver_donor
        confirmed = next(e for e in result.events if e.kind == "confirmed" and e.receiver == name)
        assert confirmed.evidence["rendezvous"] > 5.0 and "saw each other" in confirmed.reason
        assert result.kinds[name, "meetings"] > 100
    assert all(finding.sound for finding in result.ledgers)
    again = mapgraft.run(FILES, {**BASE, "meetings": meetings(poses, T, 15, 30)})
    assert [event.reason for event in again.events] == [event.reason for event in result.events]


def test_who_met_elsewhere_does_not_merge_there(poses, alone):
    T = merged(alone, "alpha").T_receiver_donor
    away = Transform.planar(T.x_m + 8.0, T.y_m - 5.0, T.yaw_rad + 1.0)
    result = mapgraft.run(FILES, {**BASE, "meetings": meetings(poses, away, 5, 20, 35)})
    assert not [event for event in result.events if event.kind == "merged"]
    turned_away = [event for event in result.events if event.kind in ("unmatched", "ambiguous")]
    assert {event.receiver for event in turned_away} == {"alpha", "bravo"}
    assert all("rendezvous -8 ≤ -5" in event.reason for event in turned_away)


def test_meetings_later_speak_for_or_against_what_stands(poses):
    """When the robots hear of them their merges are judged: eight nats, which new walls may outweigh."""
    config = {"exchange": {"use": "at", "seconds": [120, 135]}, "mission": {"end_s": 136}}
    before = mapgraft.run(FILES, config)
    T = merged(before, "alpha").T_receiver_donor
    away = Transform.planar(T.x_m + 8.0, T.y_m - 5.0, T.yaw_rad + 1.0)
    result = mapgraft.run(FILES, {**config, "meetings": meetings(poses, away, 121, 132)})

    def judged(one) -> float:
        events = [e for e in one.events if e.kind == "verified" and e.receiver == "alpha" and e.by == "sequential"]
        return events[-1].evidence["log_odds_wrong"]

    assert judged(result) == pytest.approx(judged(before) + 2 * 2.9957, abs=1e-3)
    assert all(event.state == "confirmed" for event in result.standing.values())


def test_who_is_no_robot_has_met_nobody():
    with pytest.raises(ConfigError, match=r"meetings: there is no robot 'nobody'"):
        mapgraft.run(FILES, {"meetings": [{"a": "alpha", "b": "nobody", "at_s": 1, "x_m": 1, "y_m": 1}]})
