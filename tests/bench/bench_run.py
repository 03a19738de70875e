"""What a whole run costs per scan, against reading the scans and tracing their rays.

    python tests/bench/bench_run.py [--scans 20000] [--rate 10] [--keep FOLDER]

Three robots of the demo drive their routes over and over; the recording is made first, in a temporary folder. All
ratios are of times measured in one process and one run of this script. Start-up is not counted: everything is run once
on a short piece before.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import combinations
from pathlib import Path

import mapgraft
from mapgraft.config import Config, parse_config
from mapgraft.contracts import SCAN, Scan, Transform
from mapgraft.recording.mission import open_mission
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.observing import cells_of
from mapgraft_recordings.generate import DEMO
from mapgraft_recordings.mission import build_mission, load_mission_plan
from mapgraft_recordings.simulator import load_plan, ros_messages, simulate
from mapgraft_recordings.writing import write_mcap

REACH_M = (30.0, 5.0)  # OccupancyGrid's own limits on beams with and without return
RESOLUTIONS_M = {"alpha": 0.05, "bravo": 0.07, "charlie": 0.10}


NEVER_REVERTED = [
    {
        "name": "as the simulation knows it",
        "match": {"use": "known_pose"},
        "accept": {"use": "thresholds"},
        "fuse": {"use": "log_odds"},
        "verify": {"use": "thresholds", "metrics": {"similarity": {"min": 0.0}, "distance": {"max": 1e9}}, "every": 10},
    }
]


class Stopwatch:
    """Seconds per named stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


def record(folder: Path, scans: int, rate_hz: float) -> list[Path]:
    """The demo's robots, driving until they have that many scans together."""
    mission = build_mission(load_plan(DEMO / "floor.yaml"), load_mission_plan(DEMO / "mission.yaml"), 0)
    duration_s = scans / len(mission.robots) / rate_hz
    paths = []
    for robot in mission.robots:
        lidar = dataclasses.replace(robot.lidar, rate_hz=rate_hz)
        endless = dataclasses.replace(robot, lidar=lidar, loop=True)
        paths.append(folder / f"{robot.name}.mcap")
        write_mcap(paths[-1], ros_messages([endless], simulate(mission.world, [endless], 0, duration_s)))
    return paths


def config_of(**more: object) -> Config:
    robots = {name: {"map": {"resolution_m": r}} for name, r in RESOLUTIONS_M.items()}
    return parse_config({"robots": robots, "output": {"snapshots": False}, **more})


def measure(paths: list[Path], out: Path, watch: Stopwatch) -> int:
    """Time reading, the kernel, and whole runs; returns the number of scans."""
    alone = config_of(exchange={"use": "at", "seconds": [1e9]})
    with open_mission(paths, alone) as mission, watch.stage("reading"):
        count = sum(1 for _ in mission.observations())
    layers = {name: OccupancyGrid(resolution_m=r).new_layer() for name, r in RESOLUTIONS_M.items()}
    with open_mission(paths, alone) as mission:
        for observation in mission.observations():
            if observation.kind == SCAN and isinstance(observation.payload, Scan):
                layer = layers[observation.robot]
                with watch.stage("kernel"):
                    seen = cells_of(observation.payload, observation.T_map_sensor, layer.lattice, REACH_M)
                    if not isinstance(seen, int):
                        layer.pool.count(seen.keys, seen.free, seen.hit)
    with watch.stage("run, nothing merged"):
        mapgraft.run(paths, alone, out / "alone")
    with watch.stage("run without outputs, nothing merged"):
        mapgraft.run(paths, alone)
    merged = config_of(exchange={"use": "at", "seconds": [1.0]}, priors=true_priors(), rules=NEVER_REVERTED)
    with watch.stage("run, six merges standing, SM and DM every 10"):
        result = mapgraft.run(paths, merged, out / "merged")
    assert len(result.standing) == 6
    return count


def true_priors() -> list[dict[str, object]]:
    """Where the simulation placed the robots' map frames, as priors."""
    worlds = build_mission(load_plan(DEMO / "floor.yaml"), load_mission_plan(DEMO / "mission.yaml"), 0).T_world_map
    poses = {
        (a, b): Transform.planar(*worlds[a]).inverse() @ Transform.planar(*worlds[b])
        for a, b in combinations(sorted(worlds), 2)
    }
    return [
        {"receiver": a, "donor": b, "x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad} for (a, b), T in poses.items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scans", type=int, default=20_000)
    parser.add_argument("--rate", type=float, default=10.0, help="scans per second and robot")
    parser.add_argument("--keep", type=Path, help="a folder to make the recording in, and to use again")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        paths = sorted(folder.glob("*.mcap")) or record(folder, given.scans, given.rate)
        measure(record(Path(temporary), 60, given.rate), Path(temporary), Stopwatch())  # compile and import
        watch = Stopwatch()
        count = measure(paths, Path(temporary), watch)
    floor = watch.seconds["reading"] + watch.seconds["kernel"]
    print(f"{count} scans")
    for name, seconds in watch.seconds.items():
        print(f"{name:44s} {seconds:7.2f} s  {seconds / count * 1e6:7.1f} µs per scan  {seconds / floor:5.2f} × floor")
    print(f"{'floor: reading + kernel':44s} {floor:7.2f} s  {floor / count * 1e6:7.1f} µs per scan")


if __name__ == "__main__":
    main()
