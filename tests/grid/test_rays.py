"""The ray kernel against a brute-force sampler and a cell-by-cell sensor model."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Observation, Scan, Transform
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.observing import Seen, cells_of
from mapgraft_grid.parameters import Lattice

MakeScan = Callable[..., Observation]

FREE_M = 5.0
MAX_M = 30.0


def _cast(
    observation: Observation, resolution: float
) -> tuple[NDArray[np.int64], set[tuple[int, int]], set[tuple[int, int]]]:
    """Keys, free cells and hit cells of one scan."""
    scan = observation.payload
    assert isinstance(scan, Scan)
    seen = cells_of(scan, observation.T_map_sensor, Lattice(resolution), (MAX_M, FREE_M))
    assert isinstance(seen, Seen)
    return seen.keys, _cells(seen.keys, seen.free), _cells(seen.keys, seen.hit)


def _cells(keys: NDArray[np.int64], rows: NDArray[np.uint64]) -> set[tuple[int, int]]:
    bits = np.unpackbits(rows.view(np.uint8), axis=1, bitorder="little").reshape(-1, 64, 64)
    tile_x, tile_y = (keys & ((1 << 26) - 1)) - (1 << 25), (keys >> 26) - (1 << 25)
    return {(int(64 * tile_x[t] + c), int(64 * tile_y[t] + r)) for t, r, c in np.argwhere(bits)}


def _sampled(observation: Observation, resolution: float) -> tuple[set[tuple[int, int]], set[tuple[int, int]]]:
    """Cells on a dense sampling of every beam, and the cells of the hits."""
    scan = observation.payload
    assert isinstance(scan, Scan)
    far = scan.ranges_m > MAX_M
    hits = scan.hits & ~far
    ranges = np.where(hits, scan.ranges_m, np.minimum(scan.ranges_m, FREE_M)).astype(np.float32)
    beams = Scan(scan.directions, ranges, hits, scan.T_sensor_beam).rays(observation.T_map_sensor)
    starts = np.broadcast_to(beams.origins_m, beams.ends_m.shape)
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    passed: set[tuple[int, int]] = set()
    for start, end in zip(starts, beams.ends_m, strict=True):
        points = (start + share * (end - start)) / resolution
        clear = (abs(points - np.round(points)) > 1e-5).all(axis=1)  # on an edge either cell is right
        passed.update(map(tuple, np.floor(points[clear]).astype(int).tolist()))
    ends = np.round(beams.ends_m[beams.hits] / resolution * 2**20) / 2**20
    ended = set(map(tuple, np.floor(ends).astype(int).tolist()))
    return passed - ended, ended


def _reach(observation: Observation, cell: tuple[int, int], resolution: float) -> float:
    """How far the cell lies from the nearest beam, in cells: 0 when a beam meets the closed square."""
    scan = observation.payload
    assert isinstance(scan, Scan)
    beams = scan.rays(observation.T_map_sensor)
    starts = np.broadcast_to(beams.origins_m, beams.ends_m.shape) / resolution
    ends = beams.ends_m / resolution
    low, high = np.zeros(len(ends)), np.ones(len(ends))
    for axis in (0, 1):
        step = ends[:, axis] - starts[:, axis]
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (cell[axis] - 1e-6 - starts[:, axis]) / step, (cell[axis] + 1 + 1e-6 - starts[:, axis]) / step
        inside = (starts[:, axis] >= cell[axis] - 1e-6) & (starts[:, axis] <= cell[axis] + 1 + 1e-6)
        a, b = np.where(step == 0, np.where(inside, 0, 1), a), np.where(step == 0, np.where(inside, 1, 0), b)
        low, high = np.maximum(low, np.minimum(a, b)), np.minimum(high, np.maximum(a, b))
    return 0.0 if (low <= high).any() else 1.0


POSES = st.tuples(st.floats(-8, 8), st.floats(-8, 8), st.floats(-math.pi, math.pi))


@settings(max_examples=60, deadline=None)
@given(
    pose=POSES,
    angles=st.lists(st.floats(-math.pi, math.pi), min_size=1, max_size=12),
    seed=st.integers(0, 2**32 - 1),
    resolution=st.sampled_from([0.05, 0.07, 0.1, 0.5]),
    moving=st.booleans(),
)
def test_a_scan_touches_exactly_the_cells_its_beams_meet(
    scan_of: MakeScan,
    pose: tuple[float, float, float],
    angles: list[float],
    seed: int,
    resolution: float,
    moving: bool,
) -> None:
    random = np.random.default_rng(seed)
    n = len(angles)
    beam_poses = random.normal(0.0, [0.2, 0.2, 0.1], (n, 3)) if moving else None
    observation = scan_of(angles, random.uniform(0.0, 6.0, n), random.random(n) < 0.7, pose, beam_poses=beam_poses)
    _, free, hit = _cast(observation, resolution)
    passed, ended = _sampled(observation, resolution)
    assert hit == ended
    assert free.isdisjoint(hit), "a hit wins over a miss"
    assert passed <= free | hit
    assert all(_reach(observation, cell, resolution) == 0.0 for cell in free)


def test_axis_parallel_and_diagonal_beams_have_the_cells_that_one_would_draw(scan_of: MakeScan) -> None:
    for angle, step in ((0.0, (1, 0)), (math.pi / 2, (0, 1)), (math.pi, (-1, 0)), (-math.pi / 2, (0, -1))):
        _, free, hit = _cast(scan_of(angle, 2.0, True, (0.05, 0.05, 0.0)), 0.1)
        assert free == {(i * step[0], i * step[1]) for i in range(20)}
        assert hit == {(20 * step[0], 20 * step[1])}
    _, free, hit = _cast(scan_of(0.4, 0.0, True, (0.05, 0.05, 0.0)), 0.1)
    assert (free, hit) == (set(), {(0, 0)})


def test_tiles_come_in_ascending_order_without_empty_ones(scan_of: MakeScan) -> None:
    keys, free, hit = _cast(scan_of(np.linspace(-3, 3, 50), 20.0, True, (-1.0, 2.0, 0.3)), 0.02)
    assert (np.diff(keys) > 0).all()
    assert len({(x // 64, y // 64) for x, y in free | hit}) == keys.size


def test_a_scan_wider_than_one_pass_has_the_same_cells_as_beam_by_beam(scan_of: MakeScan) -> None:
    """At 1 mm the beams of 29 m spread over more words than are drawn at once."""
    angles = np.array([0.1, 1.2, 2.5, -2.0])
    _, free, hit = _cast(scan_of(angles, 29.0), 0.001)
    parts = [_cast(scan_of(angle, 29.0), 0.001) for angle in angles]
    assert hit == set().union(*(part[2] for part in parts))
    assert free == set().union(*(part[1] for part in parts)) - hit
    assert len(free) > 4 * 29_000


@pytest.mark.parametrize(("length", "returned", "cells"), [(4.0, False, 41), (20.0, False, 51), (40.0, True, 51)])
def test_beams_without_return_are_free_up_to_the_free_range(
    scan_of: MakeScan, length: float, returned: bool, cells: int
) -> None:
    _, free, hit = _cast(scan_of(0.0, length, returned, (0.05, 0.05, 0.0)), 0.1)
    assert len(free) == cells
    assert not hit


def test_beams_without_word_are_left_out(scan_of: MakeScan) -> None:
    keys, free, hit = _cast(scan_of([0.0, 1.0], [math.nan, -1.0]), 0.1)
    assert not (keys.size or free or hit)
    _, free, hit = _cast(scan_of([0.0, 1.0], [math.inf, 1.0], [False, True]), 0.1)
    assert len(free) > 50
    assert len(hit) == 1


@pytest.mark.parametrize("x", [math.nan, math.inf, 2.0**30 * 0.05])
def test_positions_without_a_cell_are_refused_and_change_nothing(scan_of: MakeScan, x: float) -> None:
    grid = OccupancyGrid()
    layer = grid.new_layer()
    grid.integrate(layer, scan_of([0.0, 1.0], [1.0, 2.0]))
    before = grid.encode(layer)
    scan = scan_of(0.0, 1.0)
    matrix = np.eye(4)
    matrix[0, 3] = x
    bad = Observation("robot", 1, 1, "laser", "scan", scan.payload, Transform(matrix), Transform.identity())
    with pytest.raises(MapError, match="cells or is not finite"):
        grid.integrate(layer, bad)
    assert grid.encode(layer) == before


def test_beams_that_graze_a_tile_from_outside_stay_inside_their_box(scan_of: MakeScan) -> None:
    """All coordinates a hair below zero: taking the box's corner away must not round them into the next tile."""
    for tiny in (1e-182, 1e-17, 2.0**-40):
        _, free, hit = _cast(scan_of([math.pi, -math.pi / 2], 1.0, True, (-tiny, -tiny, 0.0)), 0.1)
        assert len(hit) == 2
        assert len(free) in (19, 20)


