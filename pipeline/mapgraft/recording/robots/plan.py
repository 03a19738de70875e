"""What will be read for one robot, and how: discovery and configuration put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from mapgraft.config import ClockName, RobotConfig, SightingsConfig, WindowConfig
from mapgraft.contracts import GRID_MESSAGE, ConfigError
from mapgraft.contracts.sources import Source
from mapgraft.recording.robots.choice import PATH, PosePlan, choose_poses
from mapgraft.recording.robots.clocks import INDEX_STEP_NS, Clock, Range, Times, times_of
from mapgraft.recording.robots.discovery import FoundRobot
from mapgraft.recording.robots.glimpse import Glimpse, SeenPayload, times_between
from mapgraft.recording.robots.payloads import POSE_TYPES, Payloads

S = 1_000_000_000


class Window(NamedTuple):
    """The part of a recording that a virtual robot is cut from: ``from_ns`` included, ``until_ns`` excluded.

    Times of recording, or (with the clock ``index``) the number of the scan times INDEX_STEP_NS.
    """

    from_ns: int
    until_ns: int | None

    def holds(self, time_ns: int) -> bool:
        return self.from_ns <= time_ns and (self.until_ns is None or time_ns < self.until_ns)


class CorrectionTopic(NamedTuple):
    """Where a robot tells anew where it was."""

    source: Source
    topic: str


@dataclass(frozen=True, slots=True)
class RobotPlan:
    """Everything needed to read one robot.

    ``range`` is from its first to its last payload by its own clock. With ``anchored`` its map frame begins at its
    first pose. ``poses.method`` is ``none`` for a robot of ready maps that nothing places. ``life`` counts the lives of
    its map frame, and ``follows`` names the one before; ``has_lives`` says that there are several.
    On the topics of ``sightings`` it tells where others are.
    """

    name: str
    glimpses: tuple[Glimpse, ...]
    pose_file: Glimpse | None
    payloads: tuple[SeenPayload, ...]
    poses: PosePlan
    times: Times
    range: Range
    window: Window | None
    anchored: bool
    max_gap_ns: int
    max_speed_m_s: float
    clock_offset_ns: int
    source: str
    remarks: tuple[str, ...] = field(default=())
    corrections: CorrectionTopic | None = None
    life: int = 1
    follows: str = ""
    has_lives: bool = False
    sightings: tuple[SightingsConfig, ...] = ()

    @property
    def ready_maps(self) -> bool:
        """Whether the robot is mapped from ready-made maps."""
        return self.payloads[0].kind == GRID_MESSAGE

    def topics_of(self, path: Path) -> frozenset[str]:
        """The topics of a file that are read for this robot."""
        poses, topics = self.poses, set[str]()
        if any(g.source.path == path for g in self.glimpses):
            topics |= {seen.topic for seen in self.payloads}
            if poses.method == "tree":
                topics |= {tf.topic for tf in poses.tree.own}
                topics |= {poses.topic.topic} if poses.topic is not None and not poses.from_file else set()
        if any(g.source.path == path for g in self.glimpses):
            topics |= {told.topic for told in self.sightings}
        if self.corrections is not None and self.corrections.source.path == path:
            topics.add(self.corrections.topic)
        if self.pose_file is not None and self.pose_file.source.path == path and poses.method == "tree":
            topics |= {tf.topic for tf in poses.tree.other}
            topics |= {poses.topic.topic} if poses.topic is not None and poses.from_file else set()
        return frozenset(topics)


class Unmappable(NamedTuple):
    """A robot that was found, and why it cannot be mapped."""

    name: str
    reason: str


def plan_robot(
    name: str,
    found: Sequence[FoundRobot],
    config: RobotConfig,
    pose_file: Glimpse | None,
    payloads: Payloads,
    clock: ClockName = "auto",
) -> RobotPlan | Unmappable:
    """The plan for one robot, found in one file or in several; raises ConfigError for topics that do not exist.

    ``clock`` is the mission's, for robots that have none of their own.
    """
    choice = _choose(name, found, config, pose_file)
    if isinstance(choice, Unmappable):
        return choice
    used, poses, remarks = choice
    glimpses = tuple(robot.glimpse for robot in found)
    times = times_of(glimpses, used, poses, config.clock or clock)
    ready = used[0].kind == GRID_MESSAGE
    if times.clock == "index" and poses.method == "tree" and not ready:
        return Unmappable(name, "neither stamps nor times of recording tell when its scans were taken")
    window = None if config.window is None else _window(config.window, glimpses, used, times.clock)
    range_ = _range(glimpses, used, times, window, payloads)
    if range_ is None:
        return Unmappable(name, f"nothing on {_topics(used)} lies in its window")
    corrections = _corrections(name, [*glimpses, *filter(None, [pose_file])], times, config.poses.corrections)
    offset_ns = round((config.clock_offset_s or 0.0) * S)
    return RobotPlan(
        name,
        glimpses,
        pose_file,
        used,
        poses,
        times,
        Range(range_.first_ns + offset_ns, range_.last_ns + offset_ns),
        window,
        anchored=window is not None and not ready,
        max_gap_ns=round(config.poses.max_gap_s * S),
        max_speed_m_s=config.poses.max_speed_m_s,
        clock_offset_ns=offset_ns,
        source=config.source or found[0].name,
        remarks=(*remarks, *poses.remarks, *times.remarks()),
        corrections=corrections,
        sightings=_sightings(name, glimpses, config.sightings),
    )


def _corrections(name: str, glimpses: Sequence[Glimpse], times: Times, topic: str | None) -> CorrectionTopic | None:
    """The topic that ``poses.corrections`` names; raises ConfigError when it cannot be used."""
    if topic is None:
        return None
    where = f"robots.{name}.poses.corrections"
    paths = [(g.source, c) for g in glimpses for c in g.source.channels if c.message_type == PATH and c.decodable]
    found = next((CorrectionTopic(source, c.topic) for source, c in paths if c.topic == topic), None)
    if found is None:
        there = ", ".join(sorted({c.topic for _, c in paths})) or "none"
        raise ConfigError(f"{where}: there is no topic {topic!r} of type {PATH}: the recording has {there}")
    if times.clock != "header":
        raise ConfigError(
            f"{where}: corrected poses are told by stamps, but what tells the time of {name}'s scans is their "
            f"{'order' if times.clock == 'index' else 'time of recording'}: leave the corrections out"
        )
    return found


def _sightings(name: str, glimpses: Sequence[Glimpse], told: Sequence[SightingsConfig]) -> tuple[SightingsConfig, ...]:
    """The topics of ``sightings``; raises ConfigError for one that is not there."""
    there = {c.topic for g in glimpses for c in g.source.channels if c.message_type in POSE_TYPES and c.decodable}
    for one in told:
        if one.topic not in there:
            known = ", ".join(sorted(there)) or "none"
            where = f"robots.{name}.sightings"
            raise ConfigError(f"{where}: there is no topic of poses {one.topic!r}: the recording has {known}")
    return tuple(told)


class _Choice(NamedTuple):
    payloads: tuple[SeenPayload, ...]
    poses: PosePlan
    remarks: list[str]


def _choose(
    name: str, found: Sequence[FoundRobot], config: RobotConfig, pose_file: Glimpse | None
) -> _Choice | Unmappable:
    """From scans if they have poses, else from ready maps, never from both."""
    glimpses, namespace = [robot.glimpse for robot in found], found[0].namespace
    sensors = _chosen(name, found, config.scans, [seen for robot in found for seen in robot.sensors], "scans")
    maps = _chosen(name, found, config.maps, [seen for robot in found for seen in robot.maps], "maps")
    if config.maps and config.scans is None:
        sensors = ()
    remarks = [unused for robot in found for unused in robot.unused]
    if not sensors and not maps:
        return Unmappable(name, "it has neither scans nor maps")
    poses = choose_poses(glimpses, pose_file, sensors or maps, namespace, config.poses)
    if not sensors:
        return _Choice(maps, poses, remarks)
    if poses.method != "none":
        unused = [f"{_topics(maps)} is not used, because the robot is mapped from its scans"] if maps else []
        return _Choice(sensors, poses, [*remarks, *unused])
    if not maps:
        return Unmappable(name, f"its scans on {_topics(sensors)} have no poses: {poses.text}")
    remark = f"mapped from {_topics(maps)}, because its scans have no poses: {poses.text}"
    return _Choice(maps, choose_poses(glimpses, pose_file, maps, namespace, config.poses), [*remarks, remark])


def _chosen(
    name: str, found: Sequence[FoundRobot], wanted: Sequence[str] | None, default: Sequence[SeenPayload], what: str
) -> tuple[SeenPayload, ...]:
    """The payload topics to use, one entry per topic, first and last times over all files."""
    if wanted is None:
        chosen = list(default)
    else:
        seen = [p for robot in found for p in robot.glimpse.payloads if (p.kind == GRID_MESSAGE) == (what == "maps")]
        for topic in wanted:
            if not any(p.topic == topic for p in seen):
                there = ", ".join(sorted({p.topic for p in seen})) or "none"
                raise ConfigError(f"robots.{name}.{what}: there is no topic {topic!r}: the recording has {there}")
        chosen = [p for p in seen if p.topic in wanted]
        if len(kinds := sorted({p.kind for p in chosen})) > 1:
            raise ConfigError(
                f"robots.{name}.{what}: {', '.join(wanted)} hold a {' and a '.join(kinds)}: name one kind"
            )
    merged: dict[str, SeenPayload] = {}
    for p in sorted(chosen, key=lambda p: (p.topic, p.first[0].log_ns)):
        merged[p.topic] = replace(merged[p.topic], last=p.last) if p.topic in merged else p
    return tuple(merged.values())


def _window(config: WindowConfig, glimpses: Sequence[Glimpse], payloads: Sequence[SeenPayload], clock: Clock) -> Window:
    starts = [g.source.start_ns for g in glimpses if g.source.start_ns is not None]
    start_ns = min(starts, default=min(p.first[0].log_ns for p in payloads))
    if clock == "index":
        start_ns = 0
    end_ns = None if config.end_s is None else start_ns + round(config.end_s * S)
    return Window(start_ns + round(config.start_s * S), end_ns)


def range_within(plan: RobotPlan, window: Window, payloads: Payloads) -> Range | None:
    """From the first to the last payload of a robot in a part of its recording; None where there is none."""
    found = _range(plan.glimpses, plan.payloads, plan.times, window, payloads)
    offset_ns = plan.clock_offset_ns
    return None if found is None else Range(found.first_ns + offset_ns, found.last_ns + offset_ns)


def _range(
    glimpses: Sequence[Glimpse], seen: Sequence[SeenPayload], times: Times, window: Window | None, payloads: Payloads
) -> Range | None:
    if times.clock == "index":
        count = max((p.channel.count or 1) for p in seen)
        window = window or Window(0, None)
        last = (count - 1) * INDEX_STEP_NS
        last = last if window.until_ns is None else min(last, window.until_ns - INDEX_STEP_NS)
        return Range(window.from_ns, last) if last >= window.from_ns else None
    if window is None:
        found = [(p.topic, p.times) for p in seen]
    else:
        found = [
            (p.topic, times_between(g.source, payloads, p.topic, window.from_ns, window.until_ns))
            for g in glimpses
            for p in seen
            if g.payload(p.topic)
        ]
    stamps = [stamp_ns for topic, some in found for stamp_ns in times.stamps(topic, some)]
    return Range(min(stamps), max(stamps)) if stamps else None


def _topics(payloads: Sequence[SeenPayload]) -> str:
    return ", ".join(payload.topic for payload in payloads)
