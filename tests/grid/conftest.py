"""Observations for the grid's tests: made up ones, and the Intel Research Lab's."""

from __future__ import annotations

import gzip
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mapgraft.contracts import GRID_MESSAGE, SCAN, GridMessage, Observation, Scan, Transform

MakeScan = Callable[..., Observation]


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
def intel(shared_data: Path) -> list[Observation]:
    """The 910 scans of the Intel log with their corrected poses: 180 beams each, no return from 81.8 m on."""
    angles = -math.pi / 2 + math.pi / 180 * np.arange(180)
    directions = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    out = []
    with gzip.open(shared_data / "carmen" / "intel-corrected.log.gz", "rt") as lines:
        for line in lines:
            words = line.split()
            if words[0] == "FLASER":
                ranges = np.array(words[2:182], np.float32)
                T = Transform.planar(*map(float, words[182:185]))
                scan = Scan(directions, ranges, ranges < 81.8)
                out.append(_observation(SCAN, scan, T, round(float(words[188]) * 1e9), "laser"))
    assert len(out) == 910
    return out
