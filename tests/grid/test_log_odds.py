"""Fusing: what the weights do to the fused map, cell by cell, and what the contribution says of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import (
    ConfigError,
    Contribution,
    Donation,
    EmptyMapError,
    MapError,
    Match,
    Observation,
    Provenance,
    Transform,
)
from mapgraft_grid.degradation import Degradation, degrade
from mapgraft_grid.grid_map import OCCUPIED, UNKNOWN, DenseGrid, GridMap
from mapgraft_grid.kernels.tile_keys import TILE, tile_key
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.log_odds import BESIDE_WALL_M, CHANCE, LogOdds, joint_quality, shrunk, tile_differences
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.quality import WindowLayout, WindowQuality
from mapgraft_grid.region import GridRegion
from mapgraft_grid.weights import TileWeights

PROVENANCE = Provenance("donor", 1, 7)


@dataclass(frozen=True, slots=True)
class Strange:
    map_type: str = "cairns"


def layer_of(grids: OccupancyGrid, observations: Sequence[Observation]) -> GridLayer:
    layer = grids.new_layer()
    for observation in observations:
        grids.integrate(layer, observation)
    return layer


def match_at(x_m: float = 0.0, y_m: float = 0.0, yaw_rad: float = 0.0) -> Match:
    return Match(Transform.planar(x_m, y_m, yaw_rad), 1.0, math.inf)


@pytest.fixture(scope="module")
def worse_donor(intel: list[Observation]) -> tuple[OccupancyGrid, GridLayer, GridLayer, Contribution]:
    """A receiver, a donor with noisy poses that sees more, and what the fuser makes of it."""
    grids = OccupancyGrid(resolution_m=0.07)
    own = layer_of(grids, intel[100:250])
    noisy = Degradation(pose_sigma_m=0.12, pose_sigma_rad=0.02)
    donor = layer_of(OccupancyGrid(resolution_m=0.1), list(degrade(intel[:220:2], noisy, 1)))
    fused = LogOdds().fuse(grids, grids.view(own), Donation(donor, PROVENANCE), match_at())
    return grids, own, donor, fused


def same_window(a: GridMap, b: GridMap) -> tuple[DenseGrid, DenseGrid, tuple[int, int]]:
    boxes = np.array([a.bounds_cells(), b.bounds_cells()])
    x0, y0 = (int(v) for v in boxes[:, :2].min(axis=0))
    x1, y1 = (int(v) for v in boxes[:, 2:].max(axis=0))
    shape = (y1 - y0, x1 - x0)
    return a.dense_over((x0, y0), shape), b.dense_over((x0, y0), shape), (x0, y0)


Fused = tuple[OccupancyGrid, GridLayer, GridLayer, Contribution]


def test_a_worse_donor_is_not_applied_where_the_receiver_knows(worse_donor: Fused) -> None:
    grids, own, _, contribution = worse_donor
    assert isinstance(contribution.weights, TileWeights) and isinstance(contribution.fill, GridRegion)
    refused = contribution.weights.keys[contribution.weights.counts == 0]
    assert refused.size > 3
    before, after, corner = same_window(grids.view(own), grids.view(own, [contribution]))
    shape = before.classes.shape
    in_refused = tiles_mask(refused, corner, shape)
    fill = contribution.fill.mask(corner, shape)
    assert fill.any() and (fill <= in_refused).all()
    assert (before.classes[fill] == UNKNOWN).all()
    known = in_refused & (before.classes != UNKNOWN)
    assert np.array_equal(after.log_odds[known], before.log_odds[known])
    reach = round(BESIDE_WALL_M / 0.07)
    for row, column in np.argwhere(fill)[::97]:
        around = before.classes[max(0, row - reach) : row + reach + 1, max(0, column - reach) : column + reach + 1]
        assert (around != OCCUPIED).all()


def tiles_mask(keys: np.ndarray, corner: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
    rows, columns = np.indices(shape)
    key = np.vectorize(tile_key, otypes=[np.int64])((columns + corner[0]) // TILE, (rows + corner[1]) // TILE)
    return np.isin(key, keys)


def test_the_region_is_where_the_fused_map_changes(worse_donor: Fused) -> None:
    grids, own, _, contribution = worse_donor
    before, after, corner = same_window(grids.view(own), grids.view(own, [contribution]))
    assert isinstance(contribution.region, GridRegion)
    region = contribution.region.mask(corner, before.classes.shape)
    assert not (before.log_odds != after.log_odds)[~region].any()
    assert len(contribution.region.minus(grids.region(contribution.layer))) == 0  # nothing but the donor's cells
    changed = (before.log_odds != after.log_odds)[region].mean()
    assert changed > 0.4  # the others hold evidence that is clamped when read


def test_the_contribution_says_what_was_done(worse_donor: Fused) -> None:
    grids, _, donor, contribution = worse_donor
    assert contribution.provenance == PROVENANCE and contribution.scale == 1.0
    assert contribution.resampler == grids.resampler(donor)
    assert contribution.T_receiver_donor == contribution.T_receiver_donor.snapped()
    assert grids.encode(contribution.layer) == grids.encode(grids.place(donor, Transform.identity()))  # unweighted


def test_the_summary_tells_how_it_was_fused(worse_donor: Fused) -> None:
    grids, _, _, made = worse_donor
    told = dict(made.summary)
    assert all(math.isfinite(value) for value in told.values())
    keys = grids.region(made.layer).keys
    for count in range(4):
        assert told[f"tiles_applied_{count}"] == np.count_nonzero(made.weights.of(keys) == count)
    assert told["tiles_applied_0"] > 3
    assert made.fill is not None and told["cells_filled"] == len(made.fill) > 0
    assert told["cells_changed"] == len(made.region) > told["cells_filled"]
    assert 0.0 < told["quality_donor"] < told["quality_receiver"] < 1.0  # its poses are noisy
    assert told["windows_judged"] > 10


def test_the_summary_leaves_out_what_is_not_known(intel: list[Observation]) -> None:
    grids = OccupancyGrid(resolution_m=0.1)
    donation = Donation(layer_of(grids, intel[:10]), PROVENANCE)
    empty, own = grids.view(None), grids.view(layer_of(grids, intel[:30]))
    for fuser, target in ((LogOdds(), empty), (LogOdds(quality="none"), own)):
        made = fuser.fuse(grids, target, donation, match_at())
        tiles = {f"tiles_applied_{count}": 0.0 for count in range(4)} | {
            "tiles_applied_1": float(made.region.keys.size)
        }
        assert made.summary == {**tiles, "cells_changed": float(len(made.region)), "cells_filled": 0.0}


def test_joint_quality_is_that_where_both_can_be_judged() -> None:
    layout = WindowLayout(10, (0, 0), (0, 0))
    ours = WindowQuality(np.array([[0.5, 0.7, np.nan]]), np.array([[2.0, 6.0, 0.0]]), layout)
    theirs = WindowQuality(np.array([[0.9, 0.1, 0.3]]), np.array([[3.0, 3.0, 9.0]]), WindowLayout(10, (-1, 0), (0, 0)))
    # they meet in two windows: 0.5 with 0.1 on 2 m of wall, 0.7 with 0.3 on 6 m
    told = joint_quality(ours, theirs)
    assert told == pytest.approx({"quality_receiver": 0.65, "quality_donor": 0.25, "windows_judged": 2.0})
    assert joint_quality(ours, WindowQuality(theirs.quality, theirs.wall_m, WindowLayout(10, (9, 9), (0, 0)))) == {}


def test_fusing_is_repeatable_and_writes_nothing(intel: list[Observation]) -> None:
    grids = OccupancyGrid(resolution_m=0.1)
    own, donor = layer_of(grids, intel[:80]), layer_of(grids, list(degrade(intel[40:120], Degradation(0.2), 3)))
    kept = grids.encode(own), grids.encode(donor)
    match = match_at(0.31, -0.2, 0.02)
    made = [LogOdds().fuse(grids, grids.view(own), Donation(donor, PROVENANCE), match) for _ in range(2)]
    assert (grids.encode(own), grids.encode(donor)) == kept
    assert grids.encode(made[0].layer) == grids.encode(made[1].layer)
    assert np.array_equal(made[0].weights.keys, made[1].weights.keys)
    assert np.array_equal(made[0].weights.counts, made[1].weights.counts)
    assert made[0].summary == made[1].summary
    assert (made[0].fill, made[0].region) == (made[1].fill, made[1].region)


def test_without_quality_everything_counts_once(intel: list[Observation]) -> None:
    grids = OccupancyGrid(resolution_m=0.1)
    own, donor = layer_of(grids, intel[:30]), layer_of(grids, intel[30:60])
    made = LogOdds(quality="none").fuse(grids, grids.view(own), Donation(donor, PROVENANCE), match_at())
    assert made.weights.keys.size == 0 and made.fill is None
    assert made.region == grids.region(made.layer)
    both = grids.view(layer_of(grids, intel[:60]))
    fused, together, _ = same_window(grids.view(own, [made]), both)
    assert np.array_equal(fused.classes, together.classes)
    assert np.array_equal(fused.log_odds, together.log_odds)


def test_a_better_donor_counts_more_than_once(intel: list[Observation]) -> None:
    grids = OccupancyGrid(resolution_m=0.07)
    noisy = Degradation(pose_sigma_m=0.15, pose_sigma_rad=0.03)
    own, donor = layer_of(grids, list(degrade(intel[:120], noisy, 2))), layer_of(grids, intel[:120])
    made = LogOdds().fuse(grids, grids.view(own), Donation(donor, PROVENANCE), match_at())
    assert {2, 3} & set(made.weights.counts.tolist()) and 0 not in made.weights.counts
    assert made.fill is None


def test_equally_good_maps_are_plain_bayes(intel: list[Observation]) -> None:
    grids = OccupancyGrid(resolution_m=0.07)
    own, donor = layer_of(grids, intel[:120:2]), layer_of(grids, intel[1:120:2])
    made = LogOdds().fuse(grids, grids.view(own), Donation(donor, PROVENANCE), match_at())
    assert made.weights.keys.size <= 0.25 * made.layer.pool.index.keys.size


def test_a_receiver_that_knows_nothing_takes_everything(intel: list[Observation]) -> None:
    grids = OccupancyGrid(resolution_m=0.1)
    donor = layer_of(grids, intel[:10])
    made = LogOdds().fuse(grids, grids.view(None), Donation(donor, PROVENANCE), match_at())
    assert made.weights.keys.size == 0 and made.fill is None and made.region == grids.region(made.layer)


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_applications_rise_with_the_difference(a: float, b: float) -> None:
    fuser = LogOdds()
    low, high = sorted((a, b))
    assert 0 <= fuser.applications(low) <= fuser.applications(high) <= 3


def test_the_table_names_where_applications_begin() -> None:
    fuser = LogOdds(table=(-0.5, 0.25, 0.5))
    asked = (-1.0, -0.5, -0.49, 0.0, 0.24, 0.25, 0.49, 0.5, 1.0)
    assert [fuser.applications(d) for d in asked] == [0, 0, 1, 1, 1, 2, 2, 3, 3]
    assert LogOdds().applications(0.0) == 1


def test_tiles_take_the_windows_in_them() -> None:
    """At 0.1 m a block is 10 cells; tile (0, 0) holds the window centres from 0 to 64 cells, both included."""
    layout = WindowLayout(10, (-1, -1), (0, 0))
    ours = WindowQuality(np.full((20, 20), 0.5), np.full((20, 20), 2.0), layout)
    better = np.full((20, 20), 0.5)
    better[:, :8] = 0.9  # centres at x = 0 to 70
    better[0, 0] = np.nan
    theirs = WindowQuality(better, np.full((20, 20), 4.0), layout)
    keys = np.array(sorted([tile_key(0, 0), tile_key(1, 0), tile_key(2, 0), tile_key(9, 9)]), np.int64)
    differences, wall_m = tile_differences(ours, theirs, keys)
    found = dict(zip(keys.tolist(), differences.tolist(), strict=True))
    assert found[tile_key(0, 0)] == pytest.approx(0.4)
    assert 0 < found[tile_key(1, 0)] < 0.4  # of its centres at 70 to 120 one is better
    assert found[tile_key(2, 0)] == pytest.approx(0.0) and found[tile_key(9, 9)] == 0.0
    shifted = WindowQuality(better[:, 3:], np.full((20, 17), 4.0), WindowLayout(10, (2, -1), (0, 0)))
    assert ((wall_m > 0) == [True, True, True, False]).all()
    again = dict(zip(keys.tolist(), tile_differences(ours, shifted, keys)[0].tolist(), strict=True))
    assert again[tile_key(1, 0)] == pytest.approx(found[tile_key(1, 0)])


@given(st.integers(0, 2**32 - 1), st.floats(-0.5, 0.5), st.sampled_from((0.0, 0.3)))
def test_what_chance_explains_is_drawn_to_the_mean(seed: int, mean: float, true_sd: float) -> None:
    rng = np.random.default_rng(seed)
    wall_m = rng.uniform(1, 60, 400)
    truth = mean + rng.normal(0, true_sd, 400)
    seen = truth + rng.normal(0, CHANCE / np.sqrt(wall_m))
    found = shrunk(seen, wall_m)
    if true_sd == 0.0:
        assert abs(found - truth).mean() < 0.5 * abs(seen - truth).mean()
    else:
        assert abs(found - truth).mean() < 1.1 * abs(seen - truth).mean()
        assert abs(found - seen)[wall_m > 20].max() < 0.1  # real differences stay
    assert found.min() >= seen.min() and found.max() <= seen.max()


def test_shrinking_leaves_tiles_without_wall_and_single_ones_alone() -> None:
    assert shrunk(np.zeros(3), np.zeros(3)).tolist() == [0.0] * 3
    assert shrunk(np.array([0.0, -0.3]), np.array([0.0, 5.0])).tolist() == [0.0, pytest.approx(-0.3)]
    assert shrunk(np.array([0.5, 0.1]), np.array([4.0, 4.0])) == pytest.approx([0.3 + 0.175, 0.3 - 0.175])  # 7/8


@pytest.mark.parametrize("table", [(0.0, 0.5), (0.2, 0.1, 0.5), (-1.0, 0.2, 0.5), (-0.5, 0.2, 1.0), (-0.1, -0.1, 0.3)])
def test_impossible_tables_are_refused(table: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match="three ascending"):
        LogOdds(table=table)


def test_what_cannot_be_fused_is_refused(intel: list[Observation], grid_map_of: Callable[..., GridMap]) -> None:
    grids = OccupancyGrid(resolution_m=0.1)
    with pytest.raises(ConfigError, match="windowed, none"):
        LogOdds(quality="best")
    with pytest.raises(EmptyMapError):
        LogOdds().fuse(grids, grids.view(None), Donation(grids.new_layer(), PROVENANCE), match_at())
    with pytest.raises(MapError, match="'cairns'"):
        LogOdds().fuse(grids, grids.view(None), Donation(Strange(), PROVENANCE), match_at())
