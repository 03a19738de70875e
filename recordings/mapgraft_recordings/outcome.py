"""What came of a run, held against the truth: which merges were right, which stood in the end."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from mapgraft.contracts import Finding, Transform
from mapgraft.events import Event
from mapgraft_recordings.drawn_plan import Alteration, DrawnPlan
from mapgraft_recordings.simulator.simulation import START_NS, Pose

RIGHT_M, RIGHT_RAD = 0.5, math.radians(5.0)  # a merge is right when its transform is no further from the truth
FOUND_M = 0.2  # a mistake of a plan is found when the middle of a finding is no further from it
SAME_M, SAME_RAD, SAME_S = 0.3, math.radians(2.0), 3.0  # two runs agree when they differ by no more
STANDING = ("provisional", "confirmed")
TOLD = frozenset({"rejected", "unmatched", "ambiguous", "merged", "confirmed", "reverted"})


@dataclass(frozen=True, slots=True)
class Told:
    """One event of the story. ``right`` says whether its transform is true; None where it has none."""

    time_s: float
    kind: str
    receiver: str
    donor: str
    right: bool | None


@dataclass(frozen=True, slots=True)
class Standing:
    """A merge that stands at the end, with its transform (x, y, yaw)."""

    receiver: str
    donor: str
    right: bool
    T_receiver_donor: Pose


@dataclass(frozen=True, slots=True)
class Outcome:
    """The story of a run: its decisions in order, and what stands at the end.

    ``found`` tells which robots reported each of the things in which a plan differs from the building, by its name.
    """

    T_world_map: Mapping[str, Pose]
    events: tuple[Told, ...]
    standing: tuple[Standing, ...]
    found: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def wrong_merges(self) -> int:
        return sum(told.kind == "merged" and told.right is False for told in self.events)

    @property
    def wrong_reverts(self) -> int:
        """How many wrong merges were found out."""
        return sum(told.kind == "reverted" and told.right is False for told in self.events)

    @property
    def rejections(self) -> int:
        return sum(told.kind == "rejected" for told in self.events)

    @property
    def pairs_right(self) -> int:
        """How many pairs of robots are rightly merged at the end, in at least one direction."""
        return len({frozenset((merge.receiver, merge.donor)) for merge in self.standing if merge.right})

    @property
    def tells_the_story(self) -> bool:
        """A wrong merge was accepted and found out, right ones stand and no wrong one, something was rejected."""
        return (
            self.wrong_merges > 0
            and self.wrong_reverts == self.wrong_merges
            and self.rejections > 0
            and self.pairs_right >= 2
            and all(merge.right for merge in self.standing)
        )


def outcome_of(events: Sequence[Event], T_world_map: Mapping[str, Pose]) -> Outcome:
    """The story in a run's events, judged by where the robots' map frames truly lie."""
    truth = {name: Transform.planar(*pose) for name, pose in T_world_map.items()}
    told = []
    last: dict[tuple[str, str], Event] = {}
    for event in events:
        right = _is_right(event, truth) if event.T_receiver_donor else None
        if event.kind in TOLD:
            time_s = round((event.stamp_ns - START_NS) / 1e9, 2)
            told.append(Told(time_s, event.kind, event.receiver, event.donor, right))
        if event.state:
            last[event.receiver, event.donor] = event
    standing = tuple(
        Standing(event.receiver, event.donor, _is_right(event, truth), _pose(event.T_receiver_donor))
        for event in last.values()
        if event.state in STANDING and event.T_receiver_donor
    )
    return Outcome(T_world_map, tuple(told), tuple(sorted(standing, key=lambda s: (s.receiver, s.donor))))


def with_deviations(outcome: Outcome, events: Sequence[Event], plan: DrawnPlan) -> Outcome:
    """The outcome, with what findings in standing merges tell of the alterations of a plan in the world's frame.

    An alteration is reported when a finding of its kind lies with its middle no more than 0.2 m off it.
    """
    truth = {name: Transform.planar(*pose) for name, pose in outcome.T_world_map.items()}
    reported: dict[str, tuple[Finding, ...]] = {}
    for event in events:
        for measurement in event.measurements:
            if measurement.findings and event.state in STANDING:
                reported[event.receiver] = tuple(measurement.findings)
    found = {
        change.name: tuple(name for name, told in sorted(reported.items()) if _tells(told, truth[name], change))
        for change in plan.alterations
    }
    return replace(outcome, found=found)


def describe(outcome: Outcome) -> list[str]:
    """The story in lines for a person."""
    words = {True: "right", False: "wrong", None: ""}
    lines = [
        f"{told.time_s:7.1f} s  {told.receiver} ← {told.donor}: {told.kind} {words[told.right]}".rstrip()
        for told in outcome.events
    ]
    lines += [f"standing: {merge.receiver} ← {merge.donor}, {words[merge.right]}" for merge in outcome.standing]
    lines += [f"{name}: found by {', '.join(robots) or 'nobody'}" for name, robots in outcome.found.items()]
    said = "is told" if outcome.tells_the_story else "is not told"
    return [*lines, f"the story of a wrong merge found out, right ones found and one rejection {said}"]


def write_outcome(path: Path, outcome: Outcome) -> None:
    """Write an outcome as JSON that a person can read."""
    lines = ",\n    ".join(json.dumps(asdict(told)) for told in outcome.events)
    merges = ",\n    ".join(json.dumps(asdict(merge)) for merge in outcome.standing)
    frames = ",\n    ".join(f"{json.dumps(name)}: {json.dumps(pose)}" for name, pose in outcome.T_world_map.items())
    found = ",\n    ".join(f"{json.dumps(name)}: {json.dumps(robots)}" for name, robots in outcome.found.items())
    path.write_text(
        f'{{\n  "T_world_map": {{\n    {frames}\n  }},\n'
        f'  "events": [\n    {lines}\n  ],\n  "standing": [\n    {merges}\n  ]'
        + (f',\n  "found": {{\n    {found}\n  }}' if found else "")
        + "\n}\n",
        encoding="utf-8",
    )


def read_outcome(path: Path) -> Outcome:
    """Read what ``write_outcome`` wrote."""
    given = json.loads(path.read_text(encoding="utf-8"))
    return Outcome(
        {name: _tuple(pose) for name, pose in given["T_world_map"].items()},
        tuple(Told(**told) for told in given["events"]),
        tuple(
            Standing(merge["receiver"], merge["donor"], merge["right"], _tuple(merge["T_receiver_donor"]))
            for merge in given["standing"]
        ),
        {name: tuple(robots) for name, robots in given.get("found", {}).items()},
    )


def differences(expected: Outcome, found: Outcome) -> list[str]:
    """Where two outcomes differ by more than the tolerances, one sentence each; empty when they agree."""
    out = []
    if len(expected.events) != len(found.events):
        out.append(f"{len(expected.events)} events were expected, {len(found.events)} found")
    for n, (a, b) in enumerate(zip(expected.events, found.events, strict=False)):
        same = (a.kind, a.receiver, a.donor, a.right) == (b.kind, b.receiver, b.donor, b.right)
        if not same or abs(a.time_s - b.time_s) > SAME_S:
            out.append(f"event {n} should be {a}, found {b}")
    stands = {(merge.receiver, merge.donor): merge for merge in found.standing}
    if stands.keys() != {(merge.receiver, merge.donor) for merge in expected.standing}:
        out.append(f"standing at the end should be {expected.standing}, found {found.standing}")
    for merge in expected.standing:
        other = stands.get((merge.receiver, merge.donor))
        if other and not _near(merge.T_receiver_donor, other.T_receiver_donor, SAME_M, SAME_RAD):
            out.append(f"{merge} has moved to {other.T_receiver_donor}")
    if dict(expected.found) != dict(found.found):
        out.append(f"of the plan's alterations {dict(expected.found)} should be found, were {dict(found.found)}")
    return out


def _tells(findings: Sequence[Finding], T_world_map: Transform, change: Alteration) -> bool:
    ends = np.array([(f.start_m[:2], f.end_m[:2]) for f in findings if f.kind == change.found_as]).reshape(-1, 2, 2)
    middles = T_world_map.apply(ends.mean(axis=1))
    low, high = change.bounds_m
    return bool(((middles >= low - FOUND_M) & (middles <= high + FOUND_M)).all(axis=1).any())


def _is_right(event: Event, truth: Mapping[str, Transform]) -> bool:
    assert event.T_receiver_donor is not None
    T_receiver_donor = truth[event.receiver].inverse() @ truth[event.donor]
    shift_m, turn_rad = T_receiver_donor.difference(event.T_receiver_donor)
    return shift_m <= RIGHT_M and turn_rad <= RIGHT_RAD


def _near(a: Pose, b: Pose, metres: float, radians: float) -> bool:
    shift_m, turn_rad = Transform.planar(*a).difference(Transform.planar(*b))
    return shift_m <= metres and turn_rad <= radians


def _pose(transform: Transform | None) -> Pose:
    assert transform is not None
    return (round(transform.x_m, 4), round(transform.y_m, 4), round(transform.yaw_rad, 6))


def _tuple(values: Sequence[float]) -> Pose:
    x, y, yaw = values
    return (x, y, yaw)
