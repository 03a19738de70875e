"""Robots that see each other: what one robot knows of it, what it tells the others, and what follows for a pair."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from mapgraft.contracts import Observation, Sighting
from mapgraft.graph.claims import Source
from mapgraft.lives import base_name
from mapgraft.recording.poses.rigid import Pose7, from_transform, interpolate, to_transform

METRIC: Final = "rendezvous"
MOST: Final = 64  # sightings of one robot by another that are kept and told
FARTHEST: Final = 1e6  # metres or radians
GAP_NS: Final = 2_000_000_000  # the poses on both sides of a sighting may lie so far apart


class Seen(NamedTuple):
    """Where another robot's base lay in one's own: metres, radians (NaN where only the place is known), sigmas."""

    x_m: float
    y_m: float
    yaw_rad: float
    sigma_m: float
    sigma_yaw_rad: float


@dataclass(frozen=True, slots=True)
class Sighted:
    """An entry of the timeline: ``robot`` saw ``other`` at ``seen_ns``, and it is told at ``stamp_ns``."""

    robot: str
    stamp_ns: int
    seen_ns: int
    other: str
    seen: Seen


class Record(NamedTuple):
    """What a robot tells another of one time: where it was in its own map frame, and where it saw the other, if so."""

    stamp_ns: int
    T_map_base: Pose7
    seen: Seen | None = None


@dataclass(slots=True)
class Rendezvous:
    """What one robot knows of meetings: its own way, whom it saw, and what others told it.

    Of one other robot no more than ``MOST`` sightings are kept, spread over the time in which it was seen.
    """

    _stamps_ns: list[int] = field(default_factory=list)
    _poses: list[Pose7] = field(default_factory=list)
    _seen: dict[str, dict[int, Seen]] = field(default_factory=dict)  # by the other's own name and when
    _told: dict[Source, tuple[Record, ...]] = field(default_factory=dict)
    _spacing_ns: dict[str, int] = field(default_factory=dict)

    def moved(self, observation: Observation) -> None:
        """The robot has observed something, and knows where it was."""
        if not self._stamps_ns or observation.stamp_ns > self._stamps_ns[-1]:
            self._stamps_ns.append(observation.stamp_ns)
            self._poses.append(from_transform(observation.T_map_base))

    def corrected(self, observations: Iterable[Observation]) -> None:
        """The robot has learnt where it had been."""
        self._stamps_ns.clear()
        self._poses.clear()
        for observation in observations:
            self.moved(observation)

    def sighted(self, other: str, seen_ns: int, seen: Seen) -> None:
        """The robot saw another one."""
        mine = self._seen.setdefault(base_name(other), {})
        spacing_ns = self._spacing_ns.get(base_name(other), 0)
        if mine and 0 <= seen_ns - max(mine) < spacing_ns:
            return
        mine[seen_ns] = seen
        if len(mine) > MOST:
            stamps = sorted(mine)
            spacing_ns = max(2 * spacing_ns, 2 * (stamps[-1] - stamps[0]) // MOST)
            self._spacing_ns[base_name(other)] = spacing_ns
            self._seen[base_name(other)] = {ns: mine[ns] for ns in _spread(stamps, spacing_ns)}

    def records(self, other: Source | str) -> tuple[Record, ...]:
        """What to tell another robot: where it was seen, and where this one was whenever either saw the other."""
        name = base_name(other if isinstance(other, str) else other.name)
        mine = self._seen.get(name, {})
        theirs = self._told.get(other, ()) if isinstance(other, Source) else ()
        stamps = sorted({*mine, *(record.stamp_ns for record in theirs if record.seen is not None)})
        found = ((ns, self.pose_at(ns)) for ns in stamps)
        return tuple(Record(ns, pose, mine.get(ns)) for ns, pose in found if pose is not None)[: 2 * MOST]

    def heard(self, other: Source, records: Sequence[Record]) -> bool:
        """Another robot has told its side; True when that is news."""
        told = tuple(records)
        if self._told.get(other, ()) == told:
            return False
        self._told[other] = told
        return True

    def sightings(self, donor: Source) -> tuple[Sighting, ...]:
        """All that is known from both sides of where this robot and a donor saw each other."""
        mine, found = self._seen.get(base_name(donor.name), {}), []
        for record in self._told.get(donor, ()):
            pose = self.pose_at(record.stamp_ns)
            if pose is None:
                continue
            where = (record.stamp_ns, to_transform(pose), to_transform(record.T_map_base))
            if (seen := mine.get(record.stamp_ns)) is not None:
                found.append(Sighting(*where, *seen))
            if record.seen is not None:
                found.append(Sighting(*where, *record.seen, by_donor=True))
        return tuple(found)

    def pose_at(self, stamp_ns: int) -> Pose7 | None:
        """Where this robot was in its map frame; None where it does not know."""
        at = bisect_left(self._stamps_ns, stamp_ns)
        if at < len(self._stamps_ns) and self._stamps_ns[at] == stamp_ns:
            return self._poses[at]
        if at in (0, len(self._stamps_ns)):
            near = [k for k in (at - 1, at) if 0 <= k < len(self._stamps_ns)]
            close = [k for k in near if abs(self._stamps_ns[k] - stamp_ns) <= GAP_NS // 4]
            return self._poses[close[0]] if close else None
        before_ns, after_ns = self._stamps_ns[at - 1], self._stamps_ns[at]
        if after_ns - before_ns > GAP_NS:
            return None
        return interpolate(self._poses[at - 1], self._poses[at], (stamp_ns - before_ns) / (after_ns - before_ns))


def believable(seen: Seen) -> bool:
    """Whether a measurement is one: no larger than anything on earth, and with standard deviations above zero."""
    x, y, yaw, sigma_m, sigma_yaw = seen
    place = abs(x) <= FARTHEST and abs(y) <= FARTHEST and 0.0 < sigma_m <= FARTHEST
    return place and (math.isnan(yaw) or (abs(yaw) <= FARTHEST and 0.0 < sigma_yaw <= FARTHEST))


def _spread(stamps: Sequence[int], spacing_ns: int) -> list[int]:
    """Those that lie at least so far apart, from the first one on."""
    kept: list[int] = []
    for ns in stamps:
        if not kept or ns - kept[-1] >= spacing_ns:
            kept.append(ns)
    return kept
