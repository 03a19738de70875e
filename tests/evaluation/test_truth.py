"""What is held to be true of a pair, and how far from it a hypothesis is."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from mapgraft.contracts import Match, Observation, Scan, Transform
from mapgraft.evaluation import Course, Drawing, Pair, PairPlan, Truth, Window, build, draw_pairs
from mapgraft.evaluation.certainty import ELLIPSE_95, certainty, walls_middle
from mapgraft.evaluation.growth import grow
from mapgraft_grid.map_type import OccupancyGrid


@pytest.fixture(scope="module")
def pairs(courses) -> list[Pair]:
    """Pairs within the places, at two resolutions; the last two share scans."""
    plans = draw_pairs(courses, Drawing(pairs=6, scans=20, further=5, across=0.0, seed=2))
    for number, course in ((6, courses[0]), (7, courses[2])):
        plans.append(PairPlan(number, Window(course, 10, 20, 5), Window(course, 20, 20, 5), 1.0, -2.0))
    return [build(plan, OccupancyGrid(resolution_m=0.07), OccupancyGrid(resolution_m=0.1)) for plan in plans]


def test_the_true_transform_brings_both_paths_together(pairs):
    for pair in pairs:
        for side, window in ((pair.receiver, pair.plan.receiver), (pair.donor, pair.plan.donor)):
            first = side.observations[0].T_map_base
            assert (first.x_m, first.y_m) == pytest.approx((0.0, 0.0), abs=1e-9)
            assert [o.payload for o in side.observations] == [o.payload for o in window.observations]
        T_receiver_world = pair.receiver.observations[0].T_map_base @ _first(pair.plan.receiver).inverse()
        for mine, world in zip(pair.donor.observations, pair.plan.donor.observations, strict=True):
            moved = pair.truth.T_receiver_donor @ mine.T_map_base
            assert np.allclose(moved.matrix, (T_receiver_world @ world.T_map_base).matrix, atol=1e-9)
        assert pair.receiver.observations[0].T_map_base.yaw_rad == pytest.approx(pair.plan.receiver_turn_rad)


def _first(window: Window) -> Transform:
    return window.observations[0].T_map_base


def test_the_overlap_is_what_both_know_of_the_smaller_map(pairs):
    overlaps = []
    for pair in pairs:
        placed, own = pair.truth.placed, pair.receiver.map
        x0, y0, x1, y1 = placed.bounds_cells()
        known = [m.dense_over((x0, y0), (y1 - y0, x1 - x0)).classes > 0 for m in (placed, own)]
        assert pair.overlap == (known[0] & known[1]).sum() / min(placed.known(), own.known())
        overlaps.append(pair.overlap)
    assert min(overlaps) < 0.3 < min(overlaps[-2:])


def test_a_window_overlaps_with_itself_in_all_it_knows(courses):
    window = Window(courses[0], 10, 20, 5)
    pair = build(PairPlan(0, window, window, 0.3, 0.3), OccupancyGrid(), OccupancyGrid())
    assert pair.overlap == 1.0
    assert pair.truth.T_receiver_donor.matrix == pytest.approx(np.eye(4), abs=1e-12)


def test_errors_are_those_of_the_walls(pairs):
    for pair in pairs:
        truth = pair.truth
        T = truth.T_receiver_donor
        assert truth.error(T) == pytest.approx((0.0, 0.0), abs=1e-6)
        aside = truth.error(Transform.planar(0.3, -0.4, 0.0) @ T)
        assert aside == pytest.approx((0.5, 0.0), abs=1e-6)
        x_m, y_m = truth.points_m.mean(axis=0)
        about = Transform.planar(x_m, y_m, 0.0)
        turned = truth.error(about @ Transform.planar(0.0, 0.0, math.radians(-4.0)) @ about.inverse() @ T)
        arm_m = np.linalg.norm(truth.points_m - (x_m, y_m), axis=1).mean()
        assert turned.rotation_deg == pytest.approx(4.0)
        assert turned.displacement_m == pytest.approx(2.0 * math.sin(math.radians(2.0)) * arm_m)


def test_the_walls_in_the_overlap_are_asked_and_where_there_are_none_all(pairs):
    for pair in pairs:
        placed = pair.truth.placed
        x0, y0, x1, y1 = placed.bounds_cells()
        theirs, ours = (m.dense_over((x0, y0), (y1 - y0, x1 - x0)).classes for m in (placed, pair.receiver.map))
        inside = int(((theirs == 2) & (ours > 0)).sum())
        assert pair.truth.shared_walls == inside
        assert len(pair.truth.walls_m) == (inside or (theirs == 2).sum())
    assert pairs[-1].truth.shared_walls > 0
    far = Transform.planar(1000.0, 0.0, 0.0)
    alone = Truth.of(pairs[0].receiver.map_type, pairs[0].receiver.map, pairs[0].donor.layer, far)
    assert (alone.shared_walls, alone.overlap) == (0, 0.0) and len(alone.walls_m) > 0


def test_a_donor_that_knows_nothing_has_a_truth_all_the_same():
    grids = OccupancyGrid()
    blind = grids.new_layer()
    own = grids.view(grids.new_layer())
    truth = Truth.of(grids, own, blind, Transform.planar(1.0, 2.0, 0.5))
    assert truth.overlap == 0.0 and len(truth.walls_m) == 0
    assert truth.error(Transform.planar(1.0, 2.5, 0.5)) == pytest.approx((0.5, 0.0))


def test_new_wall_is_what_the_receiver_comes_to_know_of_the_donors():
    """A donor has seen a wall 5 m long; the receiver looks along it, metre by metre."""

    def look(x_m: float) -> Observation:
        there = Transform.planar(x_m, 0.0, 0.0)
        angles = math.pi / 2 + np.linspace(-0.35, 0.35, 200)
        directions = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        ranges = (1.52 / np.sin(angles)).astype(np.float32)
        scan = Scan(directions, ranges, np.ones(200, np.bool_))
        return Observation("r", 0, 0, "lidar", "scan", scan, there, there)

    donor = Course.of(0, "d", "hall", [look(x) for x in np.repeat(np.arange(0.0, 5.0, 0.25), 4)])
    receiver = Course.of(1, "r", "hall", [look(0.0)] * 5 + [look(x) for x in np.repeat(np.arange(1.0, 4.0, 0.5), 5)])
    plan = PairPlan(0, Window(receiver, 0, 5, 30), Window(donor, 0, 80, 0), 0.0, 0.0)
    pair = build(plan, OccupancyGrid(resolution_m=0.05), OccupancyGrid(resolution_m=0.05))
    grown = grow(pair)
    assert grown.walls_m == pytest.approx(3.5, abs=0.5)
    assert len(grown.integrated_s) == 30
    assert grow(dataclasses.replace(pair, further=())).walls_m == 0.0
    assert grow(dataclasses.replace(pair, truth=None)).walls_m is None


def test_honest_covariances_hold_the_truth_as_often_as_they_say(pairs):
    rng = np.random.default_rng(5)
    pair = max(pairs, key=lambda pair: pair.truth.shared_walls)
    T = pair.truth.T_receiver_donor
    spread = np.diag([0.03, 0.08, 0.01]) @ np.array([[1.0, 0.2, 0.1], [0.2, 1.0, -0.3], [0.1, -0.3, 1.0]])
    full = np.zeros((6, 6))
    full[np.ix_((0, 1, 5), (0, 1, 5))] = spread @ spread.T
    inside, middle_m = 0, walls_middle(pair.truth, pair.donor.map_type, pair.donor.map)
    for _ in range(500):
        dx, dy, turn = spread @ rng.standard_normal(3)
        found = Transform.planar(T.x_m + dx, T.y_m + dy, T.yaw_rad + turn)
        match = Match(found, 1.0, 1.0, covariance=full)
        distance2 = certainty(match, middle_m).distance2(pair.truth, match)
        inside += distance2 <= ELLIPSE_95
        by_hand = np.array([dx, dy, turn]) @ np.linalg.solve(spread @ spread.T, np.array([dx, dy, turn]))
        assert distance2 == pytest.approx(by_hand, rel=0.2, abs=0.2)  # the turn is small, not infinitely small
    assert 0.92 <= inside / 500 <= 0.98
    assert pytest.approx(7.8147, abs=1e-3) == ELLIPSE_95


def test_covariances_that_are_none_are_none(pairs):
    truth, donor = pairs[0].truth, pairs[0].donor
    T, middle_m = truth.T_receiver_donor, walls_middle(truth, donor.map_type, donor.map)
    singular, infinite = np.diag([1.0, 1.0, 0, 0, 0, 0.0]), np.diag([1.0, np.inf, 0, 0, 0, 1.0])
    for covariance in (None, np.eye(3), singular, infinite, -np.eye(6)):
        assert certainty(Match(T, 1.0, 1.0, covariance=covariance), middle_m) is None
    wide = certainty(Match(T, 1.0, 1.0, covariance=np.diag([1e-4, 0.09, 0, 0, 0, 1e-12])), middle_m)
    assert wide.degenerate and wide.sigma_max_m == pytest.approx(0.3, rel=1e-3)
    match = Match(T, 1.0, 1.0, covariance=np.diag([1e-4, 1e-4, 0, 0, 0, 1e-12]))
    narrow = certainty(match, middle_m)
    assert not narrow.degenerate and narrow.distance2(truth, match) == pytest.approx(0.0, abs=1e-9)


def test_without_a_truth_all_walls_of_the_donor_are_asked(pairs):
    donor = pairs[0].donor
    walls_m = donor.map_type.structure(donor.map)
    assert walls_middle(None, donor.map_type, donor.map) == pytest.approx(walls_m.mean(axis=0))
    assert walls_middle(None, donor.map_type, donor.map_type.view(None)) == pytest.approx((0.0, 0.0))
