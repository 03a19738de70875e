"""What a robot needs to map anew when it learns that it was elsewhere: its observations, and where they belong now."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from mapgraft.contracts import CLOUD_MAP, GRID_MESSAGE, Observation
from mapgraft.recording.poses.rigid import (
    Pose7,
    angle_of,
    compose,
    from_transform,
    interpolate,
    inverse,
    to_transform,
)

LEAST_M: Final = 0.005
LEAST_RAD: Final = 0.0005
"""A correction that moves no scan farther than both of these says what was known: 0.5 mrad is 5 mm at 10 m."""


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """Other poses of one robot's base in its map frame, for some times in the past.

    ``stamp_ns`` is when the robot learns of them, on the mission's timeline; ``recorded_ns`` (rising) are their own
    stamps by the robot's clock, as ``Observation.recorded_ns``, and ``T_map_base`` the poses.
    """

    robot: str
    stamp_ns: int
    recorded_ns: Sequence[int]
    T_map_base: Sequence[Pose7]


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """All observations of a robot at their new places; how many have moved, and how far at most."""

    observations: tuple[Observation, ...]
    moved: int
    farthest_m: float
    most_rad: float

    @property
    def reason(self) -> str:
        """One sentence for a person."""
        turned = f"{math.degrees(self.most_rad):.2f}°"
        of = len(self.observations)
        every = f"{self.moved:,} of {of:,} observation{'s' * (of != 1)} moved"
        return f"{every}, by up to {self.farthest_m:.2f} m, {turned}"


@dataclass(slots=True)
class Recollection:
    """A robot's observations since the start, as they lie in its map now."""

    observations: list[Observation] = field(default_factory=list)

    def corrected(self, correction: Correction) -> Corrected | None:
        """Where all observations belong by a correction; None where it moves nothing.

        An observation at one of its stamps takes the pose that it says. Between two stamps, and after the last one,
        the robot has moved as it was thought to, seen from the stamps on both sides: the nearer one counts more. What
        was observed before the first stamp stays, and so do ready-made maps, which lie where their maker put them.
        """
        anchors = list(_anchors(self.observations, correction))
        stamps = [anchor.recorded_ns for anchor in anchors]
        first_ns = correction.recorded_ns[0] if correction.recorded_ns else 0
        moved, farthest_m, most_rad = 0, 0.0, 0.0
        placed: list[Observation] = []
        for one in self.observations:
            if not anchors or one.recorded_ns < first_ns or one.kind in _READY:
                placed.append(one)
                continue
            T_old = from_transform(one.T_map_base)
            T_new = _new_pose(one.recorded_ns, T_old, anchors, stamps)
            shift_m, turn_rad = math.dist(T_old[:3], T_new[:3]), angle_of(compose(inverse(T_old), T_new))
            farthest_m, most_rad = max(farthest_m, shift_m), max(most_rad, turn_rad)
            moved += shift_m > LEAST_M or turn_rad > LEAST_RAD
            placed.append(_at(one, T_old, T_new))
        return Corrected(tuple(placed), moved, farthest_m, most_rad) if moved else None


_READY: Final = frozenset((GRID_MESSAGE, CLOUD_MAP))


class _Anchor(NamedTuple):
    """One pose of a correction, and the pose that it takes the place of."""

    recorded_ns: int
    T_old: Pose7
    T_new: Pose7


def _anchors(observations: Sequence[Observation], correction: Correction) -> Iterator[_Anchor]:
    """The poses of a correction at whose stamps it is known where the robot was thought to be."""
    known = {one.recorded_ns: one for one in observations if one.kind not in _READY}
    stamps = sorted(known)
    for recorded_ns, T_new in zip(correction.recorded_ns, correction.T_map_base, strict=True):
        after = bisect_left(stamps, recorded_ns)
        if after == len(stamps) or (stamps[after] != recorded_ns and after == 0):
            continue
        T_after = from_transform(known[stamps[after]].T_map_base)
        if stamps[after] == recorded_ns:
            yield _Anchor(recorded_ns, T_after, T_new)
            continue
        T_before = from_transform(known[stamps[after - 1]].T_map_base)
        share = (recorded_ns - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        yield _Anchor(recorded_ns, interpolate(T_before, T_after, share), T_new)


def _new_pose(recorded_ns: int, T_old: Pose7, anchors: Sequence[_Anchor], stamps: Sequence[int]) -> Pose7:
    after = bisect_right(stamps, recorded_ns)
    if after and stamps[after - 1] == recorded_ns:
        return anchors[after - 1].T_new
    if after == 0 or after == len(anchors):
        return _carried(anchors[min(after, len(anchors) - 1)], T_old)
    before, behind = anchors[after - 1], anchors[after]
    share = (recorded_ns - before.recorded_ns) / (behind.recorded_ns - before.recorded_ns)
    return interpolate(_carried(before, T_old), _carried(behind, T_old), share)


def _carried(anchor: _Anchor, T_old: Pose7) -> Pose7:
    """A pose that lies to the anchor's new one as it lay to the old one."""
    return compose(anchor.T_new, compose(inverse(anchor.T_old), T_old))


def _at(observation: Observation, T_old: Pose7, T_new: Pose7) -> Observation:
    """The observation at another place; the sensor stays where it is on the robot."""
    T_map_base = to_transform(T_new)
    if observation.T_map_sensor == observation.T_map_base:
        return replace(observation, T_map_base=T_map_base, T_map_sensor=T_map_base)
    T_base_sensor = compose(inverse(T_old), from_transform(observation.T_map_sensor))
    return replace(observation, T_map_base=T_map_base, T_map_sensor=to_transform(compose(T_new, T_base_sensor)))
