"""An orchard to look at: round trunks between walls, and a lidar that sees them."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import SCAN, Observation, Scan, Transform

if importlib.util.find_spec("mapgraft_landmarks") is None:  # not installed: test the source beside us
    sys.path.insert(0, str(Path(__file__).parents[1] / "src"))

BEAMS = 360
RANGE_MAX_M = 12.0

Trunks = NDArray[np.float64]  # (n, 3) x, y, radius in metres
Walls = Sequence[tuple[float, float, float, float]]  # x0, y0, x1, y1 in metres
Look = Callable[..., Scan]
Walk = Callable[..., list[Observation]]


def _ranges(trunks: Trunks, walls: Walls, x: float, y: float, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    nearest = np.full(len(directions), np.inf)
    for trunk_x, trunk_y, radius in trunks:
        to = np.array([trunk_x - x, trunk_y - y])
        along = directions @ to
        beside = to @ to - along**2
        hit = (along > 0) & (beside < radius**2)
        nearest[hit] = np.minimum(nearest[hit], along[hit] - np.sqrt(radius**2 - beside[hit]))
    for x0, y0, x1, y1 in walls:
        wall, to = np.array([x1 - x0, y1 - y0]), np.array([x0 - x, y0 - y])
        across = directions[:, 0] * wall[1] - directions[:, 1] * wall[0]
        across[across == 0] = 1e-12
        distance = (to[0] * wall[1] - to[1] * wall[0]) / across
        share = (to[0] * directions[:, 1] - to[1] * directions[:, 0]) / across
        hit = (distance > 0) & (share >= 0) & (share <= 1)
        nearest[hit] = np.minimum(nearest[hit], distance[hit])
    return nearest


@pytest.fixture(scope="session")
def look() -> Look:
    """One scan from a pose in the world."""

    def look(
        trunks: Trunks, walls: Walls, pose: tuple[float, float, float], noise: np.random.Generator | None = None
    ) -> Scan:
        x, y, yaw = pose
        bearings = -np.pi + 2.0 * np.pi * np.arange(BEAMS) / BEAMS
        ranges = _ranges(trunks, walls, x, y, np.stack((np.cos(bearings + yaw), np.sin(bearings + yaw)), axis=1))
        hits = ranges < RANGE_MAX_M
        ranges[~hits] = RANGE_MAX_M
        if noise is not None:
            ranges[hits] += noise.normal(0.0, 0.01, int(hits.sum()))
        return Scan(np.stack((np.cos(bearings), np.sin(bearings)), axis=1), ranges.astype(np.float32), hits)

    return look


@pytest.fixture(scope="session")
def walk(look: Look) -> Walk:
    """Scans along a path in the world, as seen from the robot's own map frame, with errors of scans and poses."""

    def walk(
        trunks: Trunks,
        walls: Walls,
        path: Sequence[tuple[float, float, float]],
        T_map_world: Transform,
        seed: int,
    ) -> list[Observation]:
        noise = np.random.default_rng(seed)
        observations = []
        for step, (x, y, yaw) in enumerate(path):
            scan = look(trunks, walls, (x, y, yaw), noise)
            dx, dy = noise.normal(0.0, 0.01, 2)
            pose = T_map_world @ Transform.planar(x + dx, y + dy, yaw + noise.normal(0.0, 0.003))
            stamp_ns = step * 100_000_000
            observations.append(Observation("robot", stamp_ns, stamp_ns, "lidar", SCAN, scan, pose, pose))
        return observations

    return walk


@pytest.fixture(scope="session")
def orchard() -> tuple[Trunks, Walls]:
    """Forty metres square with walls around and inside, and trunks at least 1.5 m apart."""
    dice = np.random.default_rng(1)
    trunks: list[NDArray[np.float64]] = []
    for place in dice.uniform(0.0, 40.0, (60, 2)):
        if all(np.hypot(*(place - other[:2])) > 1.5 for other in trunks):
            trunks.append(np.array([*place, dice.uniform(0.05, 0.2)]))
    walls = [(-1, -1, 41, -1), (41, -1, 41, 41), (41, 41, -1, 41), (-1, 41, -1, -1), (15, 20, 25, 20)]
    return np.array(trunks), walls


@pytest.fixture(scope="session")
def two_walks(orchard: tuple[Trunks, Walls], walk: Walk) -> tuple[list[Observation], list[Observation], Transform]:
    """Two robots that walk past each other, and the true T_first_second."""
    along = np.linspace(0.0, 1.0, 80)
    first = [(5 + 25 * s, 5 + 10 * s, 12 * s) for s in along]
    second = [(35 - 25 * s, 18 - 2 * s, -5 * s) for s in along]
    T_first_world, T_second_world = Transform.planar(3.0, -2.0, 1.1), Transform.planar(-7.0, 4.0, -2.5)
    return (
        walk(*orchard, first, T_first_world, seed=1),
        walk(*orchard, second, T_second_world, seed=2),
        T_first_world @ T_second_world.inverse(),
    )
