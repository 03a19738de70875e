"""Layers from given segments."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mapgraft.contracts import MapError
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.map_type import LineSegments
from mapgraft_lines.segments import from_segments, length_m

ROOM = np.array([[(0, 0), (4, 0)], [(4, 0), (4, 3)], [(4, 3), (0, 3)], [(0, 3), (0, 0)]], np.float64)


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.0, math.pi / 4, 2.5])
@pytest.mark.parametrize("faced", [False, True])
def test_walls_are_what_was_given(turn: float, faced: bool) -> None:
    c, s = math.cos(turn), math.sin(turn)
    given = ROOM @ np.array([[c, s], [-s, c]]) + (0.3, -7.1)
    kind = LineSegments()
    walls = kind.view(from_segments(kind, given, 0.01, faced=faced)).walls
    assert len(walls) == 4
    assert walls.faced.all() == faced and walls.faced.any() == faced
    assert walls.lengths_m.sum() == pytest.approx(length_m(given), abs=0.02)
    for ends in given:
        off = np.abs(walls.ends_m - ends).max(axis=(1, 2))
        if not faced:
            off = np.minimum(off, np.abs(walls.ends_m[:, ::-1] - ends).max(axis=(1, 2)))
        assert off.min() < 0.01


def test_surer_segments_weigh_more() -> None:
    kind = LineSegments()
    a, b = np.array([[(0.1, 0.10), (5, 0.10)]]), np.array([[(0.1, 0.16), (5, 0.16)]])
    both = np.concatenate((a, b))
    walls = kind.view(from_segments(kind, both, np.array([0.01, 0.02]))).walls
    assert len(walls) == 1
    assert_allclose(walls.ends_m[0, :, 1], 0.10 + 0.06 / 5.0, atol=2e-3)  # weights 4 : 1


def test_free_space_is_told_by_places() -> None:
    kind = LineSegments(cell_m=0.5)
    layer = from_segments(kind, ROOM, free_m=np.array([[1.1, 1.1], [1.2, 1.4], [2.2, 1.1]]))
    seen = kind.view(layer)
    assert len(layer.own.space) == 2
    assert seen.cells.at(np.array([[1.3, 1.3], [2.4, 1.4], [9.0, 9.0]])).tolist() == [1, 1, 0]


def test_nothing_without_length() -> None:
    kind = LineSegments()
    layer = from_segments(kind, np.zeros((3, 2, 2)))
    assert kind.view(layer).known() == 0
    assert len(from_segments(kind, np.empty((0, 2, 2))).own) == 0


@pytest.mark.parametrize(
    ("points", "sigma_m", "looks", "said"),
    [
        (ROOM * 1e9, 0.02, 1, "check its unit"),
        (ROOM * math.nan, 0.02, 1, "not finite"),
        (ROOM, 20.0, 1, "standard deviation"),
        (ROOM, 0.02, 0, "stands for"),
        (np.repeat(ROOM * 1e5, 100, axis=0), 0.02, 1, "pieces"),
    ],
)
def test_what_cannot_be_is_refused(points: np.ndarray, sigma_m: float, looks: int, said: str) -> None:
    with pytest.raises(MapError, match=said):
        from_segments(LineSegments(), points, sigma_m, looks=looks)


def test_another_type_is_refused() -> None:
    with pytest.raises(MapError, match="found the type occupancy_grid"):
        from_segments(OccupancyGrid(), ROOM)
