"""Clouds as grids and grids as slices of voxels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mapgraft.contracts import ConfigError, MapError, Observation, Transform
from mapgraft_cloud.grid_conversion import GridConversion, SliceConversion
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.map_type import PointCloud
from mapgraft_grid.grid_map import FREE, OCCUPIED
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_recordings.buildings import building
from mapgraft_recordings.buildings.spatial import record_spatial

Observe = Callable[..., Observation]


def classes_at(kind: OccupancyGrid, layer: object, points: list[tuple[float, float]]) -> list[int]:
    dense = kind.view(layer).dense()
    found = []
    for x, y in points:
        column = int((x - dense.origin_m[0]) // dense.resolution_m)
        row = int((y - dense.origin_m[1]) // dense.resolution_m)
        inside = 0 <= row < dense.classes.shape[0] and 0 <= column < dense.classes.shape[1]
        found.append(int(dense.classes[row, column]) if inside else -9)
    return found


def test_the_band_counts_and_the_rest_does_not(observe: Observe) -> None:
    kind, grid = PointCloud(free=0.45), OccupancyGrid(resolution_m=0.1)
    layer = kind.new_layer()
    floor = [[x, y, 0.05] for x in np.arange(0.05, 6, 0.1) for y in np.arange(0.05, 3, 0.1)]
    lamp, wall, step = [2.05, 1.05, 2.55], [4.05, 1.05, 1.05], [3.05, 2.05, 0.15]
    seat = Transform.from_quaternion((0.05, 1.05, 1.0), (0, 0, 0, 1))
    beams = np.array([*floor, lamp, wall, step, [5.0, 2.0, 1.1]]) - [0.05, 1.05, 1.0]
    for _ in range(5):
        kind.integrate(layer, observe(beams, seat))
    made = GridConversion().convert(layer, PointCloud(), grid)
    assert classes_at(grid, made, [(4.05, 1.05)]) == [OCCUPIED]
    assert classes_at(grid, made, [(2.05, 1.05), (1.05, 1.05)]) == [FREE, FREE]
    assert made.observations == 5


def test_a_drive_becomes_the_grid_of_its_building(drives: tuple[CloudLayer, CloudLayer]) -> None:
    grid = OccupancyGrid()
    made = grid.view(GridConversion().convert(drives[0], PointCloud(), grid))
    dense = made.dense()
    rows, columns = np.nonzero(dense.classes == OCCUPIED)
    points = np.stack((columns, rows), axis=1) * 0.05 + dense.origin_m + 0.025
    house = building(2)
    outlines = np.concatenate([house.solid, *(np.hstack((o, np.roll(o, -1, axis=0))) for o in house.loose)])
    starts, ways = outlines[:, :2], outlines[:, 2:] - outlines[:, :2]
    share = np.clip(((points[:, None] - starts) * ways).sum(axis=2) / (ways**2).sum(axis=1), 0, 1)
    away = np.linalg.norm(points[:, None] - (starts + share[..., None] * ways), axis=2).min(axis=1)
    assert np.mean(away < 0.2) > 0.9
    where = record_spatial(house, 0, 40).believed[:, :2]
    cells = ((where - dense.origin_m) / 0.05).astype(int)
    assert np.mean(dense.classes[cells[:, 1], cells[:, 0]] == FREE) > 0.8


def test_a_ready_made_cloud_gives_walls_and_no_free_space(observe: Observe) -> None:
    kind, grid = PointCloud(), OccupancyGrid()
    layer = kind.new_layer()
    wall = [[2.0, y, z] for y in np.arange(0, 3, 0.1) for z in np.arange(0.0, 2, 0.1)]
    kind.integrate(layer, observe(wall, None, None, True))
    seen = grid.view(GridConversion().convert(layer, PointCloud(), grid)).dense()
    assert (seen.classes == OCCUPIED).any()
    assert not (seen.classes == FREE).any()


def test_nothing_becomes_nothing() -> None:
    kind, grid = PointCloud(), OccupancyGrid()
    assert not grid.view(GridConversion().convert(kind.new_layer(), PointCloud(), grid)).known()
    assert not kind.view(SliceConversion().convert(grid.new_layer(), grid, kind)).known()


def test_a_slice_keeps_the_counts_and_says_its_height(drives: tuple[CloudLayer, CloudLayer]) -> None:
    kind, grid = PointCloud(), OccupancyGrid(resolution_m=0.1)
    flat = GridConversion().convert(drives[0], PointCloud(), grid)
    made = SliceConversion(height_m=1.25).convert(flat, grid, kind)
    seen = kind.view(made)
    assert np.allclose(seen.points_m[:, 2], 1.25, atol=0.01)
    assert len(seen.points_m) == int((grid.view(flat).dense().classes == OCCUPIED).sum())
    assert len(kind.region(made)) == grid.view(flat).known()
    strict = OccupancyGrid(resolution_m=0.1, occupied=0.9)
    read = kind.view(SliceConversion().convert(flat, strict, kind)).points_m
    assert 0 < len(read) == int((strict.view(flat).dense().classes == OCCUPIED).sum()) < len(seen.points_m)


def test_other_types_and_bands_are_refused(drives: tuple[CloudLayer, CloudLayer]) -> None:
    kind, grid = PointCloud(), OccupancyGrid()
    with pytest.raises(MapError, match="point clouds convert to occupancy_grid, found point_cloud"):
        GridConversion().convert(drives[0], kind, kind)
    with pytest.raises(MapError, match="found a layer of type point_cloud"):
        SliceConversion().convert(drives[0], grid, kind)
    with pytest.raises(MapError, match="made for a point cloud, found occupancy_grid"):
        SliceConversion().convert(grid.new_layer(), grid, grid)
    with pytest.raises(ConfigError, match="from a lower to a higher"):
        GridConversion(low_m=2.0)
    with pytest.raises(ConfigError, match="must be finite"):
        SliceConversion(height_m=float("nan"))
