"""What a robot has mapped beyond everything that a plan draws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft_floorplan.evidence_table import FACTORS, OUTSIDE, agreement
from mapgraft_floorplan.grid_conversion import PlanToGrid
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.outline import BEYOND_M, beyond, outline
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.prepared import Prepared, prepare


def plan_grid(walls: NDArray[np.float64]) -> Prepared:
    grid = OccupancyGrid()
    return prepare(grid.view(PlanToGrid().convert(PlanLayer(Walls.of_metres(walls)), FloorPlanType(), grid)), 0.1)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.floats(1e-3, 1e4))
def test_all_points_lie_within_and_each_line_touches_one(seed: int, count: int, size: float) -> None:
    points = np.random.default_rng(seed).uniform(-size, size, (count, 2)) + 3.0 * size
    found = outline(points)
    off = found.normals @ points.T - found.limits[:, None]
    assert np.hypot(*found.normals.T) == pytest.approx(1.0)
    assert off.max(initial=-math.inf) < 1e-5 * size
    assert (off.max(axis=1) > -1e-5 * size).all()


@pytest.mark.parametrize("points", [np.zeros((1, 2)), np.zeros((5, 2))])
def test_a_point_has_nothing_beyond_it(points: NDArray[np.float64]) -> None:
    assert not len(outline(points).limits)


@pytest.mark.parametrize("turn_rad", [0.0, 0.7, math.pi, -2.0])
def test_cells_beyond_the_outer_walls_are_counted(
    walls: NDArray[np.float64], robot_map: GridMap, turn_rad: float
) -> None:
    robot = prepare(robot_map, 0.1)
    T = Transform.planar(1.0, -2.0, turn_rad)  # where the plan's frame lies
    plan = plan_grid(T.inverse().apply(walls[:6].reshape(-1, 2)).reshape(-1, 4))
    assert beyond(robot, plan, T)[1:4].sum() == 0  # the notch and the unmapped part change nothing
    shifted = Transform.planar(4.0, 0.0, 0.0) @ T  # of the 9 m that were mapped 4 stay outside
    cells, marks = robot.marked_cells
    x_m = robot.origin_m[0] + (cells[:, 1] + 0.5) * robot.unit_m
    expected = np.bincount(marks[x_m < 4.0 - BEYOND_M], minlength=5)
    assert np.abs(beyond(robot, plan, shifted) - expected).max() <= 0.06 * expected.sum()


def test_what_lies_beyond_speaks_against_a_place(walls: NDArray[np.float64], robot_map: GridMap) -> None:
    robot, plan = prepare(robot_map, 0.1), plan_grid(walls)
    right, off = (agreement(robot, plan, Transform.planar(x, 0.0, 0.0)) for x in (0.0, 5.0))
    assert right.outside == 0
    assert off.outside > 0.4 * robot.mark_counts[1:4].sum()  # of all its free cells and walls
    assert off.log_ratio == pytest.approx(float((off.table * FACTORS).sum()) - OUTSIDE * off.outside)
    assert right.log_ratio == pytest.approx(float((right.table * FACTORS).sum()))
