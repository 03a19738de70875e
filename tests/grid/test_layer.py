"""How scans are counted: against brute force, without overflow, at any distance."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import MapError, Observation, Transform
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.region import GridRegion

MakeScan = Callable[..., Observation]
CountsOf = Callable[[GridLayer], dict[tuple[int, int], tuple[int, int]]]


def _scans(scan_of: MakeScan, seed: int, count: int) -> list[Observation]:
    random = np.random.default_rng(seed)
    angles = np.linspace(-1.5, 1.5, 15)
    return [
        scan_of(
            angles,
            random.uniform(0.2, 8.0, 15),
            random.random(15) < 0.8,
            (*random.uniform(-3, 3, 2), random.uniform(-math.pi, math.pi)),
            stamp_ns=i,
        )
        for i in range(count)
    ]


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 6), order=st.randoms(use_true_random=False))
def test_counts_are_the_sums_of_single_scans_in_any_order(
    scan_of: MakeScan, counts_of: CountsOf, seed: int, count: int, order: Random
) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    scans = _scans(scan_of, seed, count)
    expected: dict[tuple[int, int], tuple[int, int]] = {}
    union = GridRegion.empty(grid.new_layer().lattice)
    for scan in scans:
        single = grid.new_layer()
        union = union.union(grid.integrate(single, scan))
        for cell, (hits, misses) in counts_of(single).items():
            assert hits + misses == 1, "one update per cell and scan"
            before = expected.get(cell, (0, 0))
            expected[cell] = (before[0] + hits, before[1] + misses)
    order.shuffle(scans)
    layer = grid.new_layer()
    for scan in scans:
        grid.integrate(layer, scan)
    assert counts_of(layer) == expected
    assert grid.region(layer) == union
    assert layer.observations == count


def test_counts_go_beyond_sixteen_bits_without_loss(scan_of: MakeScan, counts_of: CountsOf) -> None:
    grid = OccupancyGrid(resolution_m=0.5, rays_per_tile=0, poses_per_tile=0)
    layer = grid.new_layer()
    scan, other = scan_of(0.0, 2.0), scan_of(math.pi / 2, 2.0)
    looks = 65_535 + 10
    for _ in range(looks):
        grid.integrate(layer, scan)
    grid.integrate(layer, other)
    counts = counts_of(layer)
    assert counts[4, 0] == (looks, 0)
    assert counts[1, 0] == (0, looks)
    assert counts[0, 0] == (0, looks + 1)
    assert counts[0, 4] == (1, 0)
    assert len(layer.pool.wide) == 1
    assert layer.most_looks() == looks + 1
    seen = grid.view(layer).dense()
    assert seen.log_odds.max() == grid.thresholds.clamp
    data = grid.encode(layer)
    again = grid.decode(data)
    assert counts_of(again) == counts
    assert grid.encode(again) == data
    assert counts_of(grid.place(layer, Transform.identity())) == counts
    foreign = grid.region(layer)
    assert grid.reset(layer, foreign, GridRegion.empty(foreign.lattice)).cells_reset == len(counts)
    assert not counts_of(layer)


def test_a_tile_that_was_only_looked_at_often_stays_narrow(scan_of: MakeScan, counts_of: CountsOf) -> None:
    grid = OccupancyGrid(resolution_m=0.5, rays_per_tile=0, poses_per_tile=0)
    layer = grid.new_layer()
    scans = [scan_of(angle, 3.0, True, (0.75, 0.75, 0.0)) for angle in (0.0, 1.0, 2.0, 3.0)]
    for number in range(66_000):
        grid.integrate(layer, scans[number % 4])
    grid_origin = (1, 1)
    assert counts_of(layer)[grid_origin] == (0, 66_000)
    assert sum(hits for hits, _ in counts_of(layer).values()) == 66_000


def test_a_far_point_costs_a_tile_and_not_a_world(scan_of: MakeScan, counts_of: CountsOf) -> None:
    grid = OccupancyGrid(resolution_m=0.05)
    layer = grid.new_layer()
    grid.integrate(layer, scan_of(0.0, 1.0))
    before, far = grid.encode(layer), 1.0e7
    with pytest.raises(MapError, match="almost all of them empty: check its pose"):
        grid.integrate(layer, scan_of(0.0, 1.0, True, (far, -far, 0.0), stamp_ns=1))
    assert grid.encode(layer) == before
    assert len(layer.pool.index) <= 4
    assert layer.pool.hits.nbytes < 1_000_000
    near = 150.0  # far away, but what lies between fits an array
    grid.integrate(layer, scan_of(0.0, 1.0, True, (near, -near, 0.0), stamp_ns=2))
    assert len(layer.pool.index) <= 8
    assert len(counts_of(layer)) in (41, 42)
    assert (abs(layer.rays().ends_m - [[near + 1.0, -near], [1.0, 0.0]]) < 0.001).all()


def test_the_lattice_is_in_the_layers_own_frame(scan_of: MakeScan, counts_of: CountsOf) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    layer = grid.new_layer()
    grid.integrate(layer, scan_of(0.0, 0.35, True, (-0.02, -0.02, 0.0)))
    assert counts_of(layer) == {(-1, -1): (0, 1), (0, -1): (0, 1), (1, -1): (0, 1), (2, -1): (0, 1), (3, -1): (1, 0)}


def test_sensors_tilted_and_upside_down_are_seen_in_the_plane(scan_of: MakeScan, counts_of: CountsOf) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    flipped = Transform.from_quaternion((0.05, 0.05, 0.7), (1.0, 0.0, 0.0, 0.0))
    scan = scan_of(math.pi / 2, 1.0)
    layer = grid.new_layer()
    grid.integrate(layer, Observation("robot", 0, 0, "laser", "scan", scan.payload, flipped, Transform.identity()))
    assert counts_of(layer)[0, -10] == (1, 0)


def test_a_layer_says_what_made_it(scan_of: MakeScan) -> None:
    grid = OccupancyGrid()
    layer = grid.new_layer()
    assert grid.metadata(layer).mapper == ""
    grid.integrate(layer, scan_of(0.0, 1.0, sensor="rear"))
    grid.integrate(layer, scan_of(0.0, 1.0, sensor="front"))
    told = grid.metadata(layer)
    assert (told.type, told.mapper, told.sensor, told.observations) == ("occupancy_grid", "scans", "front, rear", 2)
    assert told.can_send == ("counts", "rays", "path")
    assert told.known_area_m2 == pytest.approx(0.05**2), "one hit is enough to be known, two misses are not"
    assert told.bounds_m == pytest.approx((1.0, 0.0, 1.05, 0.05))


def test_other_payloads_and_layers_are_refused(scan_of: MakeScan) -> None:
    class Landmarks:
        map_type = "landmarks"

    grid = OccupancyGrid()
    odd = Observation("robot", 0, 0, "camera", "image", object(), Transform.identity(), Transform.identity())
    with pytest.raises(MapError, match="found a image of robot"):
        grid.integrate(grid.new_layer(), odd)
    refused: Sequence[Callable[[], object]] = (
        lambda: grid.integrate(Landmarks(), scan_of(0.0, 1.0)),
        lambda: grid.view(Landmarks()),
        lambda: grid.place(Landmarks(), Transform.identity()),
        lambda: grid.encode(Landmarks()),
    )
    for call in refused:
        with pytest.raises(MapError, match="layer of type landmarks"):
            call()
