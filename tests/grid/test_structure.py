"""Where a grid says that something stands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import GRID_MESSAGE, GridMessage, MapError, Observation, Transform
from mapgraft_grid.grid_map import OCCUPIED, UNKNOWN, GridMap
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.region import GridRegion

HERE = Transform.identity()


def ready(cells: np.ndarray, resolution_m: float, x_m: float = 0.0, y_m: float = 0.0) -> GridMap:
    """A map of these cells; element [0, 0] has its lower-left corner at (x_m, y_m)."""
    grids = OccupancyGrid(resolution_m=resolution_m)
    layer = grids.new_layer()
    message = GridMessage(cells.astype(np.int8), resolution_m, Transform.planar(x_m, y_m, 0.0))
    grids.integrate(layer, Observation("r", 0, 0, "m", GRID_MESSAGE, message, HERE, HERE))
    return grids.view(layer)


def expected(map_: GridMap, within: GridMap | None) -> np.ndarray:
    """Cell by cell: the centre, and whether the cell of the other map in which it lies is known."""
    dense, found = map_.dense(), []
    for row, column in zip(*np.nonzero(dense.classes == OCCUPIED), strict=True):
        x = dense.origin_m[0] + (column + 0.5) * dense.resolution_m
        y = dense.origin_m[1] + (row + 0.5) * dense.resolution_m
        if within is not None:
            ix = int(np.floor((x - within.anchor_m[0]) / within.resolution_m))
            iy = int(np.floor((y - within.anchor_m[1]) / within.resolution_m))
            if within.dense_over((ix, iy), (1, 1)).classes[0, 0] == UNKNOWN:
                continue
        found.append((x, y))
    return np.array(sorted(found)).reshape(-1, 2)


CELLS = st.integers(1, 90).flatmap(
    lambda width: st.integers(0, 2**32 - 1).map(
        lambda seed: np.random.default_rng(seed).choice([-1, 0, 100], (width, 97 - width))
    )
)


@settings(max_examples=30, deadline=None)
@given(CELLS, CELLS, st.sampled_from([0.05, 0.07, 0.1]), st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))
def test_the_centres_of_occupied_cells_where_the_other_map_knows_something(mine, other, resolution_m, x_m, y_m):
    grids = OccupancyGrid()
    map_, within = ready(mine, 0.07, -1.0, 0.5), ready(other, resolution_m, x_m, y_m)
    for limit in (None, within):
        if not map_.is_empty and not (limit is not None and limit.is_empty):
            found = grids.structure(map_, limit)
            assert found.dtype == np.float64
            assert found[np.lexsort(found.T[::-1])] == pytest.approx(expected(map_, limit), abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(CELLS, st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
def test_the_known_region_holds_the_known_cells_and_no_others(cells, x_m, y_m):
    map_ = ready(cells, 0.07, x_m, y_m)
    region = OccupancyGrid().known_region(map_)
    assert len(region) == map_.known()
    if not map_.is_empty:
        dense = map_.dense()
        assert region == GridRegion.from_mask(map_.lattice, dense.origin_cell, dense.classes != UNKNOWN)


def test_nothing_stands_in_an_empty_map():
    grids = OccupancyGrid()
    empty, wall = grids.view(grids.new_layer()), ready(np.full((3, 3), 100), 0.05)
    assert grids.structure(empty).shape == (0, 2)
    assert len(grids.known_region(empty)) == 0
    assert grids.structure(empty, wall).shape == (0, 2)
    assert grids.structure(wall, empty).shape == (0, 2)
    assert grids.structure(wall, wall).shape == (9, 2)


def test_maps_of_another_type_are_refused():
    class Chart:
        map_type = "chart"

        def known(self) -> int:
            return 1

    with pytest.raises(MapError, match="chart"):
        OccupancyGrid().structure(Chart())
