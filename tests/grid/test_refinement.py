"""Refinement: placements end below a cell, wherever within some cells they began; along a corridor they hardly move."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft_grid.grid_map import OCCUPIED, GridMap
from mapgraft_grid.refinement import FAR_M, distance_field, placed, refined

MakeMap = Callable[..., GridMap]


def room(resolution_m: float, T_map_world: Transform, grid_map_of: MakeMap) -> GridMap:
    """A room of 8 m by 5 m with a pillar, walls of 0.2 m, seen from a frame of its own."""
    columns = rows = round(14.0 / resolution_m)
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    world = T_map_world.inverse().apply(np.stack((x.ravel(), y.ravel()), axis=1) * resolution_m - 7.0)
    u, v = np.abs(world).T
    wall = ((u >= 4.0) & (u < 4.2) & (v < 2.7)) | ((v >= 2.5) & (v < 2.7) & (u < 4.2))
    wall |= (np.abs(world - (2.0, 1.0)) < 0.4).all(axis=1)
    classes = np.where(wall, OCCUPIED, (u < 4.0) & (v < 2.5)).reshape(rows, columns)
    cell = -round(7.0 / resolution_m)
    return grid_map_of(classes, resolution_m, (cell, cell))


@settings(deadline=None, max_examples=20)
@given(
    st.sampled_from([(0.05, 0.05), (0.1, 0.1), (0.05, 0.1), (0.1, 0.05)]),
    st.floats(0.1, 1.4),  # aligned cells would round all edges to one side
    st.integers(0, 1000),
)
def test_refined_below_a_cell(grid_map_of: MakeMap, resolutions_m: tuple[float, float], yaw: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    T = Transform.planar(*random.uniform(-1.0, 1.0, 2), yaw)
    one, other = room(resolutions_m[0], Transform.identity(), grid_map_of), room(resolutions_m[1], T, grid_map_of)
    start = Transform.planar(*random.uniform(-0.15, 0.15, 2), random.uniform(-0.03, 0.03)) @ T.inverse()
    centre = T.apply(np.zeros((1, 2)))[0]
    found = refined(distance_field(one), distance_field(other), centre, [start])[0]
    shift = found.apply(centre[None])[0]
    assert np.hypot(*shift) < 0.25 * max(resolutions_m)
    assert abs(math.remainder(found.yaw_rad + yaw, 2.0 * math.pi)) < math.radians(0.2)


def test_along_a_corridor_little_moves(grid_map_of: MakeMap) -> None:
    classes = np.ones((30, 200), np.uint8)
    classes[[0, 1, -2, -1]] = OCCUPIED
    one = grid_map_of(classes)
    start = Transform.planar(3.0, 0.12, 0.01)
    found = refined(distance_field(one), distance_field(one), np.array([10.0, 1.5]), [start])[0]
    place = found.apply(np.array([[10.0, 1.5]]))[0]
    assert place == pytest.approx([13.0, 1.5], abs=0.3)
    assert abs(place[1] - 1.5) < 0.03
    assert abs(found.yaw_rad) < math.radians(0.1)


def test_where_no_wall_is_near_nothing_moves(grid_map_of: MakeMap) -> None:
    one = room(0.1, Transform.identity(), grid_map_of)
    far = Transform.planar(40.0, 3.0, 0.5)
    found = refined(distance_field(one), distance_field(one), np.zeros(2), [far])[0]
    assert found.difference(far) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert refined(distance_field(one), distance_field(one), np.zeros(2), []) == []


def test_distances_are_to_the_nearest_wall(grid_map_of: MakeMap) -> None:
    classes = np.ones((9, 9), np.uint8)
    classes[4, 4] = OCCUPIED
    field = distance_field(grid_map_of(classes))
    row, column = np.argwhere(field.distances_m == 0.0)[0]
    assert field.origin_m + (np.array([column, row]) + 0.5) * field.unit_m == pytest.approx(field.points[0])
    assert field.distances_m[row, column + 3] == pytest.approx(0.3)
    assert field.distances_m.max() <= FAR_M
    assert distance_field(grid_map_of(classes, 0.01)).unit_m == 0.05


@given(st.floats(-3, 3), st.floats(-9, 9), st.floats(-9, 9), st.floats(-9, 9), st.floats(-9, 9))
def test_placed_brings_the_centre_to_its_place(yaw: float, x: float, y: float, u: float, v: float) -> None:
    centre: NDArray[np.float64] = np.array([u, v])
    T = placed(np.array([x, y, yaw]), centre)
    assert T.apply(centre[None])[0] == pytest.approx([x, y], abs=1e-9)
    assert T.yaw_rad == pytest.approx(yaw)
