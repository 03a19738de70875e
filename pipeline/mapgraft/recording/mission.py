"""A mission: the recordings of several robots as one stream of observations on one timeline."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from mapgraft.config import Config
from mapgraft.contracts import Observation, RecordingError, Signal, Transform
from mapgraft.contracts.sources import Fault, ReadFaults
from mapgraft.correction import Correction
from mapgraft.errors import NothingToMapError
from mapgraft.guard import Guard
from mapgraft.plugins import Plugins
from mapgraft.recording.containers.octets import Octets
from mapgraft.recording.losses import fault_sentences
from mapgraft.recording.poses.frames import Drift
from mapgraft.recording.poses.rigid import Pose7, from_transform, inverse, levelled, to_transform
from mapgraft.recording.robots.clocks import Clock
from mapgraft.recording.robots.glimpse import Glimpse
from mapgraft.recording.robots.library import Library
from mapgraft.recording.robots.payloads import POSE_TYPES, TF_TYPES
from mapgraft.recording.robots.plan import RobotPlan
from mapgraft.recording.robots.roster import MapFile, Roster, call_roll
from mapgraft.recording.robots.worlds import known_world
from mapgraft.recording.smear import odometry_plan
from mapgraft.recording.timeline.corrections import corrections
from mapgraft.recording.timeline.intake import Limits
from mapgraft.recording.timeline.shifts import shifts
from mapgraft.recording.timeline.sightings import meetings, sightings
from mapgraft.recording.timeline.stream import Member, Stream
from mapgraft.recording.timeline.tally import Tally
from mapgraft.rendezvous import Sighted

S = 1_000_000_000
_SHOWN = 10
_ALIKE_NS = 10 * S  # robots of one file whose clocks lie closer are read in one pass


@dataclass(frozen=True, slots=True)
class RobotSource:
    """What one robot of a mission is read from.

    ``source`` is its name as discovered; ``kinds`` are the payload kinds it observes; ``poses`` says in words where its
    poses come from and ``drift`` how such poses err. ``start_ns`` and ``end_ns`` are its first and last recorded
    stamps, ``shift_ns`` is added to them on the timeline. ``count`` is the number of recorded payloads (in a
    window, its share of them by time), None where only reading could tell. ``corrections`` is the topic on which it
    tells anew where it was, empty where it has none. ``life`` counts the lives of its map frame; ``follows`` names the
    life before, empty for the first.
    """

    name: str
    source: str
    files: tuple[str, ...]
    topics: tuple[str, ...]
    kinds: tuple[str, ...]
    poses: str
    drift: Drift
    map_frame: str
    base_frame: str
    clock: Clock
    start_ns: int
    end_ns: int
    shift_ns: int
    count: int | None
    remarks: tuple[str, ...]
    corrections: str = ""
    life: int = 1
    follows: str = ""


STRING: Final = "std_msgs/msg/String"
MOST_SIGNALS: Final = 100_000  # of one file


class Mission:
    """Several robots on one timeline; made by ``open_mission``.

    ``T_world_map`` places the map frames of those robots whose recording tells how they lie in one world (windows of
    one log, a common root frame); it is empty where nobody knows. ``tally`` is that of the last ``observations()``.
    """

    def __init__(self, roster: Roster, library: Library, config: Config) -> None:
        self._library = library
        self._config = config.mission
        self._meetings = config.meetings
        self._extent_m = config.limits.extent_m
        self._plans = roster.plans
        self._map_files = roster.map_files
        self.glimpses = roster.glimpses
        self.unmappable = roster.unmappable
        self._unread = roster.unread
        self.tally = Tally()
        self._faults = ReadFaults()
        names = [*(file.name for file in roster.map_files), *(plan.name for plan in roster.plans)]
        self._order = {name: k for k, name in enumerate(names)}  # both are sorted
        self._shifts = shifts({plan.name: plan.range for plan in self._plans}, self._config.start)
        self._anchors = {plan.name: self._anchor(plan) for plan in self._plans if plan.anchored}
        self.T_world_map: Mapping[str, Transform] = {
            name: to_transform(pose) for name, pose in known_world(self._plans, self._anchors).items()
        }

    @property
    def guard(self) -> Guard:
        """Who watches over the plugins that read this mission; their calls are limited in time while it is armed."""
        return self._library.guard

    @property
    def start_ns(self) -> int:
        """The first stamp on the mission's timeline, before any limits."""
        return min((plan.range.first_ns + self._shifts[plan.name] for plan in self._plans), default=0)

    @property
    def end_ns(self) -> int:
        """The last stamp on the mission's timeline, before any limits."""
        return max((plan.range.last_ns + self._shifts[plan.name] for plan in self._plans), default=0)

    @property
    def asked_s(self) -> tuple[float | None, float | None]:
        """The start and the end that the configuration asks for, in seconds after the first stamp."""
        return self._config.start_s, self._config.end_s

    @property
    def shifts(self) -> Mapping[str, int]:
        """By how much each robot's stamps are moved to bring all to a common start, in nanoseconds."""
        return self._shifts

    @property
    def robots(self) -> tuple[RobotSource, ...]:
        """All robots, by name."""
        sources = [_described(plan, self._shifts[plan.name]) for plan in self._plans]
        sources += [_described_file(file, self.start_ns) for file in self._map_files]
        return tuple(sorted(sources, key=lambda source: source.name))

    @property
    def faults(self) -> list[tuple[str, Fault]]:
        """What was lost or odd as far as the files were read, each with the name of its file."""
        faults = [(g.source.path.name, fault) for g in self.all_glimpses for fault in g.source.faults]
        return [*self._unread, *faults, *(("the poses", fault) for fault in self._faults)]

    @property
    def all_glimpses(self) -> tuple[Glimpse, ...]:
        """All recordings, those that are there for their poses included, each once."""
        used = [g for plan in self._plans for g in (*plan.glimpses, plan.pose_file) if g is not None]
        return tuple({g.source.path: g for g in (*self.glimpses, *used)}.values())

    def readers_of(self, path: Path, topic: str) -> tuple[str, ...]:
        """The robots that read a topic of a file, for payloads or for poses."""
        return tuple(plan.name for plan in self._plans if topic in plan.topics_of(path))

    def observations(self) -> Iterator[Observation]:
        """All observations of all robots in time order; each call reads the files anew and begins a new tally.

        Ties go by the robots' names, map files first, then by topic and order of recording. Raises RecordingError when
        a file cannot be read any more.
        """
        return self._observations(self._limits())

    def timeline(self) -> Iterator[Observation | Correction | Sighted]:
        """As ``observations``, with the robots' corrections of their own poses, and where they saw each other, between
        them, each when it was told."""
        observations, limits = self.observations(), self._limits()
        told: list[Iterator[Observation | Correction | Sighted]] = [
            corrections(plan, self._shifts[plan.name], self._anchors.get(plan.name), limits, self._faults)
            for plan in self._plans
        ]
        told += [sightings(plan, self._shifts[plan.name], limits, self._faults) for plan in self._plans]
        told.append(iter(meetings(self._meetings, self._plans, self.start_ns)))
        return heapq.merge(observations, *told, key=lambda entry: entry.stamp_ns)

    def places(self) -> Iterator[Observation]:
        """The observations without their payloads: when and where they were made; quicker."""
        return self._observations(self._limits()._replace(places_only=True))

    def odometry(self) -> Iterator[Observation]:
        """As ``places``, by raw odometry instead of the poses that are used, for those robots that have both."""
        plans = [other for plan in self._plans if (other := odometry_plan(plan)) is not None]
        limits, tally, faults = self._limits()._replace(places_only=True), Tally(), ReadFaults()
        return heapq.merge(
            *(
                Stream([self._member(plan)], self._library.payloads, limits, tally, faults).observations()
                for plan in plans
            ),
            key=lambda seen: seen.stamp_ns,
        )

    def signals(self, topics: Sequence[str]) -> Iterator[Signal]:
        """The messages on some topics, of whatever type, file by file; at most so many that somebody could listen.

        They come onto the mission's timeline as the first robot does that is in their file.
        """
        for glimpse in self.glimpses:
            plan = next((one for one in self._plans if any(g is glimpse for g in one.glimpses)), None)
            if plan is None:
                continue
            lag_ns = plan.times.offset_ns + self._shifts[plan.name] + plan.clock_offset_ns
            for raw in islice(glimpse.source.messages(topics), MOST_SIGNALS):
                text = getattr(glimpse.source.decode(raw), "data", "") if raw.channel.message_type == STRING else ""
                yield Signal(raw.channel.topic, raw.log_ns + lag_ns, str(text))

    def _observations(self, limits: Limits) -> Iterator[Observation]:
        self.tally, self._faults = Tally(), ReadFaults()
        streams = [
            Stream(members, self._library.payloads, limits, self.tally, self._faults).observations()
            for members in self._passes()
        ]
        files = iter([self._ready(file, limits) for file in self._map_files])
        order = self._order
        return heapq.merge(files, *streams, key=lambda seen: (seen.stamp_ns, order[seen.robot]))

    def close(self) -> None:
        """Let go of all files."""
        self._library.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _limits(self) -> Limits:
        config, start_ns = self._config, self.start_ns
        return Limits(
            None if config.start_s is None else start_ns + round(config.start_s * S),
            None if config.end_s is None else start_ns + round(config.end_s * S),
            config.every,
            extent_m=self._extent_m,
        )

    def _member(self, plan: RobotPlan) -> Member:
        return Member(plan, self._order[plan.name], self._shifts[plan.name], self._anchors.get(plan.name))

    def _passes(self) -> list[list[Member]]:
        """Robots of the same files, window and shift share a pass; virtual robots of one log play at the same time."""
        passes: dict[object, list[Member]] = {}
        for plan in self._plans:
            files = tuple(g.source.path for g in plan.glimpses)
            lag = (plan.times.offset_ns + self._shifts[plan.name] + plan.clock_offset_ns) // _ALIKE_NS
            passes.setdefault((files, plan.window, plan.times.clock, lag), []).append(self._member(plan))
        return list(passes.values())

    def _anchor(self, plan: RobotPlan) -> Pose7:
        """``T_anchor_map`` of a virtual robot: its map frame begins, level, at its first pose.

        Raises RecordingError when no scan in its window has a pose.
        """
        tally = Tally()
        stream = Stream([Member(plan, 0, 0)], self._library.payloads, Limits(), tally, ReadFaults())
        first = next(stream.observations(), None)
        if first is None:
            why = "; ".join(tally.sentences())
            raise RecordingError(f"robot {plan.name} cannot be mapped: no scan in its window has a pose ({why})")
        return inverse(levelled(from_transform(first.T_map_base)))

    def _ready(self, file: MapFile, limits: Limits) -> Observation:
        """A map file is there from the start."""
        topic = self.tally.of(file.name, file.path.name, file.kind)
        topic.read = topic.used = 1
        stamp_ns = self.start_ns if limits.start_ns is None else limits.start_ns
        still = Transform.identity()
        return Observation(file.name, stamp_ns, stamp_ns, file.path.name, file.kind, file.payload, still, still)


