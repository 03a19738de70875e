"""Baking contributions in and discarding them again, as single_map and multi_map do, against brute force."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Contribution, MapError, Observation, Provenance, Transform
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.region import GridRegion
from mapgraft_grid.weights import TileWeights

MakeScan = Callable[..., Observation]
Walked = Callable[..., GridLayer]

SHAPE, ORIGIN = (160, 200), (-90, -70)


def _contribution(grid: OccupancyGrid, layer: GridLayer, weight: int = 1) -> Contribution:
    tiles = np.sort(layer.pool.index.keys)
    weights = TileWeights(tiles, np.full(tiles.size, weight, np.uint8))
    fill = grid.region(layer) if weight == 0 else None
    return Contribution(
        Provenance("donor", 0, 1), layer, Transform.identity(), 1.0, "nearest/1", weights, fill, grid.region(layer)
    )


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31), weight=st.integers(0, 3))
def test_what_was_baked_in_looks_like_what_was_added(walked: Walked, seed: int, weight: int) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    own, donor = walked(grid, seed), walked(grid, seed + 1)
    contribution = _contribution(grid, donor, weight)
    expected = grid.view(own, (contribution,)).dense_over(ORIGIN, SHAPE).log_odds
    before = grid.view(own)
    changed = grid.absorb(own, contribution)
    after = grid.view(own, (), before, changed)
    assert (after.dense_over(ORIGIN, SHAPE).log_odds == expected).all()
    assert (grid.view(own).dense_over(ORIGIN, SHAPE).log_odds == expected).all()
    assert len(changed) == len(changed.intersection(grid.region(donor))) > 0
    again = grid.decode(grid.encode(own))
    assert grid.encode(again) == grid.encode(own)
    assert (grid.view(again).dense_over(ORIGIN, SHAPE).log_odds == expected).all()
    assert grid.region(again) == grid.region(own)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_discarding_counts_what_it_says(walked: Walked, seed: int) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    own, donor = walked(grid, seed), walked(grid, seed + 1)
    original = grid.view(own).dense_over(ORIGIN, SHAPE).log_odds
    updated = grid.region(own)
    foreign = grid.absorb(own, _contribution(grid, donor))
    mixed = grid.view(own).dense_over(ORIGIN, SHAPE).log_odds
    result = grid.reset(own, foreign, updated)
    left = grid.view(own).dense_over(ORIGIN, SHAPE).log_odds
    alien, mine = foreign.mask(ORIGIN, SHAPE), updated.mask(ORIGIN, SHAPE)
    assert result.cells_reset == (alien & ~mine).sum()
    assert result.cells_contaminated == (alien & mine).sum()
    assert result.touched == foreign.minus(updated)
    assert (left[alien & ~mine] == 0).all()
    assert (left[mine] == mixed[mine]).all(), "what the robot updated itself keeps the donor's share"
    assert (left[~alien] == original[~alien]).all()
    again = grid.reset(own, foreign, updated)
    assert (again.cells_reset, again.cells_contaminated) == (0, result.cells_contaminated)


def test_cells_that_were_reset_hold_no_donor_any_more(walked: Walked, scan_of: MakeScan) -> None:
    """Merge, discard, observe: what is observed afterwards is the robot's own and not contaminated."""
    grid = OccupancyGrid(resolution_m=0.1)
    own, donor = grid.new_layer(), walked(grid, 1)
    nothing = GridRegion.empty(own.lattice)
    foreign = grid.absorb(own, _contribution(grid, donor))
    first = grid.reset(own, foreign, nothing)
    assert (first.cells_reset, first.cells_contaminated) == (len(foreign), 0)
    assert len(grid.region(own)) == 0
    updated = grid.integrate(own, scan_of(np.linspace(-2, 2, 30), 3.0))
    second = grid.reset(own, foreign, updated)
    assert (second.cells_reset, second.cells_contaminated) == (0, 0)
    assert grid.region(own) == updated


def test_regions_of_other_cells_reset_nothing(walked: Walked) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    own = walked(grid, 4)
    fine = OccupancyGrid(resolution_m=0.05)
    other = fine.region(walked(fine, 4))
    with pytest.raises(MapError, match="cannot be reset"):
        grid.reset(own, other, other)


def test_two_donors_add_up_and_overflow_is_refused(scan_of: MakeScan) -> None:
    grid = OccupancyGrid(resolution_m=0.5, l_hit=10.0, rays_per_tile=0, poses_per_tile=0)
    donor = grid.new_layer()
    for _ in range(2000):
        grid.integrate(donor, scan_of(0.0, 2.0))
    own = grid.new_layer()
    contribution = _contribution(grid, donor, 3)
    for _ in range(32):
        grid.absorb(own, contribution)
    before = grid.encode(own)
    with pytest.raises(MapError, match="too many merges"):
        grid.absorb(own, contribution)
    assert grid.encode(own) == before


def test_a_layer_with_others_inside_is_not_given_away(walked: Walked) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    own, donor = walked(grid, 2), walked(grid, 3)
    grid.absorb(own, _contribution(grid, donor))
    with pytest.raises(MapError, match="absorbed other sources"):
        grid.place(own, Transform.identity())
