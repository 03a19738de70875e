"""Baking contributions in and discarding them again, as single_map and multi_map do, against brute force."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Contribution, MapError, Observation, Provenance, Transform
from mapgraft.reversal import SingleMap
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
    """Two donors overlap; one is discarded, then the robot looks there: that is its own and not contaminated."""
    grid = OccupancyGrid(resolution_m=0.1)
    one, other = _contribution(grid, walked(grid, 1)), _contribution(grid, walked(grid, 1))
    reversal, never = SingleMap(grid), SingleMap(grid)
    reversal.merge("one", one)
    reversal.merge("other", other)
    first = reversal.revert("one")
    assert (first.cells_reset, first.cells_contaminated, first.cells_lost) == ((len(one.region), 0, len(other.region)))
    assert len(grid.region(reversal.compared_layer())) == 0
    for each in (reversal, never):
        each.observe(scan_of(np.linspace(-2, 2, 30), 3.0))
    second = reversal.revert("other")
    assert (second.exact, second.cells_reset, second.cells_contaminated, second.cells_lost) == (True, 0, 0, 0)
    assert grid.encode(reversal.compared_layer()) == grid.encode(never.compared_layer())


def _met(grid: OccupancyGrid, scan_of: MakeScan, hits: list[bool], looks: bool) -> SingleMap:
    """A robot elsewhere, into whose map donors are baked that saw one same cell, hit or free; it may look there too."""
    reversal = SingleMap(grid)
    reversal.observe(scan_of(np.linspace(-3, 3, 50), 0.5, pose=(5.05, 0.05, 0.0)))
    glance = {hit: scan_of(0.0, 0.05, hit, pose=(0.02, 0.05, 0.0)) for hit in (True, False)}
    for number, hit in enumerate(hits):
        donor = grid.new_layer()
        grid.integrate(donor, glance[hit])
        assert len(grid.region(donor)) == 1
        reversal.merge(str(number), _contribution(grid, donor))
    if looks:
        reversal.observe(glance[True])
    return reversal


@pytest.mark.parametrize("looks", [True, False])
def test_donors_that_cancel_in_a_cell_are_not_taken_for_absent(scan_of: MakeScan, looks: bool) -> None:
    grid = OccupancyGrid(resolution_m=0.1, l_hit=0.4, l_miss=-0.4)
    reversal, never = _met(grid, scan_of, [True, False], looks), _met(grid, scan_of, [False], looks)
    said = reversal.revert("0")
    assert (said.exact, said.cells_reset) == (False, 0)
    assert (said.cells_contaminated, said.cells_lost) == ((1, 0) if looks else (0, 1))
    assert grid.encode(reversal.compared_layer()) != grid.encode(never.compared_layer())


def test_a_cell_lost_by_two_donors_is_one_cell(scan_of: MakeScan) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    said = _met(grid, scan_of, [True, True, True], looks=False).revert("1")
    assert (said.exact, said.cells_reset, said.cells_contaminated, said.cells_lost) == (False, 1, 0, 1)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**31), donors=st.integers(2, 3), reverted=st.integers(0, 2))
def test_donors_that_overlap_and_cancel_are_counted_cell_by_cell(
    walked: Walked, scan_of: MakeScan, seed: int, donors: int, reverted: int
) -> None:
    """Hits and misses weigh the same, so that cells cancel; nothing is clamped, so that everything is seen."""
    grid = OccupancyGrid(resolution_m=0.1, l_hit=0.4, l_miss=-0.4, clamp=31.0)
    given_ = {str(n): _contribution(grid, walked(grid, seed + n, scans=2)) for n in range(donors)}
    merge_id = str(reverted % donors)
    reversal, never = SingleMap(grid), SingleMap(grid)
    updated = GridRegion.empty(grid.new_layer().lattice)
    for number, x in enumerate((-1.0, 1.0)):
        scan = scan_of(np.linspace(-2, 2, 40), 2.0, pose=(x, 0.3, x))
        updated = updated.union(reversal.observe(scan))
        never.observe(scan)
        for name, contribution in given_.items() if number == 0 else ():
            reversal.merge(name, contribution)
            if name != merge_id:
                never.merge(name, contribution)
    before = reversal.fused().dense_over(ORIGIN, SHAPE).log_odds
    said = reversal.revert(merge_id)
    shares = {name: grid.view(None, (c,)).dense_over(ORIGIN, SHAPE).log_odds != 0 for name, c in given_.items()}
    theirs, mine = shares.pop(merge_id), updated.mask(ORIGIN, SHAPE)
    others = np.logical_or.reduce(list(shares.values()))
    differs = reversal.fused().dense_over(ORIGIN, SHAPE).log_odds != never.fused().dense_over(ORIGIN, SHAPE).log_odds
    assert said.cells_reset == (theirs & ~mine & (before != 0)).sum()
    assert said.cells_contaminated == (theirs & mine).sum() == (differs & mine).sum() > 0
    assert said.cells_lost == (theirs & ~mine & others).sum() >= (differs & ~mine).sum() > 0
    assert not said.exact


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
