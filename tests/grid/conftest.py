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
from mapgraft_grid.layer import GridLayer
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
def walked(scan_of: MakeScan) -> Callable[..., GridLayer]:
    """Makes a layer of some scans from random places, of 40 beams that end anywhere up to 5 m away."""

    def make(grid: OccupancyGrid, seed: int, scans: int = 6, returned: float = 1.0) -> GridLayer:
        random = np.random.default_rng(seed)
        layer = grid.new_layer()
        for _ in range(scans):
            pose = (*random.uniform(-2, 2, 2), random.uniform(-math.pi, math.pi))
            ranges, hits = random.uniform(0.5, 5.0, 40), random.random(40) < returned
            grid.integrate(layer, scan_of(np.linspace(-2, 2, 40), ranges, hits, pose))
        return layer

    return make


@pytest.fixture(scope="session")
def counts_of() -> Callable[[GridLayer], dict[tuple[int, int], tuple[int, int]]]:
    """Tells the (hits, misses) of all cells (ix, iy) of a layer that have any."""

    def tell(layer: GridLayer) -> dict[tuple[int, int], tuple[int, int]]:
        keys = np.sort(layer.pool.index.keys)
        hits, misses = layer.pool.counts(keys)
        tile_x, tile_y = (keys & ((1 << 26) - 1)) - (1 << 25), (keys >> 26) - (1 << 25)
        return {
            (int(64 * tile_x[t] + c), int(64 * tile_y[t] + r)): (int(hits[t, r, c]), int(misses[t, r, c]))
            for t, r, c in np.argwhere(hits | misses)
        }

    return tell


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
