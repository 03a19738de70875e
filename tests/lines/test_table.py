"""The table of evidence: adding row by row, in whatever order and however much at once."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft_lines.table import Table

rows = st.dictionaries(st.integers(-20, 20), st.tuples(st.integers(1, 9), st.integers(-99, 99)), max_size=9)
keys = st.sets(st.integers(-20, 20), max_size=12)
Rows = dict[int, tuple[int, int]]


def table(given: Rows) -> Table:
    ordered = sorted(given)
    return Table(np.array(ordered, np.int64), np.array([given[key] for key in ordered], np.int64).reshape(-1, 2))


def as_dict(of: Table) -> dict[int, tuple[int, ...]]:
    assert (np.diff(of.keys) > 0).all()
    return {int(key): tuple(row) for key, row in zip(of.keys, of.counts.tolist(), strict=True)}


def total(parts: list[tuple[Rows, int]]) -> dict[int, tuple[int, ...]]:
    out: dict[int, tuple[int, ...]] = {}
    for part, times in parts:
        for key, row in part.items():
            out[key] = tuple(a + times * b for a, b in zip(out.get(key, (0, 0)), row, strict=True))
    return out


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(rows, st.integers(1, 3), st.booleans()), max_size=12), keys)
def test_tables_add_row_by_row(parts: list[tuple[Rows, int, bool]], some: set[int]) -> None:
    added, before = Table.empty(2), []
    for part, times, asked in parts:
        before.append((added, added.plus(table(part), times)))
        added = before[-1][1]
        if asked:  # puts the runs together, which changes nothing
            assert len(added) == len(added.keys)
    expected = total([(part, times) for part, times, _ in parts])
    chosen = np.array(sorted(some), np.int64)
    assert [tuple(row) for row in added.at(chosen).tolist()] == [expected.get(key, (0, 0)) for key in sorted(some)]
    assert added.is_empty == (not expected)
    assert as_dict(added) == expected
    assert as_dict(added.without(chosen)) == {key: row for key, row in expected.items() if key not in some}
    for n, (earlier, _) in enumerate(before):  # what was added to is as it was
        assert as_dict(earlier) == total([(part, times) for part, times, _ in parts[:n]])


def test_many_small_additions_make_few_runs() -> None:
    """A row is put together with others as often as the logarithm of their number, not at every addition."""
    random = np.random.default_rng(3)
    added, expected = Table.empty(1), np.zeros(100_000, np.int64)
    for _ in range(300):
        picked = np.unique(random.integers(0, 100_000, 40))
        added = added.plus(Table(picked, np.ones((len(picked), 1), np.int64)))
        expected[picked] += 1
        sizes = [len(run.keys) for run in added._runs]
        assert all(large >= 2 * small for large, small in itertools.pairwise(sizes))
    assert np.array_equal(added.keys, np.flatnonzero(expected))
    assert np.array_equal(added.counts[:, 0], expected[expected > 0])


def test_sums_take_the_most_of_one_column() -> None:
    found = Table.summed(np.array([5, 2, 5]), np.array([[1, 10], [4, 20], [3, 30]]), most=0)
    assert as_dict(found) == {2: (4, 20), 5: (3, 40)}


def test_rows_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        table({1: (1, 0)}).counts[0, 0] = 2