def test_a_body_that_is_nowhere_is_refused_and_changes_nothing(scan_of: MakeScan) -> None:
    grid = OccupancyGrid()
    layer = grid.new_layer()
    before = grid.encode(layer)
    scan = scan_of(0.0, 1.0)
    for x in (math.nan, math.inf, 1e12):
        matrix = np.eye(4)
        matrix[1, 3] = x
        with pytest.raises(MapError, match="check its pose"):
            grid.integrate(
                layer, Observation("robot", 1, 1, "laser", "scan", scan.payload, scan.T_map_sensor, Transform(matrix))
            )
    assert grid.encode(layer) == before


def test_arrays_that_do_not_belong_together_are_refused(scan_of: MakeScan) -> None:
    grid = OccupancyGrid()
    good = scan_of([0.0, 1.0], 1.0)
    scan = good.payload
    assert isinstance(scan, Scan)
    for bad in (
        Scan(scan.directions[:1], scan.ranges_m, scan.hits),
        Scan(scan.directions, scan.ranges_m, scan.hits[:1]),
        Scan(scan.directions, scan.ranges_m, scan.hits, np.zeros((1, 3))),
    ):
        observation = Observation("robot", 0, 0, "laser", "scan", bad, good.T_map_sensor, good.T_map_base)
        with pytest.raises(MapError, match="each of its 2 ranges"):
            grid.integrate(grid.new_layer(), observation)


