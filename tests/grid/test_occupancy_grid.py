"""The configuration of the map type."""

from __future__ import annotations

import math
from typing import Any

import pytest

from mapgraft.contracts import ConfigError, MapType
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.parameters import Lattice

IMPOSSIBLE: dict[str, list[Any]] = {
    "resolution_m": [0, -0.05, math.nan, math.inf, "fine", None, True],
    "l_hit": [0, -1, 1e-9, 11, math.nan],
    "l_miss": [0, 1, -11, math.nan],
    "clamp": [0, -5, 0.3, 32, math.nan],
    "occupied": [0.4, 1.0, 65, math.nan],
    "free": [0.0, 0.6, 19.6, math.nan],
    "max_range_m": [-1, math.inf, math.nan, 1e6],
    "free_range_m": [-1, math.inf, math.nan],
    "rays_per_tile": [-1, 10_000, 1.5],
    "poses_per_tile": [-1, 10_000, 1.5],
    "beam_step_deg": [-1.0],
    "path_step_m": [-1.0],
    "path_step_deg": [math.nan],
}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in IMPOSSIBLE.items() for value in values])
def test_impossible_values_are_told_in_one_sentence(name: str, value: Any) -> None:
    with pytest.raises(ConfigError, match=name) as caught:
        OccupancyGrid(**{name: value})
    assert "\n" not in str(caught.value)


def test_cells_too_fine_for_a_range_that_nobody_gave_are_named() -> None:
    with pytest.raises(ConfigError, match=r"max_range_m .* with cells of 1e-05 m, found 30.0: take coarser cells"):
        OccupancyGrid(resolution_m=0.00001)
    OccupancyGrid(resolution_m=0.00001, max_range_m=5.0, free_range_m=5.0)


def test_it_is_a_map_type() -> None:
    grid: MapType = OccupancyGrid()
    assert grid.name == grid.new_layer().map_type == grid.view(None).map_type == "occupancy_grid"


@pytest.mark.parametrize("resolution", [0.03, 0.05, 0.07, 0.1])
def test_a_lattice_has_one_name(resolution: float) -> None:
    for cell in (-100_000, -788, -1, 0, 1, 12_345):
        lattice, (ix, iy) = Lattice.through(cell * resolution, -cell * resolution, resolution)
        assert (lattice, ix, iy) == (Lattice(resolution), cell, -cell)
        shifted, at = Lattice.through((cell + 0.25) * resolution, 0.0, resolution)
        assert at == (cell, 0)
        assert shifted.anchor_m == pytest.approx((0.25 * resolution, 0.0))
        assert shifted.corner_m(*at) == pytest.approx(((cell + 0.25) * resolution, 0.0))
