"""The table of evidence and regions of cells: laws of adding, and of sets."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mapgraft_landmarks.cells import INDEX_LIMIT, CellRegion, Cells, as_region, keys_at, offset, pack, unpack

from mapgraft.contracts import MapError

indices = st.integers(-INDEX_LIMIT, INDEX_LIMIT)
numbers = st.tuples(*[st.integers(0, 9)] * 2, *[st.integers(-99, 99)] * 2)
rows = st.dictionaries(st.integers(-20, 20), numbers, max_size=9)
keys = st.sets(st.integers(-20, 20), max_size=12)
NOTHING = (0, 0, 0, 0)


def table(given: dict[int, tuple[int, int, int, int]]) -> Cells:
    ordered = sorted(given)
    return Cells(np.array(ordered, np.int64), np.array([given[key] for key in ordered], np.int64).reshape(-1, 4))


def region(given: set[int]) -> CellRegion:
    return CellRegion(0.5, np.array(sorted(given), np.int64))


def as_dict(cells: Cells) -> dict[int, tuple[int, ...]]:
    return {int(key): tuple(row) for key, row in zip(cells.keys, cells.counts.tolist(), strict=True)}


@given(st.lists(st.tuples(indices, indices), min_size=1))
def test_unpack_is_the_inverse_of_pack(places: list[tuple[int, int]]) -> None:
    ix, iy = np.array(places, np.int64).T
    back = unpack(pack(ix, iy))
    assert (back[0] == ix).all()
    assert (back[1] == iy).all()


@given(indices, indices, st.integers(-3, 3), st.integers(-3, 3))
def test_an_offset_leads_to_the_neighbour(ix: int, iy: int, dx: int, dy: int) -> None:
    here, there = (pack(np.array([x]), np.array([y])) for x, y in ((ix, iy), (ix + dx, iy + dy)))
    assert here + offset(dx, dy) == there


@given(rows, rows, st.integers(1, 3))
def test_plus_adds_row_by_row(a: dict[int, tuple[int, ...]], b: dict[int, tuple[int, ...]], times: int) -> None:
    expected = {
        key: tuple(np.array(a.get(key, NOTHING)) + times * np.array(b.get(key, NOTHING))) for key in a.keys() | b.keys()
    }
    before = as_dict(table(a))
    left = table(a)
    assert as_dict(left.plus(table(b), times)) == expected
    assert as_dict(left) == before


@given(rows, keys)
def test_at_and_without_look_up_and_leave_out(a: dict[int, tuple[int, ...]], some: set[int]) -> None:
    cells, chosen = table(a), np.array(sorted(some), np.int64)
    assert as_dict(cells.without(chosen)) == {key: row for key, row in as_dict(cells).items() if key not in some}
    assert [tuple(row) for row in cells.at(chosen).tolist()] == [a.get(key, NOTHING) for key in sorted(some)]


def test_a_table_is_never_written() -> None:
    cells = table({1: (1, 0, 0, 0)})
    with pytest.raises(ValueError, match="read-only"):
        cells.counts[0, 0] = 2


@given(keys, keys)
def test_regions_are_sets(a: set[int], b: set[int]) -> None:
    assert set(region(a).union(region(b)).keys.tolist()) == a | b
    assert set(region(a).minus(region(b)).keys.tolist()) == a - b
    assert len(region(a)) == len(a)


def test_regions_of_different_cells_do_not_mix() -> None:
    other = CellRegion(0.25, np.array([1], np.int64))
    with pytest.raises(MapError, match=r"0\.5 m and 0\.25 m"):
        region({1}).union(other)
    with pytest.raises(MapError, match="place the layer first"):
        region({1}).minus(other)


def test_a_point_out_of_reach_is_refused() -> None:
    with pytest.raises(MapError, match="check the poses"):
        keys_at(np.array([[1e12, 0.0]]), 0.25)
    with pytest.raises(MapError, match="check the poses"):
        keys_at(np.array([[np.nan, 0.0]]), 0.25)


def test_a_foreign_region_is_refused() -> None:
    with pytest.raises(MapError, match="found a set"):
        as_region({1, 2})
