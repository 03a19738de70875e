"""Maps made from layers: against brute force, incrementally, purely."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Contribution, EmptyMapError, MapError, Observation, Provenance, Transform
from mapgraft_grid.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.region import GridRegion
from mapgraft_grid.weights import TileWeights

MakeScan = Callable[..., Observation]
Walked = Callable[..., GridLayer]

SHAPE, ORIGIN = (160, 200), (-90, -70)


def _evidence(layer: GridLayer) -> NDArray[np.int64]:
    """Unclamped log-odds of a window, cell by cell from the counts."""
    out = np.zeros(SHAPE, np.int64)
    keys = np.sort(layer.pool.index.keys)
    for key, hits, misses in zip(keys.tolist(), *layer.pool.counts(keys), strict=True):
        x, y = 64 * ((key & ((1 << 26) - 1)) - (1 << 25)), 64 * ((key >> 26) - (1 << 25))
        for row, column in np.argwhere(hits | misses):
            at = (y + row - ORIGIN[1], x + column - ORIGIN[0])
            model = layer.sensor_model
            out[at] = int(hits[row, column]) * model.l_hit + int(misses[row, column]) * model.l_miss
    return out


def _contribution(
    grid: OccupancyGrid, layer: GridLayer, weights: TileWeights | None = None, fill: GridRegion | None = None
) -> Contribution:
    return Contribution(
        Provenance("donor", 0, 1),
        layer,
        Transform.identity(),
        1.0,
        grid.resampler(layer),
        weights or TileWeights.plain(),
        fill,
        grid.region(layer),
    )


def _same(one: GridMap, two: GridMap) -> bool:
    """Whether two maps are bit for bit the same."""
    return (
        one.known() == two.known()
        and one.lattice == two.lattice
        and list(one.tiles) == list(two.tiles)
        and all((one.tiles[k].log_odds == two.tiles[k].log_odds).all() for k in one.tiles)
        and all(one.tiles[k].known == two.tiles[k].known for k in one.tiles)
    )


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_a_map_is_the_clamped_weighted_sum(walked: Walked, seed: int) -> None:
    random = np.random.default_rng(seed)
    grid = OccupancyGrid(resolution_m=0.1, clamp=3.0)
    stranger = OccupancyGrid(resolution_m=0.1, l_hit=1.2, l_miss=-0.3)
    own, donor, other = (
        walked(grid, seed),
        walked(stranger, seed + 1),
        walked(grid, seed + 2),
    )
    tiles = np.sort(donor.pool.index.keys)
    listed = random.random(tiles.size) < 0.8
    weights = TileWeights(tiles[listed], random.integers(0, 4, listed.sum()).astype(np.uint8))
    fill = GridRegion.from_mask(grid.new_layer().lattice, ORIGIN, random.random(SHAPE) < 0.5)
    contributions = (_contribution(grid, donor, weights, fill), _contribution(grid, other))
    seen = grid.view(own, contributions)

    factor = np.ones(SHAPE, np.int64)
    for key, weight in zip(tiles.tolist(), weights.of(tiles).tolist(), strict=True):
        x, y = 64 * ((key & ((1 << 26) - 1)) - (1 << 25)) - ORIGIN[0], 64 * ((key >> 26) - (1 << 25)) - ORIGIN[1]
        factor[max(0, y) : max(0, y + 64), max(0, x) : max(0, x + 64)] = weight
    factor = np.where((factor == 0) & fill.mask(ORIGIN, SHAPE), 1, factor)
    total = _evidence(own) + factor * _evidence(donor) + _evidence(other)
    clamp = round(3.0 * 1024)
    expected = np.clip(total, -clamp, clamp)

    window = seen.dense_over(ORIGIN, SHAPE)
    assert (window.log_odds == expected).all()
    probability = 1 / (1 + np.exp(-expected / 1024))
    classes = np.where(probability > 0.65, OCCUPIED, np.where(probability < 0.196, FREE, UNKNOWN))
    assert (window.classes == classes).all()
    assert seen.known() == (classes != UNKNOWN).sum()
    assert _same(seen, grid.view(own, contributions[::-1])), "permuting merges changes nothing"

    dense = seen.dense()
    rows, columns = np.flatnonzero(classes.any(axis=1)), np.flatnonzero(classes.any(axis=0))
    assert dense.origin_cell == (ORIGIN[0] + columns[0], ORIGIN[1] + rows[0])
    assert dense.classes.shape == (rows[-1] - rows[0] + 1, columns[-1] - columns[0] + 1)
    assert (dense.classes == classes[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]).all()
    assert dense.origin_m == pytest.approx((dense.origin_cell[0] * 0.1, dense.origin_cell[1] * 0.1))


STEPS = st.lists(
    st.tuples(st.sampled_from(["observe", "merge", "replace", "revert", "look"]), st.integers(0, 2)), max_size=14
)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31), steps=STEPS)
def test_any_interleaving_ends_at_the_layers_that_are_left(
    walked: Walked, scan_of: MakeScan, seed: int, steps: list[tuple[str, int]]
) -> None:
    """Observe, merge, replace and revert in any order, looking now and then: incremental equals fresh, bit for bit."""
    grid = OccupancyGrid(resolution_m=0.1)
    random = np.random.default_rng(seed)
    own, alone = grid.new_layer(), grid.new_layer()
    standing: dict[int, Contribution] = {}
    seen, touched = grid.view(own), GridRegion.empty(own.lattice)
    for number, (step, donor) in enumerate(steps):
        if step == "observe":
            scan = scan_of(
                np.linspace(-2, 2, 20), random.uniform(0.5, 5.0, 20), True, (*random.uniform(-2, 2, 2), 0.3 * number)
            )
            touched = touched.union(grid.integrate(own, scan))
            grid.integrate(alone, scan)
        if step in ("replace", "revert") and donor in standing:
            touched = touched.union(_changed(standing.pop(donor)))
        if step == "merge" or step == "replace":
            if donor in standing:
                touched = touched.union(_changed(standing.pop(donor)))
            layer = walked(grid, seed + 17 * number + donor, 3)
            tiles = np.sort(layer.pool.index.keys)
            weights = TileWeights(tiles, random.integers(0, 4, tiles.size).astype(np.uint8))
            fill = GridRegion.from_mask(own.lattice, ORIGIN, random.random(SHAPE) < 0.5)
            standing[donor] = _contribution(grid, layer, weights, fill)
            touched = touched.union(_changed(standing[donor]))
        if step == "look":
            seen, touched = grid.view(own, tuple(standing.values()), seen, touched), GridRegion.empty(own.lattice)
    seen = grid.view(own, tuple(standing.values()), seen, touched)
    assert _same(seen, grid.view(own, tuple(standing.values())))
    assert _same(seen, OccupancyGrid(resolution_m=0.1).view(own, tuple(standing.values()))), "nothing was remembered"
    for contribution in standing.values():
        touched = touched.union(_changed(contribution))
    assert _same(grid.view(own, (), seen, touched), grid.view(alone))
    assert grid.encode(own) == grid.encode(alone)


def _changed(contribution: Contribution) -> GridRegion:
    assert isinstance(contribution.region, GridRegion)
    return contribution.region


def test_looking_changes_nothing_and_old_maps_stay(walked: Walked, scan_of: MakeScan) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    own = walked(grid, 3)
    donor = walked(grid, 4)
    before = (grid.encode(own), grid.encode(donor))
    first = grid.view(own, (_contribution(grid, donor),))
    frozen = {key: tile.log_odds.copy() for key, tile in first.tiles.items()}
    touched = grid.integrate(own, scan_of(0.0, 3.0))
    second = grid.view(own, (), first, touched)
    assert all((first.tiles[key].log_odds == values).all() for key, values in frozen.items())
    untouched = set(first.tiles) - set(touched.keys.tolist())
    assert untouched
    assert all(second.tiles[key] is first.tiles[key] for key in untouched), "tiles that did not change are shared"
    assert grid.encode(donor) == before[1]
    for array in (first.dense().classes, first.dense().log_odds, next(iter(first.tiles.values())).log_odds):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1


def test_an_empty_map_says_so() -> None:
    grid = OccupancyGrid()
    seen = grid.view(None)
    assert seen.is_empty
    assert seen.known() == 0
    assert (seen.dense_over((0, 0), (3, 4)).classes == UNKNOWN).all()
    for call in (seen.dense, seen.bounds_cells, lambda: grid.files(seen, "map")):
        with pytest.raises(EmptyMapError):
            call()
    assert list(grid.messages(seen)) == []
    told = grid.metadata(grid.new_layer())
    assert (told.bounds_m, told.known_area_m2, told.can_send) == (None, 0.0, ("counts",))


def test_one_layer_alone_is_seen_in_its_own_resolution(walked: Walked) -> None:
    fine = OccupancyGrid(resolution_m=0.05)
    layer = walked(fine, 5)
    coarse = OccupancyGrid(resolution_m=0.2)
    assert coarse.view(layer).resolution_m == 0.05
    assert _same(coarse.view(layer), fine.view(layer))


def test_contributions_must_lie_on_the_own_lattice(walked: Walked) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    donor = walked(OccupancyGrid(resolution_m=0.05), 6)
    with pytest.raises(MapError, match="place the donor's layer first"):
        grid.view(grid.new_layer(), (_contribution(grid, donor),))
    placed = grid.place(donor, Transform.identity())
    assert _same(grid.view(None, (_contribution(grid, placed),)), grid.view(placed))
    with pytest.raises(MapError, match="TileWeights"):
        grid.view(
            None,
            (Contribution(Provenance("d", 0, 1), placed, Transform.identity(), 1.0, "", 3, None, grid.region(placed)),),
        )
    with pytest.raises(MapError, match="60 contributions"):
        grid.view(None, (_contribution(grid, placed),) * 61)


def test_weights_must_be_what_they_say() -> None:
    one, keys = np.ones(2, np.uint8), np.array([3, 5], np.int64)
    assert TileWeights(keys, one * 2).of(np.array([1, 3, 4, 5, 9], np.int64)).tolist() == [1, 2, 1, 2, 1]
    assert TileWeights.plain().of(keys).tolist() == [1, 1]
    for bad_keys, bad_counts in ((keys[::-1].copy(), one), (keys, one * 4), (keys[:1], one)):
        with pytest.raises(MapError, match="tile weights need"):
            TileWeights(bad_keys, bad_counts)


def test_windows_may_lie_anywhere(walked: Walked) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    seen = grid.view(walked(grid, 7))
    whole = seen.dense_over(ORIGIN, SHAPE)
    part = seen.dense_over((ORIGIN[0] + 17, ORIGIN[1] + 33), (50, 71))
    assert (part.log_odds == whole.log_odds[33:83, 17:88]).all()
    assert (seen.dense_over((10_000, 0), (10, 10)).log_odds == 0).all()
    assert seen.dense_over((0, 0), (0, 5)).classes.shape == (0, 5)
    with pytest.raises(MapError, match="cells was asked for"):
        seen.dense_over((0, 0), (30_000, 30_000))


def test_the_intel_building_is_mapped(intel: list[Observation]) -> None:
    """Incrementally, scan by scan; sizes as read off the published map: about 29 m by 29 m, some 500 m² free."""
    grid = OccupancyGrid()
    layer = grid.new_layer()
    seen = grid.view(layer)
    for observation in intel:
        seen = grid.view(layer, (), seen, grid.integrate(layer, observation))
    assert _same(seen, grid.view(layer))
    classes = seen.dense().classes
    assert 450 < (classes == FREE).sum() * 0.05**2 < 550
    assert 20 < (classes == OCCUPIED).sum() * 0.05**2 < 50