def open_mission(
    paths: Sequence[Path],
    config: Config,
    *,
    plugins: Plugins | None = None,
    octets: Mapping[Path, Octets] | None = None,
) -> Mission:
    """Find the robots in some files and make them one mission.

    ``plugins`` add readers, decoders and map formats. ``octets`` holds the bytes of MCAP files that are not on this
    machine, by the path that stands for each. Raises RecordingError when a file cannot be read, NothingToMapError when
    there is nothing to map, ConfigError when the configuration speaks of what is not there, TransformError and
    PluginError from what plugins read.
    """
    library = Library(plugins, config.mission.typestore, config.limits, octets=octets)
    try:
        with library.guard.armed():
            roster = call_roll(paths, config, library)
        if not roster.plans and not roster.map_files:
            raise NothingToMapError(nothing_found(roster))
        return Mission(roster, library, config)
    except BaseException:
        library.close()
        raise


def nothing_to_map(mission: Mission) -> str:
    """A sentence on why a mission gave no observation at all, after ``observations()`` came to its end."""
    reasons = "; ".join(mission.tally.sentences()) or f"all of them lie outside {_wanted(mission)}"
    return f"nothing to map: no scan or map of {', '.join(r.name for r in mission.robots)} could be used: {reasons}"


def _wanted(mission: Mission) -> str:
    """What part of the mission was asked for, and how long there would be something."""
    start_s, end_s = mission.asked_s
    if start_s is None and end_s is None:
        return "the robots' windows"
    asked = f"{start_s or 0.0:g} s to {'the end' if end_s is None else f'{end_s:g} s'}"
    lasts_s = (mission.end_ns - mission.start_ns) / S
    return f"the start and end asked for ({asked}): the recording lasts {lasts_s:.1f} s"


