"""Installing packages as a stranger does, and running mapgraft beside them on a mission in two groves.

The groves have the same columns in the same places, and different ones around them. Ash maps the first grove and goes
out of it; birch comes into the second one from its surroundings, cedar into the first.
"""

from __future__ import annotations

import importlib.util
import math
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from ruamel.yaml import YAML

from mapgraft.contracts import Observation, Transform
from mapgraft_recordings.simulator import (
    Lidar,
    Limits,
    Robot,
    Waypoint,
    build_world,
    observations,
    parse_plan,
    ros_messages,
    simulate,
)
from mapgraft_recordings.writing import write_mcap

HERE = Path(__file__).parent
if importlib.util.find_spec("mapgraft_landmarks") is None:  # for tests that use it in this process
    sys.path.append(str(HERE / "landmarks" / "src"))
LONGEST_S = 600  # a process that takes longer hangs; kernels may have to be compiled first
DURATION_S = 70.0

Run = Callable[..., subprocess.CompletedProcess[str]]
Place = Callable[..., Path]
Points = Sequence[tuple[float, float]]
Pose = tuple[float, float, float]
Event = Mapping[str, Any]

# metres, in the frame of a grove
GROVE = [
    (-4.1, -2.6), (-3.2, 3.4), (-0.6, 1.1), (0.9, -3.3), (2.8, 0.7), (4.4, 3.1), (3.7, -2.0), (-2.0, -0.9), (0.5, 4.3),
]  # fmt: skip
AROUND_FIRST = [(8, -3.2), (9.5, 2.1), (12.3, -1.4), (13.1, 3.6), (15.6, 0.8), (16.9, -3.5), (10.6, 4.9)]
AROUND_SECOND = [(7.4, 1.2), (10.9, -3.6), (11.8, 1.4), (14.4, -2.8), (14.9, 3.9), (17.3, 1.3), (8.6, 4.6)]
ROUND_AND_OUT = [
    (-2.5, -2.2), (-1.5, 2.4), (1.6, 2.2), (2.0, -1.6), (-0.5, -2.4), (-2.8, 1.0), (-0.8, 2.6), (1.5, 1.6), (0, 0),
    (5.5, 0.0), (10.5, 0.4), (14.5, 0.0), (10.0, -1.5),
]  # fmt: skip
IN_AND_ROUND = [(14.5, 0.5), (10.5, 0.4), (6, 0.1), (1.8, -1.2), (-0.5, -2.4), (-2.5, -2.0), (-2.6, 1.2), (1.0, 2.4)]
FIRST, SECOND = (0.0, 0.0, 0.0), (50.0, 20.0, 150.0)  # x, y, yaw in degrees


def columns(places: Points) -> list[dict[str, Any]]:
    return [{"name": "column", "box": [x - 0.15, y - 0.15, 0.3, 0.3]} for x, y in places]


def floor() -> Mapping[str, Any]:
    parts = {
        "grove": {"furniture": columns(GROVE)},
        "first": {"parts": [{"part": "grove"}], "furniture": columns(AROUND_FIRST)},
        "second": {"parts": [{"part": "grove"}], "furniture": columns(AROUND_SECOND)},
    }
    placed = [{"part": "first", "at": FIRST}, {"part": "second", "at": SECOND}]
    return {"name": "two groves", "parts": parts, "floor": {"parts": placed}}


def robot(name: str, route: Points, grove: Pose, T_world_map: Pose, beams: int = 360) -> Robot:
    way = Transform.planar(grove[0], grove[1], math.radians(grove[2])).apply(np.array(route))
    ahead = math.atan2(way[1, 1] - way[0, 1], way[1, 0] - way[0, 0])
    lidar = Lidar(beams, 2.0 * math.pi, range_min_m=0.1, range_max_m=7.0, rate_hz=2.0)
    stops = tuple(Waypoint(float(x), float(y)) for x, y in way)
    return Robot(name, lidar, stops, Limits(speed_m_s=0.8), start_yaw_rad=ahead, T_world_map=T_world_map)


ROBOTS = (
    robot("ash", ROUND_AND_OUT, FIRST, (3.0, 1.0, 0.4)),
    robot("birch", IN_AND_ROUND, SECOND, (47.0, 22.0, -2.0)),
    robot("cedar", IN_AND_ROUND, FIRST, (15.0, -2.0, 2.2), beams=541),
)


@pytest.fixture(scope="session")
def true_pose() -> Callable[[str, str], Transform]:
    """T_receiver_donor of two robots as it is in the world."""
    T = {robot.name: Transform.planar(*robot.T_world_map) for robot in ROBOTS}
    return lambda receiver, donor: T[receiver].inverse() @ T[donor]


