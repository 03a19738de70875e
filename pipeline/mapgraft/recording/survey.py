"""What is in a mission's files, what would be used of it and why, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mapgraft.config import Config
from mapgraft.contracts import Observation
from mapgraft.errors import RecordingError
from mapgraft.plugins import Plugins
from mapgraft.recording.losses import Loss, fault_sentences, losses
from mapgraft.recording.mission import Mission, RobotSource, open_mission
from mapgraft.recording.poses.rigid import from_transform
from mapgraft.recording.robots.glimpse import Glimpse
from mapgraft.recording.robots.library import Library
from mapgraft.recording.robots.roster import further_files
from mapgraft.recording.smear import SMEAR_TEXT, Disagreement, Track, disagreement

S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class SurveyedTopic:
    """One topic; ``count`` is None where it is not known. ``used_by`` names the robots that read it, and ``note`` says
    why it is of no use where one might expect it to be.
    """

    topic: str
    message_type: str
    count: int | None
    used_by: tuple[str, ...]
    note: str


@dataclass(frozen=True, slots=True)
class SurveyedFile:
    """One file; times of recording in nanoseconds, None where nothing was recorded."""

    path: str
    container: str
    size_bytes: int
    start_ns: int | None
    end_ns: int | None
    topics: tuple[SurveyedTopic, ...]

    @property
    def duration_s(self) -> float:
        return 0.0 if self.start_ns is None or self.end_ns is None else (self.end_ns - self.start_ns) / S


@dataclass(frozen=True, slots=True)
class SurveyedRobot:
    """One robot, how many of its payloads have a pose, and how smeared its map would be.

    ``smear`` says it in words; ``odometry`` is the measured difference between its odometry and its corrected poses
    where the recording holds both.
    """

    source: RobotSource
    read: int
    placed: int
    path_m: float
    smear: str
    odometry: Disagreement | None


@dataclass(frozen=True, slots=True)
class Survey:
    """Everything that ``mapgraft info`` shows; plain values throughout, so that ``dataclasses.asdict`` gives JSON.

    ``problems`` and ``remarks`` are sentences about the mission; a problem costs observations or robots. Remarks about
    one robot are in its ``source``. ``known_world`` names the robots whose relative poses the recording itself tells.
    ``lost`` counts what of the problems was lost in files and on topics, for machines.
    """

    files: tuple[SurveyedFile, ...]
    robots: tuple[SurveyedRobot, ...]
    start_ns: int
    end_ns: int
    known_world: tuple[str, ...]
    problems: tuple[str, ...]
    remarks: tuple[str, ...]
    lost: tuple[Loss, ...]


def survey(paths: Sequence[Path], config: Config, *, plugins: Plugins | None = None) -> Survey:
    """Look through the files of a mission; every pose is looked up, no payload is mapped.

    Raises RecordingError when a file cannot be read, NothingToMapError when there is nothing to map, ConfigError when
    the configuration speaks of what is not there.
    """
    with open_mission(paths, config, plugins=plugins) as mission, mission.guard.armed():
        tracks = _tracks(mission.places())
        tally = mission.tally
        odometry = _tracks(mission.odometry())
        robots = tuple(
            _robot(source, tally.of_robot(source.name), tracks.get(source.name), odometry.get(source.name))
            for source in mission.robots
        )
        problems = [f"robot {name} cannot be mapped: {reason}" for name, reason in mission.unmappable]
        problems += [sentence for g in mission.glimpses for sentence in g.undecodable]
        problems += tally.sentences()
        problems += fault_sentences(mission.faults)
        return Survey(
            files=tuple(_file(g, mission.readers_of) for g in mission.all_glimpses),
            robots=robots,
            start_ns=mission.start_ns,
            end_ns=mission.end_ns,
            known_world=tuple(sorted(mission.T_world_map)),
            problems=tuple(problems),
            remarks=tuple(_remarks(mission)),
            lost=losses(mission),
        )


def files_alone(paths: Sequence[Path], config: Config, *, plugins: Plugins | None = None) -> tuple[SurveyedFile, ...]:
    """The recordings that can be opened, with their topics, also where no robot in them can be mapped."""
    library = Library(plugins, config.mission.typestore, config.limits)
    seen: list[SurveyedFile] = []
    try:
        with library.guard.armed():
            for path in (*paths, *further_files(paths, config)):
                with suppress(RecordingError):
                    seen += [] if library.format_of(path) else [_file(library.look(path), lambda _path, _topic: ())]
    finally:
        library.close()
    return tuple(seen)


def _tracks(observations: Iterable[Observation]) -> dict[str, Track]:
    stamps: dict[str, list[int]] = {}
    poses: dict[str, list[tuple[float, float, float, float, float, float, float]]] = {}
    for seen in observations:
        stamps.setdefault(seen.robot, []).append(seen.stamp_ns)
        poses.setdefault(seen.robot, []).append(from_transform(seen.T_map_base))
    return {name: Track(np.array(times, np.int64), poses[name]) for name, times in stamps.items()}


def _robot(source: RobotSource, counts: tuple[int, int], track: Track | None, odometry: Track | None) -> SurveyedRobot:
    measured = disagreement(track, odometry) if track is not None and odometry is not None else None
    path_m = float(track.path_m[-1]) if track is not None and len(track.poses) else 0.0
    return SurveyedRobot(source, counts[0], counts[1], path_m, _smear(source, path_m, measured), measured)


def _smear(source: RobotSource, path_m: float, measured: Disagreement | None) -> str:
    text = SMEAR_TEXT[source.drift]
    if source.drift == "odometry":
        return f"{text} (over {path_m:.0f} m of path; nothing to measure it against)"
    if measured is None:
        return text
    pieces = f"{measured.segments} piece{'s' * (measured.segments != 1)}"
    return (
        f"{text}; its raw odometry would drift from them by {measured.median_m:.2f} m and {measured.median_deg:.1f}° "
        f"per 10 m of path (median of {pieces}; worst {measured.worst_m:.2f} m, "
        f"{measured.worst_deg:.1f}°)"
    )


def _file(g: Glimpse, readers_of: Callable[[Path, str], tuple[str, ...]]) -> SurveyedFile:
    source = g.source
    paths = [p for p in source.path.rglob("*") if p.is_file()] if source.path.is_dir() else [source.path]
    counts: dict[tuple[str, str], int | None] = {}
    for channel in source.channels:
        key = (channel.topic, channel.message_type)
        known = counts.get(key, 0)
        counts[key] = None if known is None or channel.count is None else known + channel.count
    notes = {channel.topic: channel.why_not for channel in source.channels if not channel.decodable}
    topics = tuple(
        SurveyedTopic(topic, message_type, count, readers_of(source.path, topic), notes.get(topic, ""))
        for (topic, message_type), count in sorted(counts.items())
    )
    size = sum(path.stat().st_size for path in paths)
    return SurveyedFile(str(source.path), source.container, size, source.start_ns, source.end_ns, topics)


def _remarks(mission: Mission) -> list[str]:
    return [
        f"{name}: its stamps are shifted by {shift_ns / S:+.3f} s, because it did not record together with the others "
        "(mission.start: recorded keeps them)"
        for name, shift_ns in mission.shifts.items()
        if shift_ns
    ]