def nothing_found(roster: Roster) -> str:
    """A sentence on why the files hold no robot that can be mapped."""
    reasons = [f"robot {name}: {reason}" for name, reason in roster.unmappable]
    reasons += [sentence for g in roster.glimpses for sentence in g.undecodable]
    faults = [*roster.unread, *((g.source.path.name, fault) for g in roster.glimpses for fault in g.source.faults)]
    lost = "".join(f"; {sentence}" for sentence in fault_sentences(faults))
    if reasons:
        return f"nothing to map: {'; '.join(reasons)}{lost}"
    held = "; ".join(f"{g.source.path.name} holds {_held(g)}" for g in roster.glimpses) or "no file was given"
    if all(channel.count == 0 for g in roster.glimpses for channel in g.source.channels):
        return f"nothing to map: {held}{lost}"
    wanted = "no scans and no maps that can be read: record a LaserScan or OccupancyGrid topic"
    return f"nothing to map: {held}, but {wanted}{lost}"


def _held(g: Glimpse) -> str:
    topics = {c.topic: c.message_type for c in g.source.channels if c.count != 0}
    poses = [topic for topic, name in topics.items() if name in TF_TYPES | POSE_TYPES]
    others = [f"{topic} ({name})" for topic, name in topics.items() if topic not in poses]
    held = [f"poses ({', '.join(poses[:_SHOWN])})"] if poses else []
    held += [*others[:_SHOWN], *([f"{len(others) - _SHOWN} more topics"] if len(others) > _SHOWN else [])]
    return ", ".join(held) or "no messages"


