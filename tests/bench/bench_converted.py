"""What verifying merges costs whose two maps must be converted to be compared, as mapping goes on.

    python tests/bench/bench_converted.py [--scans 5000] [--rate 10] [--keep FOLDER]

Three robots of the demo, a grid, line segments and a cloud or a second grid, drive their routes over and over and hold
each other's maps and a floor plan from the first second on, where the simulation knows them to lie. Told are the whole
run, the share of it in which receivers' maps are converted and viewed as what is compared, and that in which metrics
look at them; ratios are of times measured in one run of this script.
"""

from __future__ import annotations

import argparse
import dataclasses
import tempfile
import time
from collections.abc import Callable
from itertools import permutations
from pathlib import Path
from typing import Any

import mapgraft
from mapgraft.comparison import Sight
from mapgraft.config import Config, parse_config
from mapgraft.contracts import Transform
from mapgraft.merge import _Watch
from mapgraft_recordings.drawn_plan import as_svg
from mapgraft_recordings.generate import DEMO, drawn_plan, other_lidars
from mapgraft_recordings.mission import Mission, build_mission, load_mission_plan
from mapgraft_recordings.simulator import load_plan, ros_messages, simulate
from mapgraft_recordings.spinning import spinning_messages
from mapgraft_recordings.writing import write_mcap

TYPES = {"alpha": {"type": "occupancy_grid", "resolution_m": 0.05}, "charlie": {"type": "line_segments"}}
CLOUD = {"type": "point_cloud", "resolution_m": 0.1}
GRID = {"type": "occupancy_grid", "resolution_m": 0.07}


def record(folder: Path, scans: int, rate_hz: float, cloud: bool) -> list[Path]:
    """The demo's robots, driving until they have that many scans together, and the floor plan."""
    mission = _mission()
    duration_s = scans / len(mission.robots) / rate_hz
    paths = []
    for robot in mission.robots:
        lidar = dataclasses.replace(robot.lidar, rate_hz=rate_hz)
        endless = dataclasses.replace(robot, lidar=lidar, loop=True)
        paths.append(folder / f"{robot.name}.mcap")
        if cloud and robot.name == "bravo":
            longer = dataclasses.replace(mission, duration_s=duration_s)
            write_mcap(paths[-1], spinning_messages(longer, endless, other_lidars()["bravo"]))
        else:
            write_mcap(paths[-1], ros_messages([endless], simulate(mission.world, [endless], 0, duration_s)))
    paths.append(folder / "plan.svg")
    paths[-1].write_text(as_svg(mission.world, drawn_plan()), encoding="utf-8")
    return paths


def _mission() -> Mission:
    return build_mission(load_plan(DEMO / "floor.yaml"), load_mission_plan(DEMO / "mission.yaml"), 0)


def config_of(cloud: bool, merged: bool) -> Config:
    types = {**TYPES, "bravo": CLOUD if cloud else GRID}
    return parse_config(
        {
            "robots": {name: {"map": kind} for name, kind in types.items()},
            "output": {"snapshots": False},
            "exchange": {"use": "at", "seconds": [5.0 if merged else 1e9]},
            "priors": true_priors(),
        }
    )


def true_priors() -> list[dict[str, object]]:
    """Where the simulation placed the map frames, as priors."""
    worlds = {name: Transform.planar(*pose) for name, pose in _mission().T_world_map.items()}
    worlds["plan"] = Transform.identity()
    poses = {(a, b): worlds[a].inverse() @ worlds[b] for a, b in permutations(sorted(worlds), 2)}
    return [
        {"receiver": a, "donor": b, "x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad, "sigma_m": 0.1}
        for (a, b), T in poses.items()
    ]


class Spent:
    """Calls of, and seconds in, some functions while a run goes on; what one of them does in another counts once."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}
        self._inner: list[float] = []

    def watch(self, function: Callable[..., Any], name_of: Callable[..., str]) -> Callable[..., Any]:
        def watched(*args: Any) -> Any:
            name = name_of(*args)
            self._inner.append(0.0)
            start = time.perf_counter()
            try:
                return function(*args)
            finally:
                whole = time.perf_counter() - start
                self.seconds[name] = self.seconds.get(name, 0.0) + whole - self._inner.pop()
                self.calls[name] = self.calls.get(name, 0) + 1
                if self._inner:
                    self._inner[-1] += whole

        return watched


def told(paths: list[Path], config: Config, spent: Spent) -> tuple[float, int]:
    """Seconds of a run, and how many merges stand at its end."""
    see, ask = Sight.__call__, _Watch.ask
    Sight.__call__ = spent.watch(see, lambda sight: f"see as {sight.map_type.name}")
    _Watch.ask = spent.watch(
        ask, lambda watch, _: f"{'converted' if watch.converted else 'plain'}: {type(watch.tracker).__module__}"
    )
    start = time.perf_counter()
    try:
        standing = len(mapgraft.run(paths, config).standing)
        return time.perf_counter() - start, standing
    finally:
        Sight.__call__, _Watch.ask = see, ask


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scans", type=int, default=5_000)
    parser.add_argument("--rate", type=float, default=10.0, help="scans per second and robot")
    parser.add_argument("--cloud", action="store_true", help="bravo carries a spinning lidar")
    parser.add_argument("--keep", type=Path, help="a folder to make the recording in, and to use again")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        paths = sorted(folder.glob("*.mcap")) + sorted(folder.glob("*.svg"))
        paths = paths or record(folder, given.scans, given.rate, given.cloud)
        short = Path(temporary) / "short"
        short.mkdir()
        told(record(short, 300, given.rate, given.cloud), config_of(given.cloud, True), Spent())  # compile and import
        for name, merged in (("nothing merged", False), ("merged", True)):
            spent = Spent()
            seconds, standing = told(paths, config_of(given.cloud, merged), spent)
            print(f"{name}: {seconds:.1f} s, {seconds / given.scans * 1e3:.2f} ms per scan, {standing} merges stand")
            for what, took in sorted(spent.seconds.items()):
                print(f"  {what:50s} {spent.calls[what]:6d} calls  {took:7.2f} s  {took / seconds:6.1%}")


if __name__ == "__main__":
    main()
