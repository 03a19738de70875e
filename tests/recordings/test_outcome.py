"""What a run of the demo comes to, and how it is held against the truth."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import mapgraft
from mapgraft.contracts import Finding, Measurement, Transform
from mapgraft.events import Event, Kind
from mapgraft_recordings import demo_files
from mapgraft_recordings.drawn_plan import Alteration, DrawnPlan
from mapgraft_recordings.generate import generate
from mapgraft_recordings.outcome import Outcome, describe, differences, outcome_of, read_outcome, write_outcome
from mapgraft_recordings.simulator import START_NS, build_world, parse_plan
from mapgraft_recordings.told_apart import Apart, told_apart

FRAMES = {"alpha": (1.0, 2.0, 0.5), "bravo": (-3.0, 1.0, -2.0), "charlie": (0.0, 0.0, 3.0)}
TRUTH = {name: Transform.planar(*pose) for name, pose in FRAMES.items()}


def event(
    seq: int, kind: Kind, receiver: str, donor: str, off: tuple[float, float, float] | None, **more: Any
) -> Event:
    T = None if off is None else TRUTH[receiver].inverse() @ TRUTH[donor] @ Transform.planar(*off)
    return Event(seq, START_NS + seq * 10**9, kind, receiver, donor, T_receiver_donor=T, **more)


@pytest.fixture
def story() -> list[Event]:
    right, wrong = (0.1, 0.0, 0.02), (4.0, 0.0, math.pi)
    return [
        event(0, "offered", "alpha", "bravo", None),
        event(1, "merged", "alpha", "bravo", wrong, state="provisional"),
        event(2, "rejected", "alpha", "charlie", None),
        event(3, "verified", "alpha", "bravo", wrong, state="provisional"),
        event(4, "reverted", "alpha", "bravo", wrong, state="reverted"),
        event(5, "merged", "alpha", "charlie", right, state="provisional"),
        event(6, "merged", "alpha", "bravo", right, state="provisional"),
        event(7, "confirmed", "alpha", "bravo", right, state="confirmed"),
    ]


def test_events_are_judged_by_the_truth(story: list[Event]) -> None:
    outcome = outcome_of(story, FRAMES)
    assert [(told.kind, told.right) for told in outcome.events] == [
        ("merged", False),
        ("rejected", None),
        ("reverted", False),
        ("merged", True),
        ("merged", True),
        ("confirmed", True),
    ]
    assert [(merge.donor, merge.right) for merge in outcome.standing] == [("bravo", True), ("charlie", True)]
    assert (outcome.wrong_merges, outcome.wrong_reverts, outcome.rejections, outcome.pairs_right) == (1, 1, 1, 2)
    assert outcome.tells_the_story
    assert "is told" in describe(outcome)[-1]


@pytest.mark.parametrize("missing", [2, 4, 5])
def test_the_story_needs_all_its_parts(story: list[Event], missing: int) -> None:
    assert not outcome_of([told for told in story if told.seq != missing], FRAMES).tells_the_story


def test_a_wrong_merge_left_standing_spoils_the_story(story: list[Event]) -> None:
    late = event(8, "merged", "charlie", "alpha", (2.0, 0.0, 0.0), state="provisional")
    outcome = outcome_of([*story, late], FRAMES)
    assert not outcome.tells_the_story
    assert [merge.right for merge in outcome.standing] == [True, True, False]


def test_what_is_right_ends_at_half_a_metre_and_five_degrees(story: list[Event]) -> None:
    offs = [(0.49, 0, 0), (0.51, 0, 0), (0, 0, math.radians(4.9)), (0, 0, math.radians(5.1))]
    events = [event(n, "merged", "alpha", "bravo", off, state="provisional") for n, off in enumerate(offs)]
    assert [told.right for told in outcome_of(events, FRAMES).events] == [True, False, True, False]


def test_an_outcome_survives_its_file(story: list[Event], tmp_path: Path) -> None:
    outcome = outcome_of(story, FRAMES)
    write_outcome(tmp_path / "expected.json", outcome)
    assert read_outcome(tmp_path / "expected.json") == outcome
    assert json.loads((tmp_path / "expected.json").read_text())["T_world_map"]["alpha"] == [1.0, 2.0, 0.5]


def test_differences_are_found_and_small_ones_are_not(story: list[Event]) -> None:
    outcome = outcome_of(story, FRAMES)
    assert differences(outcome, outcome) == []
    near = [replace(told, stamp_ns=told.stamp_ns + 2 * 10**9) for told in story]
    assert differences(outcome, outcome_of(near, FRAMES)) == []
    late = [replace(told, stamp_ns=told.stamp_ns + 4 * 10**9) for told in story]
    assert len(differences(outcome, outcome_of(late, FRAMES))) == len(outcome.events)
    assert "6 events were expected, 5 found" in differences(outcome, outcome_of(story[:-1], FRAMES))[0]
    moved = [*story[:-1], event(7, "confirmed", "alpha", "bravo", (0.45, 0.0, 0.02), state="confirmed")]
    assert "has moved to" in "".join(differences(outcome, outcome_of(moved, FRAMES)))
    unmerged = [*story, event(8, "reverted", "alpha", "bravo", (0.1, 0.0, 0.02), state="reverted")]
    assert "standing at the end should be" in "".join(differences(outcome, outcome_of(unmerged, FRAMES)))


def test_a_run_of_the_demo_gives_the_expected_outcome() -> None:
    recording, config, expected_file = demo_files()
    expected = read_outcome(expected_file)
    assert expected.tells_the_story
    found = outcome_of(mapgraft.run(recording, config).events, expected.T_world_map)
    assert differences(expected, found) == []


@pytest.mark.slow
def test_most_seeds_tell_the_story(tmp_path: Path) -> None:
    told = [outcome_of_seed(seed, tmp_path / str(seed)) for seed in range(5)]
    assert sum(outcome.tells_the_story for outcome in told) >= 3, [describe(outcome) for outcome in told]


def outcome_of_seed(seed: int, folder: Path) -> Outcome:
    mission, paths = generate(seed, folder)
    return outcome_of(mapgraft.run(paths, folder / "config.yaml").events, mission.T_world_map)


def test_findings_are_told_apart_by_the_truth() -> None:
    room = {"walls": [{"line": [[0, 0], [6, 0], [6, 4], [0, 4], [0, 0]]}]}
    table = {"name": "table", "box": [2, 2, 1, 1]}
    world = build_world(parse_plan({"name": "a room", "floor": {**room, "furniture": [table]}}), seed=0)
    plan = DrawnPlan(alterations=[Alteration(name="screen", what="not built", line=(3.0, 1.0, 5.0, 1.0))])

    def finding(kind: str, x_m: float, y_m: float) -> Finding:
        return Finding(kind, (x_m - 101.0, y_m, 0.0), (x_m - 99.0, y_m, 0.0), 2.0, "m")

    told = (
        finding("wall missing", 4.0, 1.1),
        finding("wall added", 4.0, 1.1),  # of another kind, and nothing stands there
        finding("wall added", 2.5, 2.1),
        finding("wall missing", 2.5, 2.1),  # where the table stands, but no wall was drawn
    )
    measured = (Measurement("plan_deviations", 0.1, "1", 9, "lower", findings=told),)
    fields = {"receiver": "a", "donor": "plan", "merge_id": "a.plan.1", "measurements": measured}
    merged = Event(0, 1, "merged", state="provisional", **fields)
    frames = {"a": (100.0, 0.0, 0.0), "plan": (0.0, 0.0, 0.0)}
    assert told_apart([merged], frames, plan, world) == {"a": Apart(1, 1, 2)}
    assert told_apart([merged], frames, plan, world)["a"].findings == 4
    reverted = Event(1, 2, "reverted", state="reverted", receiver="a", donor="plan", merge_id="a.plan.1")
    assert told_apart([merged, reverted], frames, plan, world) == {}
