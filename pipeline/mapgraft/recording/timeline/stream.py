"""One pass over a recording: poses go into trees of frames, payloads wait for them, observations come out in order."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import NamedTuple

from mapgraft.contracts import Observation
from mapgraft.contracts.sources import CARMEN_LASER_SCAN, SCAN_TYPES, ReadFaults, Source
from mapgraft.recording.poses.lookup import TreePoses
from mapgraft.recording.poses.rigid import Pose7
from mapgraft.recording.poses.tf import TransformBuffer
from mapgraft.recording.robots.clocks import offset_of
from mapgraft.recording.robots.payloads import Payloads, Read
from mapgraft.recording.robots.plan import RobotPlan
from mapgraft.recording.timeline.feeds import Feed, PoseFile, Reading
from mapgraft.recording.timeline.intake import Intake, Limits, Waiting
from mapgraft.recording.timeline.tally import Tally

REORDER_NS = 1_000_000_000
"""How long a payload waits for an earlier one that was recorded later."""

PATIENCE_NS = 5_000_000_000
"""How long a payload waits for poses that were recorded later than it; mappers publish with some delay."""

MAX_WAITING = 4096
"""How many payloads may wait at a time, however slowly the time of recording passes."""

_log_ns = attrgetter("log_ns")


class Member(NamedTuple):
    """One robot of a pass: ``order`` breaks ties, ``shift_ns`` brings its stamps onto the mission's timeline."""

    plan: RobotPlan
    order: int
    shift_ns: int
    T_anchor_map: Pose7 | None = None


@dataclass(frozen=True, slots=True)
class _Tree:
    """One tree of frames, which robots with the same transforms share, and what fills it."""

    buffer: TransformBuffer
    feeds: tuple[Feed, ...]  # one per source
    pose_file: PoseFile | None


class Stream:
    """One pass over the files of robots that were recorded together and are shifted alike.

    Memory is bounded by the sources' chunks, the payloads that wait (a few seconds of them), and a minute of poses.
    """

    def __init__(
        self, members: Sequence[Member], payloads: Payloads, limits: Limits, tally: Tally, faults: ReadFaults
    ) -> None:
        self._sources: tuple[Source, ...] = tuple(g.source for g in members[0].plan.glimpses)
        self._faults = faults
        self._trees: dict[object, _Tree] = {}
        self._waiting: list[Waiting] = []
        self._last_ns: int | None = None
        self._intakes: list[Intake] = []
        for member in members:
            tree = self._tree_of(member.plan) if member.plan.poses.method == "tree" else None
            self._intakes.append(
                Intake(
                    member.plan,
                    member.order,
                    payloads,
                    None if tree is None else _tree_poses(member.plan, tree),
                    None if tree is None else tree.pose_file,
                    shift_ns=member.shift_ns,
                    T_anchor_map=member.T_anchor_map,
                    limits=limits,
                    tally=tally,
                )
            )
        self._bounds = _bounds(members, limits)
        self._reorder_ns = REORDER_NS + _lag(members)
        self._patience_ns = self._reorder_ns + max(PATIENCE_NS, *(member.plan.max_gap_ns for member in members))

    def observations(self) -> Iterator[Observation]:
        """All observations, by stamp, then by robot, topic and order of recording."""
        for tree in self._trees.values():
            for feed in tree.feeds:
                feed.gather_fixed()
        self._waiting.extend(self._standing())
        handlers = [self._handlers(k) for k in range(len(self._sources))]
        waiting, ripe_ns = self._waiting, self._reorder_ns
        for k, read in self._messages([sorted(by_topic) for by_topic in handlers]):
            for handle in handlers[k][read.channel.topic]:
                handle(read)
            if waiting and read.log_ns - waiting[0].log_ns >= ripe_ns:
                yield from self._release(read.log_ns)
            elif len(waiting) > MAX_WAITING:
                yield from self._release(None, MAX_WAITING)
        yield from self._release(None)
        for cause, sentence in dict.fromkeys(c for tree in self._trees.values() for c in tree.buffer.contradictions()):
            self._faults.add(cause, sentence)

    def _standing(self) -> list[Waiting]:
        """The ready maps that hold from the start, in order; the latest where several files have one."""
        latest: dict[tuple[int, int], Waiting] = {}
        for intake in self._intakes:
            for source in self._sources:
                for standing in intake.standing(source):
                    key = (standing.robot, standing.topic)
                    if key not in latest or latest[key].log_ns < standing.log_ns:
                        latest[key] = standing
        return sorted(latest.values())

    def _handlers(self, k: int) -> dict[str, list[Callable[[Read], None]]]:
        """What to do with the messages of each topic of one source; trees are fed before payloads are taken."""
        handlers: dict[str, list[Callable[[Read], None]]] = {}
        for tree in self._trees.values():
            for topic in tree.feeds[k].topics:
                handlers.setdefault(topic, []).append(tree.feeds[k].take)
        for intake in self._intakes:
            for seen in intake.plan.payloads:
                handlers.setdefault(seen.topic, []).append(self._taker(intake, self._sources[k]))
        return handlers

    def _taker(self, intake: Intake, source: Source) -> Callable[[Read], None]:
        def take(read: Read) -> None:
            waiting = intake.take(source, read)
            if waiting is None:
                return
            if self._last_ns is not None and waiting.stamp_ns < self._last_ns:
                behind_s = (self._last_ns - waiting.stamp_ns) / 1e9
                intake.drop(waiting, "late", f"its stamp lies {behind_s:.3g} s before that of one already used")
                return
            heapq.heappush(self._waiting, waiting)

        return take

    def _messages(self, topics: Sequence[Sequence[str]]) -> Iterator[tuple[int, Read]]:
        """The messages of all sources by their time of recording, each with the number of its source."""
        streams = [self._read(k, wanted) for k, wanted in enumerate(topics)]
        if len(streams) == 1:
            return streams[0]
        return heapq.merge(*streams, key=lambda item: item[1].log_ns)

    def _read(self, k: int, topics: Sequence[str]) -> Iterator[tuple[int, Read]]:
        source = self._sources[k]
        types = {channel.message_type for channel in source.channels if channel.topic in topics}
        from_ns, until_ns = self._bounds
        if types <= SCAN_TYPES - {CARMEN_LASER_SCAN}:  # the fast way, when there is nothing but scans to read
            for scan in source.scans(topics, from_ns, until_ns):
                yield k, scan
        else:
            for raw in source.messages(topics, from_ns, until_ns):
                yield k, raw

    def _release(self, now_ns: int | None, keep: int = 0) -> Iterator[Observation]:
        """Give the observations that are due at this time of recording; all but ``keep`` when it is None."""
        waiting = self._waiting
        while len(waiting) > keep:
            first = waiting[0]
            if now_ns is not None:
                age_ns = now_ns - first.log_ns
                if age_ns < self._reorder_ns:
                    return
                if age_ns < self._patience_ns and not first.intake.settled(first, PATIENCE_NS):
                    return
            else:
                first.intake.settled(first, PATIENCE_NS)  # another file's poses are still to be read
            heapq.heappop(waiting)
            observation = first.intake.observe(first)
            if observation is not None:
                self._last_ns = observation.stamp_ns
                yield observation

    def _tree_of(self, plan: RobotPlan) -> _Tree:
        own, other = _own_reading(plan), _file_reading(plan)
        pose_path = plan.pose_file.source.path if plan.pose_file is not None else None
        key = (own, other, pose_path)
        if key not in self._trees:
            buffer = TransformBuffer(plan.max_gap_ns)
            feeds = tuple(Feed(source, own, buffer, self._faults) for source in self._sources)
            pose_file = None
            if plan.pose_file is not None:
                pose_file = PoseFile(plan.pose_file.source, other, buffer, self._faults)
            self._trees[key] = _Tree(buffer, feeds, pose_file)
        return self._trees[key]


