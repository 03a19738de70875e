"""Transforms and poses on their way from a file into a robot's tree of frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from mapgraft.contracts.sources import RawMessage, ReadFaults, Source
from mapgraft.errors import RecordingError
from mapgraft.recording.decoding.records import PoseRecord
from mapgraft.recording.poses.frames import MOST_EDGES
from mapgraft.recording.poses.lookup import TreePoses
from mapgraft.recording.poses.rigid import Pose7, angle_of, believable, compose, inverse
from mapgraft.recording.poses.tf import TransformBuffer
from mapgraft.recording.robots.clocks import EdgeName
from mapgraft.recording.robots.payloads import Read, poses_in
from mapgraft.recording.robots.plan import Window
from mapgraft.recording.robots.stamps import BEYOND_NS, Odd, StampWatch
from mapgraft.recording.robots.trees import TfTopic

KEPT_NS = 60_000_000_000
"""How much of the past a tree keeps; scans wait for their poses a few seconds at most."""

_FORGET_EVERY = 4096  # samples
_ROUNDING = 1e-4  # metres or radians


@dataclass(frozen=True, slots=True)
class Reading:
    """How to read one file's poses into a robot's tree.

    ``replaced`` children are told by someone else; ``chosen`` edges alone count for their child. Edges in
    ``by_log``, or all with ``all_by_log``, are placed at their time of recording plus ``offset_ns``; the stamps of the
    others are looked at before they are believed if ``judged``. The messages on ``topic`` (empty: none) tell the edge
    ``pose_edge``. What was recorded out of ``within`` is of another life of the map frame, but for what is fixed.
    """

    tf: tuple[TfTopic, ...]
    replaced: frozenset[str]
    by_log: frozenset[EdgeName]
    all_by_log: bool
    offset_ns: int
    topic: str = ""
    pose_edge: EdgeName = ("", "")
    topic_by_log: bool = False
    judged: bool = True
    chosen: frozenset[EdgeName] = frozenset()
    within: Window | None = None

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics that tell poses as time goes on, in the order of their names."""
        return tuple(sorted({*(tf.topic for tf in self.tf if not tf.fixed), *filter(None, [self.topic])}))

    @property
    def fixed_topics(self) -> tuple[str, ...]:
        return tuple(sorted(tf.topic for tf in self.tf if tf.fixed))


class _Edge:
    """One edge as it comes in, and what its stamps have been so far."""

    __slots__ = ("by_log", "child", "last_ns", "parent", "watch")

    def __init__(self, name: EdgeName, by_log: bool) -> None:
        self.parent, self.child = name
        self.by_log = by_log
        self.watch = StampWatch()
        self.last_ns: int | None = None


