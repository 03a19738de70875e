"""Places that are seen by scans, and line maps of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import SCAN, Observation, Scan, Transform
from mapgraft_recordings.buildings import building, drive

Seen = Callable[..., Observation]


@pytest.fixture(scope="session")
def look() -> Seen:
    """One scan all around from a pose, of walls given as segments (n, 2, 2)."""

    def seen(
        walls: NDArray[np.float64],
        pose: tuple[float, float, float],
        beams: int = 360,
        reach_m: float = 12.0,
        noise_m: float = 0.0,
        seed: int = 0,
        robot: str = "ann",
    ) -> Observation:
        x, y, yaw = pose
        angles = np.linspace(-math.pi, math.pi, beams, endpoint=False)
        directions = np.column_stack((np.cos(angles), np.sin(angles)))
        turned = np.column_stack((np.cos(angles + yaw), np.sin(angles + yaw)))
        ranges = np.full(beams, np.inf)
        for (ax, ay), (bx, by) in walls.tolist():
            across, off = np.array([bx - ax, by - ay]), np.array([ax - x, ay - y])
            bent = turned[:, 0] * across[1] - turned[:, 1] * across[0]
            with np.errstate(divide="ignore", invalid="ignore"):
                t = (off[0] * across[1] - off[1] * across[0]) / bent
                s = (off[0] * turned[:, 1] - off[1] * turned[:, 0]) / bent
            hit = (t > 0.0) & (s >= 0.0) & (s <= 1.0)
            ranges[hit] = np.minimum(ranges[hit], t[hit])
        hits = ranges <= reach_m
        noisy = np.where(hits, ranges, reach_m) + noise_m * np.random.default_rng(seed).standard_normal(beams)
        T = Transform.planar(x, y, yaw)
        scan = Scan(directions, np.maximum(noisy, 0.05).astype(np.float32), hits)
        return Observation(robot, 0, 0, "scan", SCAN, scan, T, T)

    return seen


@pytest.fixture(scope="session")
def office() -> Sequence[Observation]:
    """What a robot observes on a drive through a random office, in the building's frame."""
    return tuple(drive(building(6, "office"), 0, 140))
