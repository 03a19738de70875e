"""The search by correlation: spectra count as hands do, and what is exhaustive misses nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Prior, Transform
from mapgraft_grid.correlation_search import Level, Sample, scored, shifts_within, spectra, unwrapped
from mapgraft_grid.gate import Gate
from mapgraft_grid.grid_map import OCCUPIED
from mapgraft_grid.kernels.correlating import climb, fields, keep, peaks

seeds = st.integers(0, 2**32 - 1)


def _marks(random: np.random.Generator) -> NDArray[np.uint8]:
    return random.integers(0, 5, random.integers(1, 14, 2)).astype(np.uint8)


@settings(deadline=None, max_examples=60)
@given(seeds)
def test_scores_from_spectra_are_those_of_direct_counting(seed: int) -> None:
    """For every shift, of the points as they are and turned by 180°; far shifts wrap around and add up."""
    random = np.random.default_rng(seed)
    on = np.ascontiguousarray(random.normal(size=(2, *random.integers(3, 12, 2)))).astype(np.float32)
    walls, free = (random.uniform(-4.0, 4.0, (n, 2)) for n in (7, 11))
    yaw, weights, side = random.uniform(-3.0, 3.0), (1.0, 2.5), 24
    still = spectra(Level(0.1, 1.0, np.zeros(2), on[0], on[1]), (side, side + 1))
    scores = scored(still, Sample(walls, free, weights), yaw, 1.0)
    rows, columns = (mesh.ravel() for mesh in np.meshgrid(np.arange(-6, 17), np.arange(-6, 17), indexing="ij"))
    for half in range(2):
        poses = np.column_stack((columns + 0.5, rows + 0.5, np.full(rows.size, yaw + half * math.pi)))
        counted = climb(on[0], on[1], walls, free, weights, poses, 0.0, 0)[:, 3]
        assert scores[rows % side, columns % (side + 1), half] == pytest.approx(counted, abs=1e-3)


@settings(deadline=None, max_examples=60)
@given(seeds, st.integers(1, 4))
def test_coarse_fields_say_what_their_cells_say(seed: int, factor: int) -> None:
    random = np.random.default_rng(seed)
    marks = _marks(random)
    wall, free = random.normal(size=(2, 5))
    wall[0] = free[0] = 0.0
    on_wall, on_free = fields(marks, factor, wall, free, 0.4)
    rows, columns = (-(-side // factor) for side in marks.shape)
    padded = np.zeros((rows * factor, columns * factor), np.uint8)
    padded[: marks.shape[0], : marks.shape[1]] = marks
    cells = padded.reshape(rows, factor, columns, factor).transpose(0, 2, 1, 3).reshape(rows, columns, -1)
    assert on_free == pytest.approx(free[cells].mean(axis=2), abs=1e-5)
    some = (cells == OCCUPIED).any(axis=2)
    around = np.pad(some, 1)
    near = sum(around[y : y + rows, x : x + columns].astype(int) for y in range(3) for x in range(3)) > 0
    want = wall[cells].mean(axis=2)
    if factor > 1:
        want = np.where(some, wall[OCCUPIED], np.where(near, 0.4 * wall[OCCUPIED], want))
    assert on_wall == pytest.approx(want, abs=1e-5)


@settings(deadline=None, max_examples=60)
@given(seeds, st.integers(1, 6))
def test_peaks_are_the_highest_of_nine(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    scores = random.permutation(np.arange(99.0, dtype=np.float32)).reshape(9, 11)
    around = [np.roll(scores, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)]
    tops = np.sort(scores[(scores > 30.0) & (scores > np.max(around, axis=0))])[::-1][:count]
    for plane in range(2):
        both = random.normal(50.0, 50.0, (9, 11, 2)).astype(np.float32)
        both[..., plane] = scores
        places, values = peaks(both, plane, count, 30.0)
        assert np.array_equal(values, tops)
        assert np.array_equal(scores[places[:, 0], places[:, 1]], values)


@settings(deadline=None, max_examples=60)
@given(seeds, st.integers(1, 12))
def test_the_best_are_kept_in_order_and_the_earlier_of_equals_first(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    best, n, given_ = np.empty((count, 4)), 0, []
    for yaw in range(4):
        values = np.sort(random.integers(0, 9, random.integers(0, 6)).astype(np.float32))[::-1]
        places = random.integers(0, 99, (values.size, 2))
        n = keep(best, n, places, float(yaw), values)
        given_ += [[*place, yaw, value] for place, value in zip(places.tolist(), values.tolist(), strict=True)]
    assert best[:n].tolist() == sorted(given_, key=lambda one: -one[3])[:count]


@settings(deadline=None, max_examples=40)
@given(seeds)
def test_climbing_finds_the_best_pose_around(seed: int) -> None:
    random = np.random.default_rng(seed)
    on = random.normal(size=(2, 8, 9)).astype(np.float32)
    walls, free = (random.uniform(-5.0, 5.0, (n, 2)) for n in (6, 9))
    pose = np.array([*random.uniform(0.0, 8.0, 2), random.uniform(-3.0, 3.0)])
    found = climb(on[0], on[1], walls, free, (1.0, 0.5), pose[None], 0.1, 1)[0]
    mesh = np.meshgrid([-1, 0, 1], [-1, 0, 1], [-0.1, 0.0, 0.1], indexing="ij")
    tried = pose + np.stack([part.ravel() for part in mesh], axis=1)
    one_by_one = climb(on[0], on[1], walls, free, (1.0, 0.5), tried, 0.0, 0)
    assert found[3] == pytest.approx(one_by_one[:, 3].max(), abs=1e-5)
    assert climb(on[0], on[1], walls, free, (1.0, 0.5), found[None, :3], 0.0, 0)[0, 3] == pytest.approx(found[3])


@settings(deadline=None, max_examples=40)
@given(seeds)
def test_a_gate_admits_what_its_prior_leaves_likely(seed: int) -> None:
    """Of transforms drawn from the prior nearly all are within, and its lattice fills it."""
    random = np.random.default_rng(seed)
    spread = np.array([random.uniform(0.05, 0.6), random.uniform(0.05, 0.6), math.radians(random.uniform(0.5, 4.0))])
    T = Transform.planar(*random.uniform(-20.0, 20.0, 2), random.uniform(-3.0, 3.0))
    centre = random.uniform(-10.0, 10.0, 2)
    covariance = np.zeros((6, 6))
    covariance[[0, 1, 5], [0, 1, 5]] = spread**2
    gate = Gate.of(Prior(T, covariance, "test"), centre)
    drawn = [
        Transform.planar(T.x_m + dx, T.y_m + dy, T.yaw_rad + dyaw)
        for dx, dy, dyaw in random.normal(size=(200, 3)) * spread
    ]
    poses = np.array([[*one.apply(centre[None])[0], one.yaw_rad] for one in drawn])
    assert gate.admits(poses).mean() > 0.95
    assert not gate.admits(poses + np.array([0.0, 0.0, gate.half_yaw_rad + 4.0 * spread[2] + 0.1])).any()
    lattice = gate.lattice(0.2, math.radians(1.0), 100_000)
    assert lattice is not None and gate.admits(lattice).all()
    for pose in poses[gate.admits(poses)][:50]:
        turn = np.abs(np.remainder(lattice[:, 2] - pose[2] + math.pi, 2.0 * math.pi) - math.pi)
        near = np.hypot(*(lattice[:, :2] - pose[:2]).T) + 0.2 / math.radians(1.0) * turn
        assert near.min() < 0.5
    assert gate.lattice(0.2, math.radians(1.0), 3) is None


@settings(deadline=None, max_examples=40)
@given(seeds)
def test_shifts_within_a_gate_are_those_that_mean_a_place_in_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    height, width, reach = (int(n) for n in random.integers(4, 12, 3))
    fields_ = np.zeros((height, width), np.float32)
    coarse = Level(0.1, 0.3, random.uniform(-9.0, 9.0, 2), fields_, fields_)
    shape = (max(height + reach, 2 * reach + 1) + 1, max(width + reach, 2 * reach + 1))
    middle = coarse.origin_m + 0.3 * random.uniform(-reach, (width + reach, height + reach))
    covariance = np.diag([*random.uniform(0.0, 0.3, 2), 0.0, 0.0, 0.0, random.uniform(0.0, 1.0)])
    gate = Gate.of(Prior(Transform.planar(*middle, random.uniform(-3.0, 3.0)), covariance, "test"), np.zeros(2))
    within = shifts_within(gate, coarse, reach, shape)
    for row, column in np.ndindex(*shape):
        yaw = random.uniform(-7.0, 7.0)
        periodic = np.array([[row, column, yaw, 1.0]])
        poses = unwrapped(periodic, coarse, reach, shape)
        admitted = poses[gate.admits(poses, 0.3, math.pi)]
        assert within[row, column] == bool(len(admitted))
        assert np.array_equal(unwrapped(periodic, coarse, reach, shape, gate), admitted)
        here = np.array([[*gate.place_m, yaw]])
        assert gate.admits_yaw(yaw, 0.1) == gate.admits(here, 0.0, 0.1)[0]
