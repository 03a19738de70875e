"""A flat to draw and to map: its walls, its plan as files, and a robot's map of it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import GridMessage, Layer, Observation, Transform
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.map_type import OccupancyGrid

HERE = Transform.identity()
WALLS = np.array(
    [
        [0, 0, 12, 0],
        [12, 0, 12, 8],
        [12, 8, 3, 8],
        [3, 8, 3, 6.5],
        [3, 6.5, 0, 6.5],
        [0, 6.5, 0, 0],
        [5, 0, 5, 3],
        [5, 4, 5, 8],
        [5, 5, 8, 5],
        [9, 5, 12, 5],
        [0, 4, 2.2, 4],
        [3.2, 4, 5, 4],
    ],
    np.float64,
)


@pytest.fixture(scope="session")
def walls() -> NDArray[np.float64]:
    """(n, 4) of a flat of 12 × 8 m with a notch, four rooms and doors."""
    return WALLS.copy()


@pytest.fixture(scope="session")
def plan_layer() -> PlanLayer:
    return PlanLayer(Walls.of_metres(WALLS), observations=1)


def drawn_cells(walls: NDArray[np.float64], side_m: float, unknown_beyond: float | None = None) -> NDArray[np.int8]:
    """A ready-made grid of walls: rooms free, outside unknown; row 0 at the bottom, its corner at (-1, -1)."""
    import cv2

    height, width = round(10.0 / side_m), round(14.0 / side_m)
    cells = np.zeros((height, width), np.uint8)
    corners = np.round((walls.reshape(-1, 2, 2) + 1.0) / side_m - 0.5).astype(np.int32)
    cv2.polylines(cells, list(corners.reshape(-1, 2, 1, 2)), False, 1)
    outside = np.pad(cells, 1)
    cv2.floodFill(outside, None, (0, 0), 2)
    out = np.zeros((height, width), np.int8)
    out[outside[1:-1, 1:-1] == 2] = -1
    out[cells == 1] = 100
    if unknown_beyond is not None:
        out[:, round((unknown_beyond + 1.0) / side_m) :] = -1
    return out


@pytest.fixture(scope="session")
def grid_type() -> OccupancyGrid:
    return OccupancyGrid()


def mapped(walls: NDArray[np.float64], unknown_beyond: float | None = None) -> tuple[OccupancyGrid, Layer]:
    """A grid type with the layer of a robot that knows these walls."""
    grid = OccupancyGrid()
    layer = grid.new_layer()
    message = GridMessage(drawn_cells(walls, 0.05, unknown_beyond), 0.05, Transform.planar(-1.0, -1.0, 0.0))
    grid.integrate(layer, Observation("robot", 0, 0, "map", "grid_message", message, HERE, HERE))
    return grid, layer


@pytest.fixture(scope="session")
def robot_map() -> GridMap:
    """What a robot that has not seen the last three metres knows of the flat."""
    grid, layer = mapped(WALLS, 9.0)
    return grid.view(layer)


@pytest.fixture(scope="session")
def early_map() -> GridMap:
    """What it knew before, of the rooms this side of the middle."""
    grid, layer = mapped(WALLS, 7.0)
    return grid.view(layer)


@pytest.fixture
def robot() -> tuple[OccupancyGrid, Layer]:
    return mapped(WALLS, 9.0)