def _described(plan: RobotPlan, shift_ns: int) -> RobotSource:
    counts = [_count(plan, seen.topic) for seen in plan.payloads]
    still = "none needed: ready maps in their own frame"
    return RobotSource(
        name=plan.name,
        source=plan.source,
        files=tuple(str(g.source.path) for g in plan.glimpses),
        topics=tuple(seen.topic for seen in plan.payloads),
        kinds=tuple(dict.fromkeys(seen.kind for seen in plan.payloads)),
        poses=still if plan.ready_maps else plan.poses.text,
        drift="none" if plan.ready_maps else plan.poses.drift,
        map_frame=plan.payloads[0].frame if plan.ready_maps else plan.poses.map_frame,
        base_frame=plan.poses.base_frame,
        clock=plan.times.clock,
        start_ns=plan.range.first_ns - plan.clock_offset_ns,
        end_ns=plan.range.last_ns - plan.clock_offset_ns,
        shift_ns=shift_ns + plan.clock_offset_ns,
        count=None if None in counts else sum(count or 0 for count in counts),
        remarks=plan.remarks,
        corrections="" if plan.corrections is None else plan.corrections.topic,
        life=plan.life,
        follows=plan.follows,
    )


def _count(plan: RobotPlan, topic: str) -> int | None:
    """How many messages of a topic there are in all files of a robot; in a window, its share by time."""
    counts = [c.count for g in plan.glimpses for c in g.source.channels if c.topic == topic]
    total = None if None in counts else sum(count or 0 for count in counts)
    spans = [(g.source.start_ns, g.source.end_ns) for g in plan.glimpses]
    if total is None or plan.window is None or not all(a is not None and b is not None for a, b in spans):
        return total
    whole_ns = sum((b or 0) - (a or 0) for a, b in spans)
    return min(total, round(total * (plan.range.last_ns - plan.range.first_ns) / max(whole_ns, 1)))


def _described_file(file: MapFile, start_ns: int) -> RobotSource:
    return RobotSource(
        name=file.name,
        source=file.name,
        files=(str(file.path),),
        topics=(file.path.name,),
        kinds=(file.kind,),
        poses="none needed: a ready map in its own frame",
        drift="none",
        map_frame="map",
        base_frame="",
        clock="index",
        start_ns=start_ns,
        end_ns=start_ns,
        shift_ns=0,
        count=1,
        remarks=file.remarks,
    )