def _tree_poses(plan: RobotPlan, tree: _Tree) -> TreePoses:
    return TreePoses(tree.buffer, plan.poses.map_frame, plan.poses.base_frame, plan.max_gap_ns)


def _own_reading(plan: RobotPlan) -> Reading:
    poses, times = plan.poses, plan.times
    seen = None if poses.from_file else poses.topic
    return Reading(
        poses.tree.own,
        poses.tree.replaced,
        times.edges_by_log,
        times.clock == "log",
        times.offset_ns if times.edges_by_log or times.by_log else 0,
        seen.topic if seen else "",
        (seen.frame or poses.map_frame, poses.base_frame) if seen else ("", ""),
        seen is not None and seen.topic in times.by_log,
        times.wanted != "header",
        poses.tree.chosen,
        plan.window if plan.has_lives and times.clock != "index" else None,
    )


def _file_reading(plan: RobotPlan) -> Reading:
    poses, times = plan.poses, plan.times
    seen = poses.topic if poses.from_file else None
    return Reading(
        poses.tree.other,
        frozenset({poses.base_frame}) if seen else frozenset(),
        times.file_by_log,
        False,
        0,
        seen.topic if seen else "",
        (seen.frame or poses.map_frame, poses.base_frame) if seen else ("", ""),
        judged=times.wanted != "header",
        chosen=poses.tree.chosen,
    )


def _lag(members: Sequence[Member]) -> int:
    """How much longer some topics take from stamp to recording than others, in nanoseconds."""
    lags = [
        offset_of(seen.times) + member.shift_ns
        for member in members
        for seen in member.plan.payloads
        if member.plan.times.clock == "header" and seen.topic not in member.plan.times.by_log
    ]
    return max(lags) - min(lags) if lags else 0


def _bounds(members: Sequence[Member], limits: Limits) -> tuple[int | None, int | None]:
    """The part of the files that can matter, by time of recording, with room for poses around it.

    None where all matters, or where stamps and times of recording do not go together well enough to tell.
    """
    room_ns = REORDER_NS + PATIENCE_NS + max(member.plan.max_gap_ns for member in members)
    froms: list[int | None] = []
    untils: list[int | None] = []
    for member in members:
        window, times = member.plan.window, member.plan.times
        froms.append(window.from_ns - room_ns if window and times.clock != "index" else None)
        untils.append(window.until_ns + room_ns if window and window.until_ns and times.clock != "index" else None)
        if times.clock == "index" or not _steady(member.plan):
            continue
        behind_ns = times.offset_ns + member.shift_ns + member.plan.clock_offset_ns
        if limits.start_ns is not None:
            start_ns = limits.start_ns - behind_ns - room_ns
            froms[-1] = start_ns if froms[-1] is None else max(froms[-1], start_ns)
        if limits.end_ns is not None:
            end_ns = limits.end_ns - behind_ns + room_ns
            untils[-1] = end_ns if untils[-1] is None else min(untils[-1], end_ns)
    from_ns = None if None in froms else min(f for f in froms if f is not None)
    until_ns = None if None in untils else max(u for u in untils if u is not None)
    return from_ns, until_ns


def _steady(plan: RobotPlan) -> bool:
    """Whether stamps run as fast as the time of recording, so that the one tells the other."""
    offsets = [t.stamp_ns - t.log_ns for seen in plan.payloads for t in seen.times]
    return plan.times.clock == "log" or max(offsets) - min(offsets) < REORDER_NS