class Feed:
    """Pours the poses of one file into one tree, and counts what cannot be used."""

    def __init__(self, source: Source, reading: Reading, buffer: TransformBuffer, faults: ReadFaults) -> None:
        self.newest_ns = -(2**63)
        self._source = source
        self._reading = reading
        self._buffer = buffer
        self._faults = faults
        self._tf = {tf.topic: tf for tf in reading.tf}
        self._edges: dict[EdgeName, _Edge] = {}
        self._told: dict[tuple[str, str, str], _Edge | None] = {}  # by topic, frame and child as they are told
        self._posed = _Edge(reading.pose_edge, reading.topic_by_log or reading.all_by_log)
        self._parents = {child: parent for parent, child in reading.chosen}
        self._taken = 0

    @property
    def topics(self) -> tuple[str, ...]:
        return self._reading.topics

    def gather_fixed(self) -> None:
        """Read all transforms that hold for all time, wherever in the file they are."""
        topics = self._reading.fixed_topics
        if topics:
            for raw in self._source.messages(topics):
                self.take(raw)

    def take(self, raw: Read) -> None:
        """Pour the poses of one message in."""
        reading, topic = self._reading, raw.channel.topic
        tf = self._tf.get(topic)
        if reading.within is not None and not (tf is not None and tf.fixed) and not reading.within.holds(raw.log_ns):
            return
        try:
            records = poses_in(self._source, raw)
        except RecordingError as error:
            self._faults.add("pose_undecodable", str(error), topic=topic)
            return
        for record in records:
            pose = believable(record.xyz_m, record.xyzw)
            if pose is None:
                sentence = f"a pose at {record.stamp_ns / 1e9:.3f} s is not finite, or its quaternion has no length"
                self._faults.add("pose_invalid", sentence, topic=topic)
                continue
            edge = self._posed if tf is None else self._edge(topic, record, tf)
            if edge is None:
                continue
            stamp_ns = record.stamp_ns
            if tf is not None and tf.fixed:
                self._fix(topic, edge.parent, edge.child, pose)
                continue
            if edge.by_log:
                stamp_ns = raw.log_ns + reading.offset_ns
            elif reading.judged and stamp_ns != edge.last_ns:  # said again, it counts once: the buffer keeps the first
                edge.last_ns = stamp_ns
                odd = edge.watch.judge(raw.log_ns, stamp_ns)
                if odd is not None and odd.time_ns != stamp_ns:
                    self._put_right(topic, edge, odd)
                    if not odd.used:
                        continue
                    stamp_ns = odd.time_ns
            if not -BEYOND_NS <= stamp_ns <= BEYOND_NS:
                sentence = f"the time of {edge.parent} → {edge.child} is {stamp_ns / 1e9:.6g} s, which no clock shows"
                self._faults.add("beyond_time", sentence, topic=topic)
                continue
            self._buffer.add(edge.parent, edge.child, stamp_ns, pose)
            if stamp_ns > self.newest_ns:
                self.newest_ns = stamp_ns
        self._taken += 1
        if self._taken % _FORGET_EVERY == 0:
            self._buffer.forget_older(KEPT_NS)

    def _fix(self, topic: str, parent: str, child: str, pose: Pose7) -> None:
        """Set a transform that holds for all time; one that was said to be another is a fault."""
        said = self._buffer.fixed(parent, child)
        if said is not None and (moved := _apart(said, pose)):
            sentence = f"{parent} → {child} holds for all time, but is said to lie {moved} elsewhere later: that counts"
            self._faults.add("static_changed", sentence, topic=topic)
        self._buffer.fix(parent, child, pose)

    def _put_right(self, topic: str, edge: _Edge, odd: Odd) -> None:
        """Count a sample whose stamp cannot be true."""
        what = "the time of its recording counts" if odd.used else "it is left out"
        because = f"{odd.because}; {what}".replace("its stamp", f"the stamp of {edge.parent} → {edge.child}", 1)
        self._faults.add(odd.cause, f"at {odd.time_ns / 1e9:.3f} s {because}", topic=topic)

    def _edge(self, topic: str, record: PoseRecord, tf: TfTopic) -> _Edge | None:
        """The edge in the tree, None when it is not wanted there."""
        key = (topic, record.frame, record.child)
        if key not in self._told:
            if len(self._told) >= MOST_EDGES:
                sentence = f"{record.frame!r} → {record.child!r} comes after {MOST_EDGES:,} others: it is left out"
                self._faults.add("too_many_frames", sentence, topic=topic)
                return None
            name = self._new_edge(topic, record, tf)
            self._told[key] = None if name is None else self._named(name)
        return self._told[key]

    def _named(self, name: EdgeName) -> _Edge:
        if name not in self._edges:
            self._edges[name] = _Edge(name, name in self._reading.by_log or self._reading.all_by_log)
        return self._edges[name]

    def _new_edge(self, topic: str, record: PoseRecord, tf: TfTopic) -> EdgeName | None:
        frame, child = record.frame, record.child
        name = (tf.frame(frame), tf.frame(child))
        if not frame or not child or frame == child:
            sentence = f"a transform joins {frame!r} to {child!r}: it is left out"
            self._faults.add("frame_unnamed", sentence, topic=topic)
            return None
        if name[1] in self._reading.replaced or self._parents.get(name[1], name[0]) != name[0]:
            return None
        if self._buffer.closes_loop(*name):
            when = "" if tf.fixed else f"at {record.stamp_ns / 1e9:.3f} s "
            sentence = f"{when}{frame!r} → {child!r} closes a loop with what was told before: it is left out for good"
            self._faults.add("loop", sentence, topic=topic)
            return None
        return name


def _apart(one: Pose7, other: Pose7) -> str:
    """How far two poses lie apart, in words; empty where that is only rounding."""
    moved = compose(inverse(one), other)
    far_m, turned_rad = math.hypot(moved[0], moved[1], moved[2]), angle_of(moved)
    return f"{far_m:.3g} m, {turned_rad:.3g} rad" if far_m > _ROUNDING or turned_rad > _ROUNDING else ""


class PoseFile:
    """Another file's poses, read no further than the scans need."""

    def __init__(self, source: Source, reading: Reading, buffer: TransformBuffer, faults: ReadFaults) -> None:
        self._feed = Feed(source, reading, buffer, faults)
        self._feed.gather_fixed()
        self._messages: Iterator[RawMessage] = iter(source.messages(reading.topics) if reading.topics else ())
        self._ended = False

    def read_until(self, poses: TreePoses, frame: str, stamp_ns: int, patience_ns: int) -> None:
        """Read until the poses around the stamp are there, or the file has gone past it by the patience."""
        while not self._ended and not poses.settled(frame, stamp_ns) and self._feed.newest_ns < stamp_ns + patience_ns:
            raw = next(self._messages, None)
            if raw is None:
                self._ended = True
            else:
                self._feed.take(raw)
