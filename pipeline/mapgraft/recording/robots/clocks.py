"""Whose clock tells a robot's time, and which topics and transforms are stamped by another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median, median_low
from typing import Literal, NamedTuple

from mapgraft.config import ClockName
from mapgraft.contracts import GRID_MESSAGE
from mapgraft.recording.poses.frames import SeenEdge, Stamped
from mapgraft.recording.robots.choice import PosePlan
from mapgraft.recording.robots.glimpse import Glimpse, SeenPayload
from mapgraft.recording.robots.stamps import believed

Clock = Literal["header", "log", "index"]
"""What tells the time of a robot: the messages' own stamps, when they were recorded, or (neither) their order."""

INDEX_STEP_NS = 1_000_000_000
"""One scan counts as one second where only the order of the scans is known."""

OTHER_CLOCK_NS = 10_000_000_000
"""Stamps that lie further from another topic's, measured against the time of recording, are of another clock."""

_TOGETHER_NS = 1_000_000_000  # ranges that share less than this only touch, as two windows of one log do

EdgeName = tuple[str, str]  # parent, child


class Range(NamedTuple):
    """From the first to the last stamp, both included."""

    first_ns: int
    last_ns: int

    def joins(self, earlier: Range) -> bool:
        """Whether this range, which begins no earlier, shares its time with another."""
        return self.first_ns + min(_TOGETHER_NS, self.last_ns - self.first_ns) <= earlier.last_ns


@dataclass(frozen=True, slots=True)
class Times:
    """How stamps become the robot's time.

    ``offset_ns`` is how far the robot's clock lies after the time of recording. Topics in ``other_clock`` and edges in
    ``edges_by_log`` are stamped by some other clock, and stamps on ``undated`` topics mean something else: the time of
    recording plus that offset counts for them. ``file_by_log`` are edges of the pose file whose time of recording is
    the robot's time as it is. ``wanted`` is what the configuration asks for; with
    ``header`` stamps count even where they cannot be true.
    """

    clock: Clock
    offset_ns: int
    other_clock: frozenset[str]
    undated: frozenset[str]
    edges_by_log: frozenset[EdgeName]
    file_by_log: frozenset[EdgeName]
    wanted: ClockName = "auto"

    def stamps(self, topic: str, times: Sequence[Stamped]) -> list[int]:
        """The robot's times of some messages on a topic, in the order of their recording, in nanoseconds."""
        if not self.judged(topic):
            return [self.stamp(topic, stamped) for stamped in times]
        return believed(times, self.offset_ns)

    def judged(self, topic: str) -> bool:
        """Whether the stamps on a topic are looked at one by one before they are believed."""
        return self.clock == "header" and self.wanted == "auto" and topic not in self.by_log

    def stamp(self, topic: str, stamped: Stamped) -> int:
        """The robot's time of a message on a topic, in nanoseconds."""
        if self.clock == "log" or topic in self.other_clock or topic in self.undated:
            return stamped.log_ns + self.offset_ns
        return stamped.stamp_ns

    @property
    def by_log(self) -> frozenset[str]:
        """All topics for which the time of recording counts."""
        return self.other_clock | self.undated

    def remarks(self) -> list[str]:
        """What a person should know about this clock."""
        remarks = []
        if self.clock == "log" and self.wanted != "log":
            remarks.append("its messages have no usable stamps: the time of their recording counts")
        if self.clock == "index":
            remarks.append("its stamps are broken: scans count as one second apart in the order of their recording")
        odd = [f"{parent} → {child}" for parent, child in sorted(self.edges_by_log | self.file_by_log)]
        odd += sorted(self.other_clock)
        if odd and self.clock == "header":
            remarks.append(f"{', '.join(odd)}: stamped by another clock, so the time of recording counts")
        return remarks


