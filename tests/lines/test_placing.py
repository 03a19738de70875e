"""Placing evidence moves it, and makes no more of it than there was."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft_lines.layer import LOOKS
from mapgraft_lines.map_type import LineSegments
from mapgraft_lines.segments import from_segments
from mapgraft_lines.walls import Walls

ROOM = np.array([[(0, 0), (6, 0)], [(6, 0), (6, 4)], [(6, 4), (0, 4)], [(0, 4), (0, 0)]], np.float64)
FINE = LineSegments(cell_m=0.25)


def paired(before: Walls, after: Walls, within_m: float) -> list[int]:
    """Which of the walls after is each of those before."""
    off = np.abs(before.ends_m[:, None] - after.ends_m).max(axis=(2, 3))
    nearest: list[int] = off.argmin(axis=1).tolist()
    assert sorted(nearest) == list(range(len(after))) and off.min(axis=1).max() < within_m
    return nearest


def scanned(look, times: int):
    layer = FINE.new_layer()
    for k in range(times):
        FINE.integrate(layer, look(ROOM, (2.0 + 0.3 * k, 1.5, 0.2 * k), beams=720))
    return layer


@pytest.mark.parametrize("cell_m", [0.0625, 0.25, 0.5, 1.0, 4.0])
@pytest.mark.parametrize("times", [1, 3])
def test_one_look_stays_one_look_on_cells_of_any_size(look, cell_m: float, times: int) -> None:
    placed = LineSegments(cell_m=cell_m).place(scanned(look, times), Transform.planar(0.4, -0.2, 0.5))
    assert 1 <= placed.own.pieces.counts[:, LOOKS].max() <= times
    assert 1 <= placed.own.space.counts.max() <= times


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.25, 0.5, 1.0]),
    st.floats(-3.1, 3.1),
    st.integers(1, 5),
)
def test_no_slot_was_looked_at_more_often_than_any_before(seed: int, cell_m: float, yaw: float, looks: int) -> None:
    random = np.random.default_rng(seed)
    layer = from_segments(FINE, random.uniform(-4.0, 4.0, (12, 2, 2)), looks=looks, observations=looks)
    placed = LineSegments(cell_m=cell_m).place(layer, Transform.planar(*random.uniform(-2, 2, 2), yaw))
    assert placed.own.pieces.counts[:, LOOKS].max() == looks


@pytest.mark.parametrize("cell_m", [0.125, 0.5, 1.0])
def test_walls_are_as_sure_on_cells_of_another_size(look, cell_m: float) -> None:
    layer = scanned(look, 4)
    before = FINE.view(layer).walls
    kind = LineSegments(cell_m=cell_m)
    after = kind.view(kind.place(layer, Transform.identity())).walls
    same = paired(before, after, 0.1)
    np.testing.assert_allclose(after.looks[same], before.looks, atol=0.8)
    np.testing.assert_allclose(after.sigma_m[same], before.sigma_m, rtol=0.15)


def test_what_is_stretched_is_less_sure() -> None:
    layer = from_segments(FINE, ROOM, 0.05)
    kind = LineSegments(cell_m=0.5)
    before, after = (
        kind_.view(layer_).walls
        for kind_, layer_ in ((FINE, layer), (kind, kind.place(layer, Transform.identity(), 3.0)))
    )
    np.testing.assert_allclose(after.sigma_m, 3.0 * before.sigma_m, rtol=0.1)
    np.testing.assert_allclose(after.lengths_m, 3.0 * before.lengths_m, rtol=0.02)


def test_turning_back_gives_the_walls_again(look) -> None:
    layer, T = scanned(look, 3), Transform.planar(1.0, 2.0, math.radians(33.0))
    back = FINE.view(FINE.place(FINE.place(layer, T), T.inverse())).walls
    assert len(paired(FINE.view(layer).walls, back, 0.05)) == 4


def test_a_wall_in_many_pieces_was_not_seen_more_often() -> None:
    whole = np.array([[(0.03, 1.0), (4.03, 1.0)]])
    at = np.linspace(0.03, 4.03, 401)
    pieces = np.stack((np.stack((at[:-1], at[:-1] * 0 + 1.0), 1), np.stack((at[1:], at[1:] * 0 + 1.0), 1)), axis=1)
    for segments in (whole, pieces, np.concatenate((whole, whole + np.array([0.0, 0.06])))):
        assert from_segments(FINE, segments, looks=2).own.pieces.counts[:, LOOKS].max() == 2
