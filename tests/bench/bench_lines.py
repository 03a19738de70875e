"""What mapping line segments costs as the map grows, as ratios measured in one run.

    python tests/bench/bench_lines.py LOG.log.gz [--times 12]

Maps a CARMEN log over and over, each time 60 m farther on, so that the map grows by as much each time, and shows it
after every scan (``integrate``, then ``view``). Everything is CPU time.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from pathlib import Path

from mapgraft.config import parse_config
from mapgraft.contracts import Observation, Transform
from mapgraft.recording.mission import open_mission
from mapgraft_lines.line_map import LineMap
from mapgraft_lines.map_type import LineSegments

APART_M = 60.0


def observed(log: Path) -> list[Observation]:
    with open_mission([log], parse_config({})) as mission:
        return list(mission.observations())


def moved(observation: Observation, T: Transform) -> Observation:
    return dataclasses.replace(
        observation, T_map_sensor=T @ observation.T_map_sensor, T_map_base=T @ observation.T_map_base
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("--times", type=int, default=12)
    given = parser.parse_args()
    scans, kind, view = observed(given.log), LineSegments(), None
    layer, first = kind.new_layer(), 0.0
    for scan in scans:  # compiles what is compiled
        kind.integrate(layer, scan)
    layer = kind.new_layer()
    print(f"{given.log.name}: {len(scans)} scans, {given.times} times")
    for turn in range(given.times):
        T = Transform.planar(turn * APART_M, 0.0, 0.0)
        farther = [moved(scan, T) for scan in scans]
        start = time.process_time()
        for scan in farther:
            region = kind.integrate(layer, scan)
            view = kind.view(layer, (), view, region)
        took = time.process_time() - start
        first = first or took
        assert isinstance(view, LineMap)
        rows = len(view.total.pieces) + len(view.total.space)
        print(f"  {rows:7d} rows: {len(scans) / took:5.0f} scans/s, {took / first:.2f} of the first")


if __name__ == "__main__":
    main()
