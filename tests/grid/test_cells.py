"""Layers out of counts of cells and back: nothing is lost, nothing is counted twice."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mapgraft.contracts import MapError
from mapgraft_grid import cells as module
from mapgraft_grid.cells import (
    MOST_LOOKS,
    READY_MADE,
    GridLayer,
    Lattice,
    SensorModel,
    added,
    cells_at,
    cells_inside,
    cells_of,
    centres_m,
    lattice_of,
    layer_of_cells,
    layer_of_window,
    most,
    window_of,
)
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.map_type import LineSegments

CountsOf = Callable[[GridLayer], dict[tuple[int, int], tuple[int, int]]]
GRID = OccupancyGrid(resolution_m=0.1)
FAR = 1 << 29
near = st.integers(-130, 130)
index = st.one_of(near, st.sampled_from([-FAR, -FAR + 1, FAR]))
looks = st.one_of(st.integers(0, 5), st.sampled_from([65_535, 65_536, 200_000]))
counted = st.dictionaries(st.tuples(index, index), st.tuples(looks, looks), max_size=12)


def arrays(told: dict[tuple[int, int], tuple[int, int]]) -> tuple[Any, Any]:
    return np.array(list(told), np.int64).reshape(-1, 2), np.array(list(told.values()), np.int64).reshape(-1, 2)


@settings(max_examples=60, deadline=None)
@given(counted)
def test_a_layer_has_the_counts_it_was_given(counts_of: CountsOf, told: dict[tuple[int, int], tuple[int, int]]) -> None:
    layer = layer_of_cells(GRID, *arrays(told))
    assert counts_of(layer) == {cell: counts for cell, counts in told.items() if any(counts)}


@settings(max_examples=60, deadline=None)
@given(counted)
def test_cells_of_is_the_inverse(told: dict[tuple[int, int], tuple[int, int]]) -> None:
    layer = layer_of_cells(GRID, *arrays(told))
    again = layer_of_cells(GRID, *cells_of(layer))
    assert GRID.encode(layer) == GRID.encode(again)


@settings(max_examples=60, deadline=None)
@given(near, near, st.integers(0, 150), st.integers(0, 150), st.integers(0, 2**32 - 1))
def test_windows_are_cells(ix: int, iy: int, width: int, height: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    window = random.integers(0, 4, (2, height, width)) * (random.random((height, width)) < 0.05)
    layer = layer_of_window(GRID, (ix, iy), window.astype(np.uint8))
    rows, columns = np.nonzero(window.any(axis=0))
    cells = np.stack((columns + ix, rows + iy), axis=1)
    assert GRID.encode(layer) == GRID.encode(layer_of_cells(GRID, cells, window[:, rows, columns].T))
    assert np.array_equal(window_of(layer, (ix, iy), (height, width)), window)


def test_a_window_is_cut_out_anywhere() -> None:
    layer = layer_of_cells(GRID, np.array([[0, 0], [70, -3]]), np.array([[3, 1], [0, 200_000]]))
    assert np.array_equal(
        window_of(layer, (69, -4), (3, 2)), [[[0, 0], [0, 0], [0, 0]], [[0, 0], [0, 200_000], [0, 0]]]
    )
    assert window_of(layer, (500, 500), (3, 2)).sum() == 0


def test_many_tiles_far_apart_are_written_a_part_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    cells = np.stack((np.arange(50) * 1000, np.arange(50) * -777), axis=1)[::-1]
    counts = np.stack((np.arange(50) + 1, np.arange(50)), axis=1)
    at_once = layer_of_cells(GRID, cells, counts)
    monkeypatch.setattr(module, "_AT_ONCE", 7)
    assert GRID.encode(layer_of_cells(GRID, cells, counts)) == GRID.encode(at_once)
    told, numbers = cells_of(at_once)
    assert {tuple(cell): tuple(n) for cell, n in zip(told.tolist(), numbers.tolist(), strict=True)} == {
        tuple(cell): tuple(n) for cell, n in zip(cells.tolist(), counts.tolist(), strict=True)
    }


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.tuples(near, near), st.tuples(looks, looks)), max_size=12))
def test_repeated_cells_are_added_or_their_most_taken(told: list[tuple[tuple[int, int], tuple[int, int]]]) -> None:
    cells = np.array([cell for cell, _ in told], np.int64).reshape(-1, 2)
    counts = np.array([n for _, n in told], np.int64).reshape(-1, 2)
    for function, joined in ((added, sum), (most, max)):
        expected = {cell: [joined(n[i] for other, n in told if other == cell) for i in range(2)] for cell, _ in told}
        out, numbers = function(cells, counts)
        assert {tuple(cell): n for cell, n in zip(out.tolist(), numbers.tolist(), strict=True)} == expected
        assert len(out) == len(expected)


def test_what_the_target_and_the_caller_say_is_kept() -> None:
    layer = layer_of_cells(
        GRID,
        np.array([[1, 2]]),
        np.array([[MOST_LOOKS + 5, 0]]),
        lattice=Lattice(0.25, (0.1, 0.0)),
        sensor_model=SensorModel(700, -300),
        observations=7,
        sensors=frozenset({"laser"}),
        mapper=READY_MADE,
    )
    assert (layer.lattice, layer.sensor_model) == (Lattice(0.25, (0.1, 0.0)), SensorModel(700, -300))
    assert (layer.observations, layer.sensors, layer.mapper) == (7, frozenset({"laser"}), READY_MADE)
    assert cells_of(layer)[1].tolist() == [[MOST_LOOKS, 0]]
    plain = layer_of_cells(GRID, np.array([[1, 2]]), np.array([[1, 0]]))
    assert (plain.lattice, plain.sensor_model) == (GRID.new_layer().lattice, GRID.new_layer().sensor_model)


def test_points_lie_in_the_cells_whose_centres_are_told() -> None:
    lattice = Lattice(0.25, (0.1, 0.2))
    cells = np.array([[0, 0], [-3, 7], [1000, -1000]])
    assert np.array_equal(cells_at(centres_m(cells, lattice), lattice), cells)
    assert np.array_equal(centres_m(cells[:1], lattice), [[0.225, 0.325]])
    assert np.array_equal(cells_at(np.array([[0.09, 0.2]]), lattice), [[-1, 0]])


@settings(max_examples=60, deadline=None)
@example(8283, 0.0731, (0.0, 0.05))
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0731, 0.2517, 0.613]),
    st.tuples(st.floats(0, 0.09), st.floats(0, 0.09)),
)
def test_squares_hold_the_cells_whose_centres_lie_in_them(seed: int, side_m: float, anchor_m: Any) -> None:
    lattice = Lattice(0.1, anchor_m)
    squares = np.unique(np.random.default_rng(seed).integers(-9, 9, (8, 2)), axis=0)
    cells, square = cells_inside(squares * side_m, side_m, lattice)
    near = np.stack(np.meshgrid(np.arange(-70, 70), np.arange(-70, 70)), axis=-1).reshape(-1, 2)
    held = np.floor(centres_m(near, lattice) / side_m + 1e-9).astype(np.int64)
    expected = {(*cell, n) for n, one in enumerate(squares) for cell in near[(held == one).all(axis=1)].tolist()}
    assert {(*cell, n) for cell, n in zip(map(tuple, cells.tolist()), square.tolist(), strict=True)} == expected
    assert len(np.unique(cells, axis=0)) == len(cells)


@pytest.mark.parametrize(
    ("cells", "counts", "said"),
    [
        ([[0, 0], [0, 0]], [[1, 0], [1, 0]], "more than once"),
        ([[0, 0]], [[-1, 0]], "seen -1 times"),
        ([[1 << 30, 0]], [[1, 0]], "one beyond"),
        ([[0, 0, 0]], [[1, 0, 0]], "cells \\(n, 2\\)"),
        ([[0, 0]], [[1], [0]], "found \\(1, 2\\) and \\(2, 1\\)"),
    ],
)
def test_what_is_no_count_of_cells_is_refused(cells: Any, counts: Any, said: str) -> None:
    with pytest.raises(MapError, match=said):
        layer_of_cells(GRID, np.array(cells, np.int64), np.array(counts, np.int64))


def test_windows_beyond_reach_and_with_less_than_nothing_are_refused() -> None:
    with pytest.raises(MapError, match="one beyond"):
        layer_of_window(GRID, ((1 << 30) - 1, 0), np.ones((2, 2, 2), np.int64))
    with pytest.raises(MapError, match="seen -2 times"):
        layer_of_window(GRID, (0, 0), np.full((2, 1, 1), -2))


def test_other_types_are_refused() -> None:
    lines = LineSegments()
    for make in (lattice_of, lambda kind: layer_of_cells(kind, np.zeros((1, 2), np.int64), np.ones((1, 2), np.int64))):
        with pytest.raises(MapError, match="found the target line_segments"):
            make(lines)
    for read in (cells_of, lambda layer: window_of(layer, (0, 0), (1, 1))):
        with pytest.raises(MapError, match="found one of line_segments"):
            read(lines.new_layer())


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e12])
def test_points_nowhere_are_refused(value: float) -> None:
    with pytest.raises(MapError, match=r"not finite|one beyond"):
        cells_at(np.array([[value, 0.0]]), Lattice(0.1))
