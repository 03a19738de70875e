"""What findings of a plan's deviations are, held against the truth: mistakes of the plan, furniture, or neither."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Finding, Transform
from mapgraft.events import Event
from mapgraft_recordings.drawn_plan import DrawnPlan
from mapgraft_recordings.outcome import FOUND_M, STANDING
from mapgraft_recordings.simulator import World, distance_to_walls
from mapgraft_recordings.simulator.simulation import Pose

FURNITURE_M = 0.3  # the middle of a finding that is furniture lies no further from its outline


@dataclass(frozen=True, slots=True)
class Apart:
    """How many findings there are in one robot's standing merges, and what they are."""

    mistakes: int = 0
    furniture: int = 0
    neither: int = 0

    @property
    def findings(self) -> int:
        return self.mistakes + self.furniture + self.neither


def told_apart(
    events: Sequence[Event], T_world_map: Mapping[str, Pose], plan: DrawnPlan, world: World
) -> dict[str, Apart]:
    """Receiver → its latest findings by what they are.

    One is a mistake of the plan where its kind is that of an alteration and its middle lies no more than 0.2 m off it,
    else furniture where a wall was said to be added and its middle lies within 0.3 m of the outline of a thing.
    """
    latest: dict[str, dict[str, Sequence[Finding]]] = {}
    for event in events:
        mine = latest.setdefault(event.receiver, {})
        if event.kind == "reverted":
            mine.pop(event.merge_id, None)
        for measurement in event.measurements:
            if measurement.findings and event.state in STANDING:
                mine[event.merge_id] = measurement.findings
    out = {}
    for robot, merges in sorted(latest.items()):
        found = [finding for findings in merges.values() for finding in findings]
        if found:
            out[robot] = _counted(found, Transform.planar(*T_world_map[robot]), plan, world)
    return out


def _counted(found: Sequence[Finding], T_world_map: Transform, plan: DrawnPlan, world: World) -> Apart:
    middles = T_world_map.apply(np.array([(f.start_m[:2], f.end_m[:2]) for f in found]).mean(axis=1))
    mistake = np.zeros(len(found), np.bool_)
    for change in plan.alterations:
        low, high = change.bounds_m
        near = ((middles >= low - FOUND_M) & (middles <= high + FOUND_M)).all(axis=1)
        mistake |= near & np.array([f.kind == change.found_as for f in found])
    added = np.array([f.kind == "wall added" for f in found])
    thing = ~mistake & added & (distance_to_walls(middles, _outlines_of_things(world)) <= FURNITURE_M)
    return Apart(int(mistake.sum()), int(thing.sum()), int((~mistake & ~thing).sum()))


def _outlines_of_things(world: World) -> NDArray[np.float64]:
    of_walls = np.repeat(np.isinf(world.tops_m), [len(polygon) for polygon in world.polygons])
    outlines: NDArray[np.float64] = world.segments[~of_walls]
    return outlines
