"""The recordings of an evaluation in memory: what each robot observed, in order, with the poses that are trusted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from mapgraft.config import Config
from mapgraft.contracts import GRID_MESSAGE, Observation, Transform
from mapgraft.errors import RecordingError, UsageError
from mapgraft.plugins import Plugins

if TYPE_CHECKING:
    from mapgraft.recording.mission import Mission, RobotSource

_DOUBTFUL = {
    "odometry": "raw odometry, which drifts: what is called right or wrong here is only as good as that",
    "unknown": "poses of unknown quality: what is called right or wrong here is only as good as they are",
}


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """What one robot of one recording observed, in order.

    ``files`` are the recording's; robots of different files are in different places. Robots of one ``world`` are
    related by ``T_world_map``. ``joined`` are all files of one place where persons have said that several are.
    ``stamps_ns`` (n,) rises, or is None where only the order of the observations is known.
    ``poses`` says in words where the poses come from.
    """

    number: int
    robot: str
    files: tuple[str, ...]
    world: str
    T_world_map: Transform
    observations: tuple[Observation, ...]
    stamps_ns: NDArray[np.int64] | None
    poses: str
    doubt: str
    joined: tuple[str, ...] = ()

    @classmethod
    def of(cls, number: int, robot: str, place: str, observations: Iterable[Observation]) -> Self:
        """What a robot observed, with true poses in the one frame of a place, from wherever the observations come."""
        made = tuple(observations)
        stamps_ns = np.array([observation.stamp_ns for observation in made], np.int64)
        return cls(number, robot, (place,), place, Transform.identity(), made, stamps_ns, "given", "")

    def __len__(self) -> int:
        return len(self.observations)

    def __repr__(self) -> str:
        return f"Course({self.robot!r}, {len(self)} observations)"

    @property
    def site(self) -> tuple[str, ...]:
        """The files that were recorded in one place with this course."""
        return self.joined or self.files

    @property
    def recording(self) -> str:
        """A name of the recording for persons."""
        return ", ".join(Path(file).name for file in self.files)


def load_courses(paths: Sequence[Path], config: Config, plugins: Plugins) -> list[Course]:
    """Read everything that the robots of some files observed; ready-made maps are left out, they are no windows.

    Raises RecordingError when a file cannot be read or holds nothing of that kind, ConfigError when the configuration
    speaks of what is not there, UsageError when two files hold the same.
    """
    from mapgraft.recording.mission import nothing_to_map, open_mission

    with open_mission(paths, config, plugins=plugins) as mission:
        seen: dict[str, list[Observation]] = {source.name: [] for source in mission.robots}
        for observation in mission.observations():
            if observation.kind != GRID_MESSAGE:
                seen[observation.robot].append(observation)
        if not any(seen.values()):
            ready = ", ".join(source.name for source in mission.robots if GRID_MESSAGE in source.kinds)
            raise RecordingError(
                f"{ready} holds ready-made maps, which cannot be cut into windows: name recordings of scans"
                if ready
                else nothing_to_map(mission)
            )
        some = [source for source in mission.robots if seen[source.name]]
        courses = [_course(number, source, seen[source.name], mission) for number, source in enumerate(some)]
    for a, b in combinations(courses, 2):
        if a.files != b.files and _same_path(a, b):
            raise UsageError(
                f"{a.recording} and {b.recording} hold the same recording, so that pairs across them would match: "
                "name each recording once"
            )
    return courses


def joined(courses: Sequence[Course], T_receiver_donor: Mapping[tuple[str, str], Transform]) -> list[Course]:
    """The courses with what persons say of how the map frames of two robots lie, which goes before what was recorded.

    Recordings of which one robot each is known to lie in the other's map are of one place from then on.
    """
    out = {course.robot: course for course in courses}
    for (receiver, donor), T in T_receiver_donor.items():
        if receiver not in out or donor not in out or receiver == donor:
            continue
        ours, theirs = out[receiver], out[donor]
        T_world_donor = ours.T_world_map @ T
        if ours.site == theirs.site and ours.world == theirs.world:
            out[donor] = replace(theirs, T_world_map=T_world_donor)
            continue
        T_world_other = T_world_donor @ theirs.T_world_map.inverse()
        site = tuple(dict.fromkeys((*ours.site, *theirs.site)))
        for name, course in out.items():
            if course.site == theirs.site and course.world == theirs.world:
                out[name] = replace(course, world=ours.world, T_world_map=T_world_other @ course.T_world_map)
        for name, course in out.items():
            if course.site in (ours.site, theirs.site):
                out[name] = replace(course, joined=site)
    return list(out.values())


def _course(number: int, source: RobotSource, observations: Sequence[Observation], mission: Mission) -> Course:
    T_world_map = mission.T_world_map.get(source.name)
    stamps_ns = np.array([observation.stamp_ns for observation in observations], np.int64)
    return Course(
        number,
        source.name,
        source.files,
        f"robot {source.name}" if T_world_map is None else "one world",
        T_world_map or Transform.identity(),
        tuple(observations),
        None if source.clock == "index" else stamps_ns,
        source.poses,
        _DOUBTFUL.get(source.drift, ""),
    )


def _same_path(a: Course, b: Course) -> bool:
    """Whether two robots made all their observations at the same places."""
    if len(a) != len(b):
        return False
    ours, theirs = ([o.T_map_base.matrix for o in course.observations] for course in (a, b))
    return bool(np.allclose(ours, theirs, atol=1e-6))
