"""The bounded sample of beams and poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from random import Random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Observation, Rays, Scan
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid

MakeScan = Callable[..., Observation]

ANGLES = np.linspace(-math.pi / 2, math.pi / 2, 181)


def _scans(scan_of: MakeScan, seed: int, count: int) -> list[Observation]:
    random = np.random.default_rng(seed)
    return [
        scan_of(ANGLES, random.uniform(0.5, 4.0, 181), random.random(181) < 0.8, (*random.uniform(-1, 1, 2), 0.1 * i))
        for i in range(count)
    ]


def _layer(grid: OccupancyGrid, scans: list[Observation]) -> GridLayer:
    layer = grid.new_layer()
    for scan in scans:
        grid.integrate(layer, scan)
    return layer


def _rows(rays: Rays) -> NDArray[np.float64]:
    return np.column_stack((rays.origins_m, rays.ends_m, rays.hits))


def test_about_one_beam_in_five_degrees_is_kept(scan_of: MakeScan) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    scan = _scans(scan_of, 1, 1)[0]
    rays = _layer(grid, [scan]).rays()
    assert len(rays.hits) == 37
    assert isinstance(scan.payload, Scan)
    whole = scan.payload.rays(scan.T_map_sensor)
    for origin, end, hit in zip(*rays, strict=True):
        distance = abs(whole.ends_m - end).max(axis=1)
        # free beams end at the free range of 5 m at most, and these are shorter
        assert distance.min() < 0.1 / 256
        assert whole.hits[distance.argmin()] == hit
        assert abs(origin - whole.origins_m[0]).max() < 0.1 / 256


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), limit=st.integers(0, 20), order=st.randoms(use_true_random=False))
def test_what_is_kept_does_not_depend_on_the_order(scan_of: MakeScan, seed: int, limit: int, order: Random) -> None:
    grid, everything = OccupancyGrid(rays_per_tile=limit), OccupancyGrid(rays_per_tile=4096)
    scans = _scans(scan_of, seed, 12)
    all_rays = _rows(_layer(everything, scans).rays())
    kept = _rows(_layer(grid, scans).rays())
    order.shuffle(scans)
    scans += scans[:3]  # the same beams again are the same rays
    assert (_rows(_layer(grid, scans).rays()) == kept).all()
    tiles, counts = np.unique(np.floor(all_rays[:, 2:4] / (64 * 0.05)), axis=0, return_counts=True)
    ours, held = np.unique(np.floor(kept[:, 2:4] / (64 * 0.05)), axis=0, return_counts=True)
    assert {tuple(ray) for ray in kept} <= {tuple(ray) for ray in all_rays}
    assert dict(zip(map(tuple, ours), held, strict=True)) == {
        tuple(tile): min(count, limit) for tile, count in zip(tiles, counts, strict=True) if limit
    }


def test_memory_is_bounded_by_the_area(intel: list[Observation]) -> None:
    grid = OccupancyGrid(rays_per_tile=16, poses_per_tile=10)
    layer = _layer(grid, intel)
    rays, path = len(layer.rays().hits), len(layer.path())
    tiles = len(layer.pool.index)
    assert rays <= 16 * tiles
    assert path <= 10 * tiles
    for observation in intel[::-1]:
        grid.integrate(layer, observation)
    assert len(layer.rays().hits) <= rays * 1.05
    assert len(layer.path()) <= path * 1.2


def test_a_path_keeps_its_order_and_leaves_out_standing_still(intel: list[Observation]) -> None:
    grid = OccupancyGrid(poses_per_tile=4096)
    layer = _layer(grid, [intel[0]] * 5 + intel[:100] + [intel[99]] * 5)
    path = layer.path()
    driven = np.array([(o.T_map_base.x_m, o.T_map_base.y_m, o.T_map_base.yaw_rad) for o in intel[:100]])
    assert 50 < len(path) <= 100
    at = [int(abs(driven - pose).max(axis=1).argmin()) for pose in path]
    assert at == sorted(at)
    assert abs(driven[at] - path).max() < 0.05 / 100
    steps = np.hypot(*np.diff(path[:, :2], axis=0).T)
    turns = abs(np.angle(np.exp(1j * np.diff(path[:, 2]))))
    assert ((steps >= 0.1 - 0.05 / 100) | (turns >= math.radians(5.0) - 1e-4)).all()


def test_nothing_is_kept_where_nothing_may_be(scan_of: MakeScan) -> None:
    grid = OccupancyGrid(rays_per_tile=0, poses_per_tile=0)
    layer = _layer(grid, _scans(scan_of, 2, 3))
    assert layer.path().shape == (0, 3)
    assert layer.rays().ends_m.shape == (0, 2)
