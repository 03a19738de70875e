"""The covariance of a placement: honest on simulated floors, large where walls say nothing, the same in any frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft_grid.certainty import Lattice, certainty
from mapgraft_grid.grid_map import FREE, OCCUPIED
from mapgraft_grid.kernels.walls import nearest, partners, piece

UNIT_M = 0.1
PLANAR = np.ix_([0, 1, 5], [0, 1, 5])
IN_95_PERCENT = 7.81  # χ² of three degrees of freedom
Walls = NDArray[np.float64]  # (n, 2, 2) from point to point, metres


def floor_of(rng: np.random.Generator) -> Walls:
    """A floor of 18 m × 12 m with rooms and things in them."""
    w, h = 18.0, 12.0
    walls = [(0, 0, w, 0), (w, 0, w, h), (w, h, 0, h), (0, h, 0, 0), (0, 5, 10, 5), (11.2, 5, w, 5), (6, 0, 6, 4)]
    walls += [(x, 5, x, rng.uniform(9, h)) for x in rng.uniform((3.2, 6.7, 12.2), (4.8, 8.3, 13.8))]
    for x, y, a, b in rng.uniform((1, 1, 0.2, 0.2), (16, 10, 1, 1), (8, 4)):
        walls += [(x, y, x + a, y), (x + a, y, x + a, y + b), (x + a, y + b, x, y + b), (x, y + b, x, y)]
    return np.array(walls).reshape(-1, 2, 2)


def mapped(walls: Walls, T: Transform, rng: np.random.Generator, wall_sigma_m: float = 0.03) -> Lattice:
    """A map of these walls made anew in its own frame: every half metre of wall has an error of its own."""
    spots = []
    for start, end in walls:
        length = float(np.hypot(*(end - start)))
        share = np.linspace(0.0, 1.0, 2 + int(length / 0.02))[:, None]
        knots = rng.normal(0.0, wall_sigma_m, (2 + int(length / 0.5), 2))
        at = np.linspace(0.0, 1.0, len(knots))
        bent = np.stack([np.interp(share[:, 0], at, knots[:, axis]) for axis in (0, 1)], axis=1)
        spots.append(start + share * (end - start) + bent + rng.normal(0.0, 0.01, bent.shape))
    cells = np.floor(T.apply(np.concatenate(spots)) / UNIT_M).astype(int)
    low = cells.min(axis=0) - 3
    classes = np.full((cells - low).max(axis=0)[::-1] + 4, FREE, np.uint8)
    classes[tuple((cells - low).T[::-1])] = OCCUPIED
    return Lattice(classes, UNIT_M, low * UNIT_M)


def error_of(found: Transform, truth: Transform) -> NDArray[np.float64]:
    turn = math.remainder(found.yaw_rad - truth.yaw_rad, 2 * math.pi)
    return np.array([found.x_m - truth.x_m, found.y_m - truth.y_m, turn])


def test_the_ellipse_holds_the_truth_wherever_the_search_ends() -> None:
    """Placements up to a cell and a half a degree off; the walls alone say so, nothing is allowed for the search."""
    rng = np.random.default_rng(11)
    squares, sigmas = [], []
    for _ in range(60):
        walls = floor_of(rng)
        T_source_world = Transform.planar(*rng.uniform(-5, 5, 2), rng.uniform(-3, 3))
        target, source = mapped(walls, Transform.identity(), rng), mapped(walls[3:], T_source_world, rng)
        truth, middle = T_source_world.inverse(), Transform.planar(9.0, 6.0, 0.0)
        miss = Transform.planar(*rng.uniform(-0.1, 0.1, 2), math.radians(rng.uniform(-0.5, 0.5)))
        found = middle @ miss @ middle.inverse() @ truth
        known = certainty(target, source, found, 0.0, 0.0)
        assert known is not None
        error = error_of(found, truth)
        squares.append(error @ np.linalg.solve(known.covariance[PLANAR], error))
        sigmas.append(known.sigma_max_m)
    assert np.mean(np.array(squares) <= IN_95_PERCENT) >= 0.9
    assert np.median(squares) > 0.3 and max(sigmas) < 0.2  # it is no excuse for anything either


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, 1.2, 2.9])
def test_along_a_corridor_all_is_open(yaw_rad: float) -> None:
    rng = np.random.default_rng(5)
    sides = np.array([[[0.0, 0.0], [15.0, 0.0]], [[0.0, 2.0], [15.0, 2.0]]])
    target = mapped(sides, Transform.planar(0, 0, yaw_rad), rng)
    source = mapped(sides - [[[2.0, 0.0]]], Transform.identity(), rng)
    known = certainty(target, source, Transform.planar(0, 0, yaw_rad), 0.0, 0.0)
    assert known is not None
    assert 10.0 < known.sigma_max_m <= UNIT_M * math.hypot(*target.classes.shape)
    assert abs(math.remainder(known.degenerate_dir_rad - yaw_rad, math.pi)) < 0.03
    assert 0.0 <= known.degenerate_dir_rad < math.pi
    assert math.sqrt(known.covariance[5, 5]) < math.radians(1.0)
    box = np.array([[[0.0, 0.0], [0.0, 2.0]], [[5.0, 0.0], [5.0, 2.0]]])  # two cross walls settle it
    ends = certainty(
        mapped(np.concatenate((sides, box)), Transform.planar(0, 0, yaw_rad), rng),
        mapped(np.concatenate((sides, box)), Transform.identity(), rng),
        Transform.planar(0, 0, yaw_rad),
        0.0,
        0.0,
    )
    assert ends is not None and ends.sigma_max_m < 0.2


def test_a_round_room_tells_no_yaw() -> None:
    turn = np.linspace(0.0, 2 * math.pi, 200)
    ring = 5.0 * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    walls = np.stack((ring[:-1], ring[1:]), axis=1)
    rng = np.random.default_rng(2)
    maps = [mapped(walls, Transform.identity(), rng, wall_sigma_m=0.0) for _ in range(2)]
    known = certainty(maps[0], maps[1], Transform.identity(), 0.0, 0.0)
    assert known is not None
    assert math.sqrt(known.covariance[5, 5]) > 1.5 and known.sigma_max_m < 0.1


def test_with_little_wall_in_common_nothing_is_said() -> None:
    rng = np.random.default_rng(3)
    walls = floor_of(rng)
    target, source = (mapped(walls, Transform.identity(), rng) for _ in range(2))
    assert certainty(target, source, Transform.identity(), 0.0, 0.0) is not None
    assert certainty(target, source, Transform.planar(40.0, 0.0, 0.0), 0.0, 0.0) is None


@settings(deadline=None, max_examples=15)
@given(st.floats(-30, 30), st.floats(-30, 30), st.floats(-3, 3))
def test_where_the_frames_lie_changes_only_the_arm(x_m: float, y_m: float, yaw_rad: float) -> None:
    """The source's origin elsewhere: its covariance is the other's, carried over to first order."""
    rng = np.random.default_rng(4)
    walls = floor_of(rng)
    T = Transform.planar(1.0137, -2.0271, yaw_rad)  # no cell of the one lies right between two of the other
    target, source = mapped(walls, T, rng), mapped(walls, Transform.identity(), rng)
    moved = Lattice(source.classes, UNIT_M, source.origin_m - (x_m, y_m))
    T_moved = T @ Transform.planar(x_m, y_m, 0.0)
    one, other = certainty(target, source, T, 0.01, 0.001), certainty(target, moved, T_moved, 0.01, 0.001)
    assert one is not None and other is not None
    assert other.sigma_max_m == pytest.approx(one.sigma_max_m)
    carried = np.eye(3)
    carried[:2, 2] = -(T_moved.y_m - T.y_m), T_moved.x_m - T.x_m
    assert other.covariance[PLANAR] == pytest.approx(carried @ one.covariance[PLANAR] @ carried.T, rel=1e-6, abs=1e-9)
    assert not other.covariance[2:5].any() and not other.covariance[:, 2:5].any()
    assert np.array_equal(other.covariance, other.covariance.T) and np.linalg.eigvalsh(other.covariance).min() > -1e-12


@settings(deadline=None, max_examples=50)
@given(st.floats(0, math.pi), st.integers(1, 3))
def test_a_piece_of_wall_has_the_direction_of_the_wall(angle: float, thick: int) -> None:
    rows, columns = np.indices((41, 41)) - 20
    classes = (abs(rows * math.cos(angle) - columns * math.sin(angle)) <= 0.5 * thick).astype(np.uint8) * OCCUPIED
    x, y, n_x, n_y = piece(classes, OCCUPIED, 20, 20)
    assert (x, y) == pytest.approx((20.5, 20.5))
    assert abs(n_x * math.cos(angle) + n_y * math.sin(angle)) < math.sin(math.radians(15.0))
    assert math.hypot(n_x, n_y) == pytest.approx(1.0)


def test_what_is_no_line_has_no_normal() -> None:
    dot, block = np.zeros((9, 9), np.uint8), np.full((9, 9), OCCUPIED, np.uint8)
    dot[4, 4] = OCCUPIED
    assert piece(dot, OCCUPIED, 4, 4)[2:] == (0.0, 0.0) and piece(block, OCCUPIED, 4, 4)[2:] == (0.0, 0.0)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 2**32 - 1), st.floats(-2, 14), st.floats(-2, 14))
def test_the_nearest_cell_is_the_nearest(seed: int, x: float, y: float) -> None:
    classes = np.random.default_rng(seed).choice([FREE, OCCUPIED], (12, 12), p=[0.95, 0.05]).astype(np.uint8)
    cells = np.argwhere(classes == OCCUPIED)
    row, column = nearest(classes, OCCUPIED, x, y)
    far = np.hypot(cells[:, 1] + 0.5 - x, cells[:, 0] + 0.5 - y)
    if row < 0:
        assert not (far < 3.0).any()
    else:
        assert math.hypot(column + 0.5 - x, row + 0.5 - y) == pytest.approx(far.min())


def test_partners_tell_how_far_the_walls_are_apart() -> None:
    classes = np.ones((30, 40), np.uint8)
    classes[10, 5:35] = OCCUPIED
    cells = np.argwhere(classes == OCCUPIED)
    found = partners(classes, classes, cells, OCCUPIED, 1.0, 0.0, 0.0, 1.25)
    assert len(found) == 30
    assert (abs(found[:, 6]) == pytest.approx([1.25] * 30)) and (found[:, 6] * found[:, 3] < 0).all()
    assert found[:, 2:4] == pytest.approx(found[:, 4:6])
    assert not len(partners(classes, classes, cells, OCCUPIED, 1.0, 0.0, 0.0, 8.0))
    across = partners(classes, classes, cells, OCCUPIED, 0.0, 1.0, 30.0, -9.5)  # turned by a quarter, it crosses
    assert not len(across)
