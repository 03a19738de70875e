"""Observations for the grid's tests: made up ones, and the Intel Research Lab's."""

from __future__ import annotations

import functools
import gzip
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mapgraft.contracts import GRID_MESSAGE, SCAN, GridMessage, Observation, Scan, Transform
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.map_type import OccupancyGrid

MakeScan = Callable[..., Observation]

NO_RETURN_M = {"intel": 81.8, "aces": 49.9, "belgioioso": 81.8, "freiburg-101": 81.8}


def _observation(kind: str, payload: object, T: Transform, stamp_ns: int, sensor: str) -> Observation:
    return Observation("robot", stamp_ns, stamp_ns, sensor, kind, payload, T, T)


@pytest.fixture(scope="session")
def scan_of() -> MakeScan:
    """Makes an observation of one scan: angles (rad), ranges (m), hits, and the sensor's pose (x, y, yaw)."""

    def make(
        angles: object,
        ranges: object,
        hits: object = True,
        pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
        stamp_ns: int = 0,
        sensor: str = "laser",
        beam_poses: object = None,
    ) -> Observation:
        a = np.atleast_1d(np.asarray(angles, np.float64))
        r = np.broadcast_to(np.asarray(ranges, np.float32), a.shape)
        h = np.broadcast_to(np.asarray(hits, np.bool_), a.shape)
        poses = None if beam_poses is None else np.asarray(beam_poses, np.float64)
        scan = Scan(np.stack((np.cos(a), np.sin(a)), axis=1), r, h, poses)
        return _observation(SCAN, scan, Transform.planar(*pose), stamp_ns, sensor)

    return make


@pytest.fixture(scope="session")
def message_of() -> Callable[..., Observation]:
    """Makes an observation of one ready-made map: cells (h, w), resolution (m), and the origin's pose (x, y, yaw)."""

    def make(
        cells: object, resolution_m: float = 0.1, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Observation:
        message = GridMessage(np.asarray(cells, np.int8), resolution_m, Transform.planar(*origin))
        return _observation(GRID_MESSAGE, message, Transform.identity(), 0, "map")

    return make


@pytest.fixture(scope="session")
def carmen(shared_data: Path) -> Callable[[str], list[Observation]]:
    """The scans of a recorded CARMEN log with their corrected poses, by the log's name."""

    @functools.cache
    def read(name: str) -> list[Observation]:
        out = []
        with gzip.open(shared_data / "carmen" / f"{name}-corrected.log.gz", "rt") as lines:
            for number, words in enumerate(line.split() for line in lines if line.startswith("FLASER")):
                beams = int(words[1])
                whole = beams - beams % 2  # an even number of beams starts at -90 degrees and ends before +90
                angles = -math.pi / 2 + math.pi / whole * np.arange(beams)
                ranges = np.array(words[2 : 2 + beams], np.float32)
                scan = Scan(np.stack((np.cos(angles), np.sin(angles)), axis=1), ranges, ranges < NO_RETURN_M[name])
                T = Transform.planar(*map(float, words[2 + beams : 5 + beams]))
                stamp_ns = round(float(words[8 + beams]) * 1e9) if name == "intel" else number
                out.append(_observation(SCAN, scan, T, stamp_ns, "laser"))
        return out

    return read


@pytest.fixture(scope="session")
def intel(carmen: Callable[[str], list[Observation]]) -> list[Observation]:
    """The 910 scans of the Intel log: 180 beams each, no return from 81.8 m on."""
    observations = carmen("intel")
    assert len(observations) == 910
    return observations


@pytest.fixture(scope="session")
def grid_map_of(message_of: Callable[..., Observation]) -> Callable[..., GridMap]:
    """Makes a map from classes (h, w), a resolution, and the cell of element [0, 0]."""

    def make(classes: object, resolution_m: float = 0.1, origin_cell: tuple[int, int] = (0, 0)) -> GridMap:
        grids = OccupancyGrid(resolution_m=resolution_m)
        layer = grids.new_layer()
        cells = np.array([-1, 0, 100], np.int8)[np.asarray(classes)]
        origin = (origin_cell[0] * resolution_m, origin_cell[1] * resolution_m, 0.0)
        grids.integrate(layer, message_of(cells, resolution_m, origin))
        return grids.view(layer)

    return make
