"""How far annotators agree, against numbers that others have computed, and the laws of kappa."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mapgraft.annotate.agreement import MOST_COMPARED, agreement, agreements, mean_kappa

SAID = arrays(np.int8, 40, elements=st.integers(0, 3))


def said(*counts: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """What two said, from (what one said, what the other said, how often)."""
    one = np.concatenate([np.full(times, first) for first, _, times in counts]).astype(np.int8)
    other = np.concatenate([np.full(times, second) for _, second, times in counts]).astype(np.int8)
    return one, other


def test_a_table_that_is_worked_out_in_textbooks():
    """20 yes/yes, 15 no/no, 5 and 10 apart: 0.7 observed, 0.5 by chance."""
    found = agreement("anna", "bob", *said((1, 1, 20), (1, 2, 5), (2, 1, 10), (2, 2, 15)))
    assert (found.both, found.same) == (50, 35)
    assert found.kappa == pytest.approx(0.4)


def test_three_categories():
    """Observed 58 of 200; by chance (100 · 90 + 60 · 50 + 40 · 60) / 200² = 0.36."""
    table = ((50, 26, 24), (24, 4, 32), (16, 20, 4))
    counts = [(1 + row, 1 + column, times) for row, line in enumerate(table) for column, times in enumerate(line)]
    assert agreement("a", "b", *said(*counts)).kappa == pytest.approx((0.29 - 0.36) / (1.0 - 0.36))


def test_only_what_both_have_judged_counts():
    one, other = said((1, 1, 3), (2, 2, 3), (1, 0, 9), (0, 2, 9))
    found = agreement("anna", "bob", one, other)
    assert (found.both, found.same, found.kappa) == (6, 6, 1.0)


@pytest.mark.parametrize("counts", [((0, 1, 5),), ((1, 1, 5),)], ids=["nothing in common", "one word of everything"])
def test_where_chance_explains_all_there_is_no_kappa(counts):
    assert agreement("anna", "bob", *said(*counts)).kappa is None


@given(SAID, SAID)
def test_laws(one, other):
    found = agreement("a", "b", one, other)
    turned = agreement("b", "a", other, one)
    assert (found.both, found.same, found.kappa) == (turned.both, turned.same, turned.kappa)
    assert 0 <= found.same <= found.both <= 40
    if found.kappa is not None:
        assert -1.0 <= found.kappa <= 1.0
        assert (found.kappa == 1.0) == (found.same == found.both)


@given(SAID, SAID, st.permutations([1, 2, 3]))
def test_what_the_categories_are_called_does_not_matter(one, other, names):
    renamed = np.array([0, *names], np.int8)
    assert agreement("a", "b", renamed[one], renamed[other]).kappa == agreement("a", "b", one, other).kappa


def test_pairs_of_three_and_their_mean():
    one, other = said((1, 1, 20), (1, 2, 5), (2, 1, 10), (2, 2, 15))
    found = agreements({"anna": one, "bob": other, "carl": one}, "carl")
    assert [(pair.one, pair.other) for pair in found] == [("carl", "anna"), ("carl", "bob"), ("anna", "bob")]
    assert mean_kappa(found) == pytest.approx((1.0 + 0.4 + 0.4) / 3)
    assert mean_kappa(()) is None


def test_of_many_annotators_those_who_said_most_are_compared():
    codes = {f"name {n:02d}": np.repeat(np.array([1, 0], np.int8), [n, 40 - n]) for n in range(30)}
    found = agreements(codes, "name 00")
    names = {name for pair in found for name in (pair.one, pair.other)}
    assert names == {"name 00", *(f"name {n}" for n in range(31 - MOST_COMPARED, 30))}
