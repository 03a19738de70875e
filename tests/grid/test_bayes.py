"""The log Bayes factor of a placement: its formula, its counts, and what it says of right and wrong ones."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft_grid.bayes import (
    P_FREE,
    P_OCCUPIED,
    log_bayes_factor,
    log_bayes_factors,
    meet,
    meeting_table,
    occupancy_prior,
)
from mapgraft_grid.grid_map import FREE, OCCUPIED, UNKNOWN, GridMap
from mapgraft_grid.kernels.meeting import mark, meeting
from mapgraft_grid.prepared import prepare

MakeMap = Callable[..., GridMap]
seeds = st.integers(0, 2**32 - 1)


def _classes(random: np.random.Generator) -> NDArray[np.uint8]:
    return random.integers(0, 3, random.integers(1, 13, 2)).astype(np.uint8)


def test_two_maps_of_one_cell_are_likelier_to_agree() -> None:
    """BF = p₁p₂/π + (1 − p₁)(1 − p₂)/(1 − π) has mean 1 over what two unrelated cells can say."""
    occupied, free = P_OCCUPIED, P_FREE
    table = log_bayes_factors(0.1)
    assert table[OCCUPIED, OCCUPIED] == pytest.approx(math.log(occupied**2 / 0.1 + (1 - occupied) ** 2 / 0.9))
    assert table[FREE, OCCUPIED] == pytest.approx(math.log(free * occupied / 0.1 + (1 - free) * (1 - occupied) / 0.9))
    assert (table == table.T).all() and (table[UNKNOWN] == 0.0).all()
    assert table[OCCUPIED, OCCUPIED] > 2.0 > table[3, OCCUPIED] > 0.0 > table[FREE, 4] > table[FREE, OCCUPIED]
    assert 0.0 < table[FREE, FREE] < 0.2


@settings(deadline=None, max_examples=80)
@given(seeds)
def test_marks_say_what_touches_a_wall(seed: int) -> None:
    classes = _classes(np.random.default_rng(seed))
    marks = mark(classes)
    padded = np.pad(classes == OCCUPIED, 1)
    h, w = classes.shape
    touching = sum(padded[y : y + h, x : x + w].astype(int) for y in range(3) for x in range(3)) > 0
    want = np.where(classes == OCCUPIED, OCCUPIED, np.where(touching, np.where(classes == FREE, 3, 4), classes))
    assert np.array_equal(marks, want)


@settings(deadline=None, max_examples=80)
@given(seeds)
def test_meeting_counts_pairs_of_marks(seed: int) -> None:
    random = np.random.default_rng(seed)
    target, source = mark(_classes(random)), mark(_classes(random))
    yaw, x, y = random.uniform(-4.0, 8.0, 3)
    c, s = math.cos(yaw), math.sin(yaw)
    want = np.zeros((5, 5), int)
    for row, column in np.argwhere(source):
        u = math.floor(c * (column + 0.5) - s * (row + 0.5) + x)
        v = math.floor(s * (column + 0.5) + c * (row + 0.5) + y)
        if 0 <= v < target.shape[0] and 0 <= u < target.shape[1]:
            want[target[v, u], source[row, column]] += 1
    cells = np.argwhere(source).astype(np.int32)
    found = meeting(target, cells, source[cells[:, 0], cells[:, 1]], c, s, x, y)
    assert np.abs(found - want).sum() <= 2  # a centre on the edge of two cells may go to either


def test_a_map_on_itself_agrees_everywhere(grid_map_of: MakeMap) -> None:
    classes = np.random.default_rng(3).integers(0, 3, (40, 50))
    side = prepare(grid_map_of(classes), 0.1)
    met = meet(side, side, Transform.identity())
    assert (met.agreement, met.disagreement) == (np.count_nonzero(classes), 0)
    assert met.occupied_agreement == met.near_agreement == np.count_nonzero(classes == OCCUPIED)
    factors = log_bayes_factors(occupancy_prior(side, side))
    diagonal = np.diag(meeting_table(side, side, Transform.identity()))
    assert met.log_bayes_factor == pytest.approx(float((diagonal * np.diag(factors)).sum()))
    assert met.overlap == np.count_nonzero(classes)


def test_right_is_likely_wrong_is_not_and_apart_tells_nothing(grid_map_of: MakeMap) -> None:
    room = np.ones((60, 90), np.uint8)
    room[[0, -1]], room[:, [0, -1, 40]] = OCCUPIED, OCCUPIED
    side = prepare(grid_map_of(room), 0.1)
    assert log_bayes_factor(side, side, Transform.planar(0.0, 0.0, 0.0)) > 300.0
    assert log_bayes_factor(side, side, Transform.planar(0.5, 0.5, 0.0)) < -300.0
    assert log_bayes_factor(side, side, Transform.planar(50.0, 0.0, 0.0)) == 0.0


def test_turning_both_maps_changes_nothing_but_rounding(grid_map_of: MakeMap) -> None:
    room = np.ones((60, 90), np.uint8)
    room[[0, -1]], room[:, [0, -1, 40]] = OCCUPIED, OCCUPIED
    still, part = prepare(grid_map_of(room), 0.1), prepare(grid_map_of(room[:, 30:]), 0.1)
    turned = prepare(grid_map_of(np.rot90(room)), 0.1)
    quarter = Transform.planar(0.0, 9.0, -math.pi / 2)  # what rot90 does when row 0 is at the bottom
    T = Transform.planar(3.0, 0.0, 0.0)
    assert log_bayes_factor(turned, part, quarter @ T) == pytest.approx(log_bayes_factor(still, part, T), rel=0.02)