def test_beams_that_start_kilometres_apart_are_refused(scan_of: MakeScan) -> None:
    grid = OccupancyGrid()
    with pytest.raises(MapError, match="too far from each other"):
        grid.integrate(grid.new_layer(), scan_of([0.0, 0.0], 1.0, beam_poses=[[0, 0, 0], [1e6, 0, 0]]))


def _sensor_model(
    ranges: NDArray[np.float32], hits: NDArray[np.bool_], pose: tuple[float, float, float], centres: NDArray[np.float64]
) -> NDArray[np.int8]:
    """Thrun's inverse sensor model (Probabilistic Robotics, table 9.2): 1 occupied, -1 free, 0 says nothing."""
    step, thickness = math.pi / 180, 0.1
    dx, dy = centres[..., 0] - pose[0], centres[..., 1] - pose[1]
    rho = np.hypot(dx, dy)
    phi = np.angle(np.exp(1j * (np.arctan2(dy, dx) - pose[2])))
    beam = np.round((phi + math.pi / 2) / step).astype(int)
    seen = (beam >= 0) & (beam < 180)
    beam = np.clip(beam, 0, 179)
    z, hit = ranges[beam], hits[beam]
    out = np.where(rho <= np.where(hit, z - thickness / 2, np.minimum(z, FREE_M)), -1, 0)
    out[hit & (abs(rho - z) < thickness / 2)] = 1
    return np.where(seen, out, 0).astype(np.int8)


def test_maps_agree_with_the_table_based_sensor_model(intel: list[Observation]) -> None:
    """The table asks for each cell's nearest beam, the kernel for the cells of each beam; near walls both are right."""
    resolution = 0.1
    grid = OccupancyGrid(resolution_m=resolution)
    layer = grid.new_layer()
    side = 300
    axis = (np.arange(side) - side // 2 + 0.5) * resolution
    start = intel[0].T_map_sensor
    centres = np.stack(np.meshgrid(axis + round(start.x_m), axis + round(start.y_m)), axis=-1)
    table = np.zeros((side, side))
    for observation in intel[:40]:
        grid.integrate(layer, observation)
        scan, T = observation.payload, observation.T_map_sensor
        assert isinstance(scan, Scan)
        says = _sensor_model(scan.ranges_m, scan.hits, (T.x_m, T.y_m, T.yaw_rad), centres)
        table += np.where(says > 0, 0.85, np.where(says < 0, -0.41, 0.0))
    corner = (round(round(start.x_m) / resolution) - side // 2, round(round(start.y_m) / resolution) - side // 2)
    ours = grid.view(layer).dense_over(corner, (side, side)).log_odds / 1024.0
    both = (abs(table) > 1.5) & (abs(ours) > 1.5)
    assert both.sum() > 5000
    assert (np.sign(table[both]) == np.sign(ours[both])).mean() > 0.985
