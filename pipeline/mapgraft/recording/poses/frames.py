"""The frames of a recording as a sample of it shows them: the way from a sensor up to its map, and who is who on it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Literal, NamedTuple

from mapgraft.recording.naming import is_base, is_map, is_odom, is_world
from mapgraft.recording.poses.rigid import IDENTITY, Pose7, compose

MOST_WAYS: Final = 64
MOST_DEEP: Final = 256
"""Ways up from one frame and frames on one way that are looked at: no robot has so many, a hostile recording may."""

MOST_EDGES: Final = 10_000
"""Edges of one recording that are kept; each takes some 5 kB."""

Drift = Literal["corrected", "slam", "odometry", "unknown", "none"]
"""How poses err: ``corrected`` offline, ``slam`` (or localization), raw ``odometry``, ``unknown``, or no poses."""


class Stamped(NamedTuple):
    """The two times of a message: when it was recorded, and its header's stamp."""

    log_ns: int
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class SeenEdge:
    """``T_parent_child`` as a sample of the recording shows it; ``fixed`` when it was said to hold for all time."""

    parent: str
    child: str
    topic: str
    fixed: bool
    times: tuple[Stamped, ...]
    poses: tuple[Pose7, ...]

    @property
    def moves(self) -> bool:
        """Whether the sample shows more than one pose."""
        return any(pose != self.poses[0] for pose in self.poses)


class Roles(NamedTuple):
    """Which frames play which part for one sensor; ``map_frame`` is empty where nothing links it to any."""

    map_frame: str
    base_frame: str
    drift: Drift


class Frames:
    """All edges of a recording, by child and parent."""

    def __init__(self, edges: Iterable[SeenEdge]) -> None:
        self._parents: dict[str, dict[str, SeenEdge]] = {}
        self._children: dict[str, dict[str, None]] = {}  # in the order in which they were told
        for edge in edges:
            self._parents.setdefault(edge.child, {}).setdefault(edge.parent, edge)
            self._children.setdefault(edge.parent, {}).setdefault(edge.child)

    def __contains__(self, frame: str) -> bool:
        return frame in self._parents or frame in self._children

    def names(self) -> tuple[str, ...]:
        return tuple(sorted({*self._parents, *self._children}))

    def edge(self, parent: str, child: str) -> SeenEdge:
        return self._parents[child][parent]

    def parents(self, frame: str) -> tuple[str, ...]:
        return tuple(self._parents.get(frame, ()))

    def lineage(self, frame: str) -> tuple[str, ...]:
        """The frame, its parent, and so on up to the root; of several ways the one with a map, then the longest."""
        ways = self._ways_up(frame)
        return min(ways, key=lambda way: (not any(map(is_map, way)), -len(way), way))

    def linked(self, frame: str) -> tuple[str, ...]:
        """All frames below the root above ``frame``, nearest to the root first."""
        found = [self.lineage(frame)[-1]]
        seen = set(found)
        for parent in found:
            new = [child for child in self._children.get(parent, ()) if child not in seen]
            seen.update(new)
            found.extend(new)
        return tuple(found)

    def path(self, upper: str, lower: str) -> list[SeenEdge] | None:
        """The edges from ``upper`` down to ``lower``, or None when ``lower`` does not hang below it."""
        ways = [way for way in self._ways_up(lower) if upper in way]
        if not ways:
            return None
        way = min(ways, key=lambda way: (way.index(upper), way))
        up = way[: way.index(upper) + 1]
        return [self.edge(parent, child) for child, parent in pairwise(up)][::-1]

    def constant(self, upper: str, lower: str) -> Pose7 | None:
        """``T_upper_lower`` where it never changes, else None."""
        path = self.path(upper, lower)
        if path is None or any(edge.moves for edge in path):
            return None
        out = IDENTITY
        for edge in path:
            out = compose(out, edge.poses[0])
        return out

    def _ways_up(self, frame: str) -> list[tuple[str, ...]]:
        """The ways from a frame to a root; of frames that are told without end some, and no farther than MOST_DEEP."""
        done: list[tuple[str, ...]] = []
        open_ways: list[tuple[str, ...]] = [(frame,)]
        while open_ways:
            way = open_ways.pop()
            parents = [parent for parent in self.parents(way[-1]) if parent not in way]
            if parents and len(way) < MOST_DEEP:
                open_ways.extend((*way, parent) for parent in parents[: MOST_WAYS - len(open_ways) - len(done)])
            else:
                done.append(way)
        return done or [(frame,)]


def roles_of(frames: Frames, sensor: str) -> Roles:
    """Which frame is the map and which the base of the robot that carries a sensor.

    The map is the nearest frame above the sensor that is called a map, else the root. The base is the frame right below
    the nearest fixed frame (odometry, map, world), else the topmost one that is called a base.
    """
    lineage = frames.lineage(sensor)
    fixed = [k for k, frame in enumerate(lineage) if is_map(frame) or is_odom(frame) or is_world(frame)]
    if not fixed and (below := _fixed_below_root(frames, sensor)):
        return Roles(below, lineage[-1], "odometry" if is_odom(below) else "slam")
    bases = [frame for frame in lineage if is_base(frame)]
    base = lineage[max(fixed[0] - 1, 0)] if fixed else (bases[-1] if bases else lineage[-1])
    maps = [frame for frame in lineage if is_map(frame)]
    top = maps[0] if maps else lineage[-1]
    path = frames.path(top, sensor) or []
    if not fixed and not any(edge.moves for edge in path):
        return Roles("", base, "none")
    return Roles(top, base, _drift(lineage, path))


def _drift(lineage: Sequence[str], path: Sequence[SeenEdge]) -> Drift:
    """How the poses along a path from the map frame down to the sensor err."""
    odom = next((frame for frame in lineage if is_odom(frame)), None)
    if odom is not None:
        above = []
        for edge in path:
            if edge.parent == odom:
                break
            above.append(edge)
        return "slam" if any(edge.moves for edge in above) else "odometry"
    return "slam" if any(is_map(frame) or is_world(frame) for frame in lineage) else "unknown"


def _fixed_below_root(frames: Frames, sensor: str) -> str | None:
    """A map or odometry frame that hangs below the robot's body, as some robots publish it."""
    linked = frames.linked(sensor)
    for says in (is_map, is_odom):
        for frame in linked:
            if says(frame):
                return frame
    return None