@pytest.fixture(scope="session")
def scans() -> Callable[[str, float], list[Observation]]:
    """What one robot observes in its first seconds."""
    world = build_world(parse_plan(floor()), seed=0)

    def of(name: str, duration_s: float) -> list[Observation]:
        robots = [robot for robot in ROBOTS if robot.name == name]
        return list(observations(robots, simulate(world, robots, 0, duration_s)))

    return of


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The mission as an MCAP file: scans, tf and odometry of three robots."""
    path = tmp_path_factory.mktemp("mission") / "two_groves.mcap"
    readings = simulate(build_world(parse_plan(floor()), seed=0), ROBOTS, 0, DURATION_S)
    write_mcap(path, ros_messages(ROBOTS, readings))
    return path


@pytest.fixture(scope="session")
def pip_install(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """Installs a package's source folder with pip, without network, into a folder of its own; returns that folder."""

    def install(source: Path) -> Path:
        target = tmp_path_factory.mktemp("installed")
        options = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "--quiet"]
        command = [sys.executable, "-m", "pip", "install", *options, "--target", str(target), str(source)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
        assert done.returncode == 0, f"{' '.join(command)}\n{done.stderr}"
        return target

    return install


@pytest.fixture(scope="session")
def installed(pip_install: Place) -> Path:
    """Where pip has put the landmarks package."""
    return pip_install(HERE / "landmarks")


@pytest.fixture(scope="session")
def lay_out(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """Puts one module with an entry point into a folder of its own, as if installed; returns that folder."""

    def lay(module: str, text: str) -> Path:
        folder = tmp_path_factory.mktemp(module)
        (folder / f"{module}.py").write_text(text, encoding="utf-8")
        about = folder / f"mapgraft_{module}-0.1.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: mapgraft-{module}\nVersion: 0.1\n")
        (about / "entry_points.txt").write_text(f"[mapgraft]\n{module} = {module}\n")
        return folder

    return lay


@pytest.fixture(scope="session")
def mapgraft() -> Run:
    """Runs the command line in a process that finds the given folders' packages; returns what it said."""

    def run(
        arguments: Sequence[str], installed: Sequence[Path] = (), environment: Mapping[str, str] | None = None
    ) -> subprocess.CompletedProcess[str]:
        return run_python(["-m", "mapgraft", *arguments], installed, environment)

    return run


@pytest.fixture(scope="session")
def replayed(recording: Path, installed: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Outcome]:
    """Replays the mission with a configuration, in a process that finds the landmarks package on its path."""

    def replay(config: Mapping[str, Any]) -> Outcome:
        folder = tmp_path_factory.mktemp("run")
        with (folder / "config.yaml").open("w", encoding="utf-8") as stream:
            YAML(typ="safe", pure=True).dump(dict(config), stream)
        arguments = [HERE / "replay_cells.py", recording, folder / "config.yaml", folder / "out"]
        done = run_python([str(argument) for argument in arguments], [installed])
        assert done.returncode == 0, done.stderr
        return Outcome(folder / "out")

    return replay


def run_python(
    arguments: Sequence[str], installed: Sequence[Path], environment: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    paths = os.pathsep.join(str(folder) for folder in installed)
    return subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, "PYTHONPATH": paths, "COLUMNS": "200", **(environment or {})},
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
    )


@dataclass(frozen=True)
class Outcome:
    """What a run left in its folder."""

    folder: Path

    @property
    def events(self) -> list[Event]:
        return sorted(self._rows("events"), key=lambda row: int(row["seq"]))

    @property
    def snapshots(self) -> list[Event]:
        return sorted(self._rows("maps"), key=lambda row: int(row["snapshot"]))

    def merge(self, merge_id: str) -> list[Event]:
        """All events of one merge, in order."""
        return [event for event in self.events if event["merge_id"] == merge_id]

    def one(self, merge_id: str, kind: str) -> Event:
        (event,) = [event for event in self.merge(merge_id) if event["kind"] == kind]
        return event

    def layer(self, robot: str) -> bytes:
        """What the robot offers at the end, in the map type's encoding."""
        rows = [row for row in self.snapshots if row["robot"] == robot]
        (data,) = [row["layer"] for row in rows if row["sha256"] == rows[-1]["sha256"] and row["layer"] is not None]
        return bytes(data)

    def cells(self, robot: str) -> dict[int, tuple[int, ...]]:
        """Key → counts of the robot's fused landmark map at the end."""
        with np.load(self.folder / f"{robot}.npz") as kept:
            return dict(zip(kept["keys"].tolist(), map(tuple, kept["counts"].tolist()), strict=True))

    def file(self, name: str) -> bytes:
        return (self.folder / "maps" / name).read_bytes()

    def _rows(self, table: str) -> list[Event]:
        (part,) = self.folder.glob(f"{table}/**/*.parquet")
        rows: list[Event] = pq.read_table(part).to_pylist()
        return rows
