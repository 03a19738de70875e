"""The robots of a mission: those that the files show, as the configuration names, cuts and overrides them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from mapgraft.config import Config, RobotConfig
from mapgraft.contracts import ConfigError, RecordingError
from mapgraft.contracts.sources import Fault
from mapgraft.recording.naming import real_path, stem, told_apart
from mapgraft.recording.reach import is_there, require_readable
from mapgraft.recording.robots.agreement import brought_together
from mapgraft.recording.robots.discovery import FoundRobot, discover
from mapgraft.recording.robots.glimpse import Glimpse
from mapgraft.recording.robots.library import Library
from mapgraft.recording.robots.lives import lives_of
from mapgraft.recording.robots.plan import RobotPlan, Unmappable, plan_robot
from mapgraft.recording.robots.written import refuse_run, refuse_written

_SHOWN = 12


@dataclass(frozen=True, slots=True)
class MapFile:
    """A robot without scans: one ready-made map from a file."""

    name: str
    path: Path
    kind: str
    payload: object
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Roster:
    """All robots of a mission, by name, and those that were found but cannot be mapped.

    ``unread`` are the files that could not be opened, by name, each with the reason.
    """

    plans: tuple[RobotPlan, ...]
    map_files: tuple[MapFile, ...]
    unmappable: tuple[Unmappable, ...]
    glimpses: tuple[Glimpse, ...]
    unread: tuple[tuple[str, Fault], ...] = ()


def call_roll(paths: Sequence[Path], config: Config, library: Library) -> Roster:
    """Find the robots in the files and in the configuration.

    A recording that cannot be opened is left out beside others that can. Raises RecordingError when none can, when a
    file is no recording at all or written by a run, when a configured robot cannot be mapped or its files not be read,
    or when there are more robots than the limits allow, ConfigError when the configuration speaks of what is not there.
    """
    for path, times in Counter(real_path(path) for path in paths).items():
        if times > 1:
            raise RecordingError(f"{path} is given {times} times: name every file once")
    paths = [*paths, *further_files(paths, config)]
    map_paths = [path for path in paths if library.format_of(path) is not None]
    glimpses, unread = _looked_into([path for path in paths if path not in map_paths], config, library)
    call = _Call(config, library, _discovered(glimpses, config), _named_maps(map_paths))
    for name, robot in config.robots.items():
        call.configured(name, robot)
    call.check_number()
    call.rest()
    plans = brought_together(sorted(call.plans, key=lambda plan: plan.name), config)
    maps = tuple(sorted(call.map_files, key=lambda file: file.name))
    return Roster(plans, maps, tuple(call.unmappable), tuple(glimpses), tuple(unread))


def _looked_into(
    paths: Sequence[Path], config: Config, library: Library
) -> tuple[list[Glimpse], list[tuple[str, Fault]]]:
    """The recordings that can be opened, and the others, by name, with the reasons."""
    glimpses: list[Glimpse] = []
    errors: list[RecordingError] = []
    unread: list[tuple[str, Fault]] = []
    wanted = [pattern for robot in config.robots.values() for pattern in robot.files]
    for path in paths:
        refuse_run(path)
        try:
            glimpses.append(library.look(path))
        except RecordingError as error:
            if not library.is_named_as_recording(path) or any(matches(path, pattern) for pattern in wanted):
                raise
            errors.append(error)
            why = str(error).replace(str(path), path.name)
            unread.append((path.name, Fault("unreadable", "", 1, f"{why}: it is left out")))
    for glimpse in glimpses:
        refuse_written(glimpse.source)
    if errors and not glimpses:
        raise errors[0] if len(errors) == 1 else RecordingError("; ".join(map(str, errors)))
    return glimpses, unread


def further_files(paths: Sequence[Path], config: Config) -> list[Path]:
    """Files that only the configuration names; raises ConfigError for one that is not there."""
    further: list[Path] = []
    for name, robot in config.robots.items():
        for pattern in robot.files:
            if not any(matches(path, pattern) for path in (*paths, *further)):
                require_readable(Path(pattern))
                if not Path(pattern).exists():
                    known = ", ".join(path.name for path in paths) or "none"
                    raise ConfigError(f"robots.{name}.files: there is no file {pattern!r}: the mission has {known}")
                further.append(Path(pattern))
    return further


def _discovered(glimpses: Sequence[Glimpse], config: Config) -> tuple[FoundRobot, ...]:
    """The robots in all files, but for maps in files that are there for their poses only."""
    pose_files = {real_path(robot.poses.file) for robot in config.robots.values() if robot.poses.file is not None}
    named = {pattern for robot in config.robots.values() for pattern in robot.files}
    return discover(
        [
            g
            for g in glimpses
            if real_path(g.source.path) not in pose_files
            or any(seen.kind == "scan" for seen in g.payloads)
            or any(matches(g.source.path, pattern) for pattern in named)
        ]
    )


def _named_maps(paths: Sequence[Path]) -> dict[str, Path]:
    return dict(zip(told_apart(paths), paths, strict=True))


def matches(path: Path, pattern: str) -> bool:
    """Whether an entry of ``robots.*.files`` (a path, a name or a pattern) means this file."""
    return (
        pattern in (str(path), path.name, stem(path))
        or fnmatch(path.name, pattern)
        or fnmatch(str(path), pattern)
        or (is_there(path) and is_there(Path(pattern)) and real_path(path) == real_path(Path(pattern)))
    )


class _Call:
    """Collects the plans while the configured robots are called one by one."""

    def __init__(self, config: Config, library: Library, found: Sequence[FoundRobot], maps: Mapping[str, Path]) -> None:
        self.plans: list[RobotPlan] = []
        self.map_files: list[MapFile] = []
        self.unmappable: list[Unmappable] = []
        self._config = config
        self._library = library
        self._found = {robot.name: robot for robot in found}
        self._maps = dict(maps)
        self._taken: dict[str, list[str]] = {}  # discovered name → configured names

    def configured(self, name: str, robot: RobotConfig) -> None:
        """Plan a robot that the configuration names."""
        if (source := self._map_of(name, robot)) is not None:
            self._take([source], name)
            self._read_map(name, self._maps[source], robot.options)
            return
        found = self._sources(name, robot)
        self._take([one.name for one in found], name)
        pose_file = None if robot.poses.file is None else self._library.look(robot.poses.file)
        payloads, clock = self._library.payloads, self._config.mission.clock

        def plan(found: Sequence[FoundRobot]) -> RobotPlan | Unmappable:
            return plan_robot(name, found, robot, pose_file, payloads, clock)

        lives = lives_of(name, found, robot, plan, payloads)
        if isinstance(lives, Unmappable):
            raise RecordingError(f"robot {name} cannot be mapped: {lives.reason}")
        self.plans += lives

    def check_number(self) -> None:
        """Raise RecordingError when there are more robots than the limits allow: looking at each costs time, too."""
        left = sum(1 for name in (*self._found, *self._maps) if name not in self._taken)
        robots, most = len(self.plans) + len(self.map_files) + left, self._config.limits.robots
        if robots > most:
            raise RecordingError(
                f"the recording shows {robots:,} robots, each of which would meet all others: give only the files of "
                f"those that are meant, or raise limits.robots ({most:,})"
            )

    def rest(self) -> None:
        """Plan all discovered robots that the configuration did not take."""
        names = {plan.name for plan in self.plans} | {file.name for file in self.map_files}
        payloads, clock = self._library.payloads, self._config.mission.clock
        for name, found in self._found.items():
            if name not in self._taken:
                plan = plan_robot(_free(name, names), [found], RobotConfig(), None, payloads, clock)
                if isinstance(plan, Unmappable):
                    self.unmappable.append(plan)
                else:
                    self.plans.append(plan)
        for name, path in self._maps.items():
            if name not in self._taken:
                self._read_map(_free(name, names | set(self._found)), path, {})

    def _map_of(self, name: str, robot: RobotConfig) -> str | None:
        """The map file that a configured robot is, if it is one."""
        for candidate, path in self._maps.items():
            if robot.source == candidate or any(matches(path, pattern) for pattern in robot.files):
                return candidate
        return name if robot.source is None and not robot.files and name in self._maps else None

    def _read_map(self, name: str, path: Path, options: Mapping[str, object]) -> None:
        remarks: list[str] = []
        kind, payload = self._library.read_map(path, options, remarks.append)
        told = tuple(f"{remark} (robots.{name}.options)" for remark in remarks)
        self.map_files.append(MapFile(name, path, kind, payload, told))

    def _sources(self, name: str, robot: RobotConfig) -> list[FoundRobot]:
        """The discovered robots that a configured one is taken from: one, or one per file."""
        if robot.source is not None:
            if robot.source not in self._found:
                raise ConfigError(f"robots.{name}.source: there is no robot {robot.source!r}: {self._there_are()}")
            return [self._found[robot.source]]
        candidates = list(self._found.values())
        if robot.files:
            candidates = [r for r in candidates if any(matches(r.glimpse.source.path, p) for p in robot.files)]
        elif name in self._found:
            return [self._found[name]]
        else:
            candidates = [r for r in candidates if r.name.startswith(name + "@")] or _with_topics(candidates, robot)
        return self._one_per_file(name, candidates, robot)

    def _one_per_file(self, name: str, candidates: list[FoundRobot], robot: RobotConfig) -> list[FoundRobot]:
        if len(candidates) > 1:
            named = [r for r in candidates if r.name.partition("@")[0] == name]
            candidates = named or _with_topics(candidates, robot) or candidates
        files = {r.glimpse.source.path for r in candidates}
        if not candidates:
            raise ConfigError(f"robots.{name}: the recording shows no such robot: {self._there_are()}; name its source")
        if len(candidates) > 1 and (len(files) < len(candidates) or not robot.files):
            names = ", ".join(r.name for r in candidates)
            raise ConfigError(f"robots.{name} may be any of {names}: say which with source or files")
        return candidates

    def _take(self, sources: Sequence[str], name: str) -> None:
        """Note who takes what; raises ConfigError when two robots would be the same data."""
        for source in sources:
            others = self._taken.setdefault(source, [])
            for other in others:
                if not _different(self._config.robots[other], self._config.robots[name]):
                    raise ConfigError(
                        f"robots {other} and {name} are both taken from {source!r}: "
                        "give each a window or topics of its own"
                    )
            others.append(name)

    def _there_are(self) -> str:
        names = sorted([*self._found, *self._maps])
        shown = ", ".join(names[:_SHOWN]) + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")
        return f"there are {shown}" if names else "there is none"


def _with_topics(candidates: Sequence[FoundRobot], robot: RobotConfig) -> list[FoundRobot]:
    """The candidates in whose file or own topics the configured ones are."""
    wanted = {*(robot.scans or ()), *(robot.maps or ())}
    if not wanted:
        return []
    own = [r for r in candidates if wanted <= {seen.topic for seen in (*r.sensors, *r.maps)}]
    return own or [r for r in candidates if wanted <= {seen.topic for seen in r.glimpse.payloads}]


def _different(one: RobotConfig, other: RobotConfig) -> bool:
    topics = [{*(robot.scans or ()), *(robot.maps or ())} for robot in (one, other)]
    if all(topics) and not topics[0] & topics[1]:
        return True
    return one.window is not None and other.window is not None and one.window != other.window


def _free(name: str, taken: Iterable[str]) -> str:
    """The name, or the name with a number where a configured robot has it already."""
    names, k = set(taken), 2
    while name in names:
        name, k = f"{name}_{k}", k + 1
    return name