def times_of(
    glimpses: Sequence[Glimpse],
    payloads: Sequence[SeenPayload],
    poses: PosePlan,
    wanted: ClockName = "auto",
) -> Times:
    """Which clock tells a robot's time, and which topics and edges are on another.

    What the stamp of a ready map means differs from mapper to mapper: a map counts from when it was recorded.
    ``wanted`` is what the configuration asks for.
    """
    if wanted == "log":
        return _by_log(payloads, poses)
    stamps = {payload.topic: payload.times for payload in payloads}
    if payloads[0].kind == GRID_MESSAGE:
        logs = [[Stamped(t.log_ns, t.log_ns) for t in times] for times in stamps.values()]
        clock = clock_of(logs)
        offset_ns = _offset_of_source(glimpses)
        other_clock, undated = set[str](), frozenset(stamps)
    else:
        clock = clock_of(list(stamps.values())) if wanted == "auto" else "header"
        offset_ns = offset_of(next(iter(stamps.values()))) if clock == "header" else 0
        other_clock, undated = {t for t, times in stamps.items() if is_other_clock(times, offset_ns)}, frozenset()
    if poses.topic is not None and not poses.from_file and is_other_clock(poses.topic.times, offset_ns):
        other_clock.add(poses.topic.topic)
    own, other = poses.tree.own_edges, poses.tree.other_edges
    odd = {(e.parent, e.child) for e in own if not e.fixed and _has_no_clock_of(e.times, offset_ns)}
    span = [t.log_ns + offset_ns for times in stamps.values() for t in times]
    file_odd = {(e.parent, e.child) for e in other if not e.fixed and _only_log_fits(e, min(span), max(span))}
    return Times(clock, offset_ns, frozenset(other_clock), undated, frozenset(odd), frozenset(file_odd), wanted)


def _by_log(payloads: Sequence[SeenPayload], poses: PosePlan) -> Times:
    """The time of recording for everything; the order of recording where that does not go on."""
    clock = clock_of([[Stamped(t.log_ns, 0) for t in payload.times] for payload in payloads])
    of_file = frozenset((edge.parent, edge.child) for edge in poses.tree.other_edges if not edge.fixed)
    return Times(clock, 0, frozenset(), frozenset(), frozenset(), of_file, "log")


def _has_no_clock_of(times: Sequence[Stamped], offset_ns: int) -> bool:
    """Whether transforms are stamped by another clock than the one with this offset, or not at all."""
    return is_other_clock(times, offset_ns) or (len(times) > 1 and not any(t.stamp_ns for t in times))


def _offset_of_source(glimpses: Sequence[Glimpse]) -> int:
    """How far the stamps of a recording usually lie after the times of recording; 0 where nothing tells."""
    sensors = [p.times for g in glimpses for p in g.payloads if p.kind != GRID_MESSAGE]
    edges = [edge.times for g in glimpses for edge in g.edges if not edge.fixed]
    offsets = [offset_of(times) for times in (sensors or edges)]
    return min(offsets, key=abs, default=0)


def _only_log_fits(edge: SeenEdge, first_ns: int, last_ns: int) -> bool:
    """Whether the times of recording of an edge in another file lie within the robot's range, and its stamps do not."""
    low_ns, high_ns = first_ns - OTHER_CLOCK_NS, last_ns + OTHER_CLOCK_NS
    by_stamp = edge.times[0].stamp_ns <= high_ns and edge.times[-1].stamp_ns >= low_ns
    by_log = edge.times[0].log_ns <= high_ns and edge.times[-1].log_ns >= low_ns
    return by_log and not by_stamp


def clock_of(topics: Sequence[Sequence[Stamped]]) -> Clock:
    """The best clock that works for all topics, each given by some of its first and last times in recorded order."""
    return max((_clock_of_topic(times) for times in topics), key=("header", "log", "index").index, default="log")


def _clock_of_topic(times: Sequence[Stamped]) -> Clock:
    alone = len(times) == 1
    dated = [t.stamp_ns for t in times if t.stamp_ns > 0]  # a zero or two among many is a slip
    if 2 * len(dated) > len(times) and (alone or dated[-1] > dated[0]):
        return "header"
    return "log" if alone or times[-1].log_ns > times[0].log_ns else "index"


def offset_of(times: Sequence[Stamped]) -> int:
    """By how much the stamps of a topic usually lie after the times of recording, in nanoseconds."""
    return median_low(stamped.stamp_ns - stamped.log_ns for stamped in times) if times else 0


def is_other_clock(times: Sequence[Stamped], offset_ns: int) -> bool:
    """Whether stamps cannot be of the clock whose offset to the time of recording is given.

    A simulated clock that runs slower than the recorder's is no other clock: its own offset drifts as much.
    """
    offsets = [stamped.stamp_ns - stamped.log_ns for stamped in times]
    return bool(offsets) and abs(median(offsets) - offset_ns) > OTHER_CLOCK_NS + max(offsets) - min(offsets)
