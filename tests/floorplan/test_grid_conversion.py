"""Rooms, walls and what is unknown of a plan as a grid."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_floorplan.grid_conversion import ROOM, UNKNOWN, WALL, PlanToGrid, rasterise
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.parameters import Lattice


def at(walls: NDArray[np.float64], x_m: float, y_m: float, cell_m: float = 0.05) -> int:
    found = rasterise(walls, Lattice(cell_m), True)
    return int(found.classes[int(y_m // cell_m) - found.first[1], int(x_m // cell_m) - found.first[0]])


def test_rooms_are_free_and_outside_is_unknown(walls: NDArray[np.float64]) -> None:
    assert at(walls, 2.0, 2.0) == at(walls, 8.0, 7.0) == ROOM
    assert at(walls, 1.0, 7.5) == UNKNOWN  # in the notch
    assert at(walls, 6.0, 0.01) == WALL


def test_an_outer_door_leaves_the_rooms_inside(walls: NDArray[np.float64]) -> None:
    open_ = np.vstack((walls[1:], [[0, 0, 7, 0], [8, 0, 12, 0]]))
    assert at(open_, 7.5, 1.0) == ROOM
    assert at(open_, 7.5, -0.08) == UNKNOWN


def test_without_outer_walls_nothing_is_free(walls: NDArray[np.float64]) -> None:
    assert (rasterise(walls[6:], Lattice(0.05), True).classes != ROOM).all()


def test_the_inside_of_a_thick_wall_is_no_room(walls: NDArray[np.float64]) -> None:
    doubled = np.vstack(
        (walls, [[-0.3, -0.3, 12.3, -0.3], [12.3, -0.3, 12.3, 0], [-0.3, -0.3, -0.3, 0], [-0.3, 0, 0, 0]])
    )
    doubled = np.vstack((doubled, [[12.0, 0, 12.3, 0]]))
    assert at(doubled, 6.0, -0.15) == UNKNOWN
    assert at(doubled, 2.0, 2.0) == ROOM


def test_classes_survive_the_target_s_sensor_model(walls: NDArray[np.float64]) -> None:
    grid = OccupancyGrid(l_hit=0.3, l_miss=-0.1, resolution_m=0.1)
    seen = grid.view(PlanToGrid().convert(PlanLayer(Walls.of_metres(walls)), FloorPlanType(), grid)).dense()
    found = rasterise(walls, Lattice(0.1), True).classes
    assert (seen.classes == 2).sum() == (found == WALL).sum()
    assert (seen.classes == 1).sum() == (found == ROOM).sum() > 1000


def test_a_plan_of_unknown_scale_gets_cells_of_its_own(walls: NDArray[np.float64]) -> None:
    grid = OccupancyGrid()
    made = PlanToGrid().convert(PlanLayer(Walls.of_metres(walls * 100.0), scale_known=False), FloorPlanType(), grid)
    assert made.lattice.resolution_m == pytest.approx(1.2)
    with pytest.raises(MapError, match="too large for a grid"):
        PlanToGrid().convert(PlanLayer(Walls.of_metres(walls * 1000.0)), FloorPlanType(), grid)


def test_the_same_plan_gives_the_same_bytes(walls: NDArray[np.float64]) -> None:
    grid = OccupancyGrid()
    one, other = (
        PlanToGrid().convert(PlanLayer(Walls.of_metres(w)), FloorPlanType(), grid)
        for w in (walls, walls[::-1, [2, 3, 0, 1]])
    )
    assert grid.encode(one) == grid.encode(other)
