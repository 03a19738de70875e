"""Split-conformal thresholds: they keep what they promise, and promise nothing where labels are too few."""

from __future__ import annotations

import math
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.calibrate.conformal import best_rate, needed, threshold

scores = st.lists(st.floats(-100.0, 100.0), min_size=1, max_size=60)
rates = st.sampled_from([0.001, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 0.9])


@pytest.mark.parametrize(("rate", "count"), [(0.05, 19), (0.01, 99), (0.001, 999), (0.5, 1), (0.3, 3)])
def test_so_many_labels_are_needed_and_no_more(rate: float, count: int) -> None:
    assert needed(rate) == count
    assert threshold(range(count), rate) == count - 1
    assert threshold(range(count - 1), rate) == math.inf
    assert best_rate(count) <= rate < best_rate(count - 1)


@given(scores, rates)
def test_it_is_the_nth_smallest(values: list[float], rate: float) -> None:
    place = math.ceil(round((1 - rate) * (len(values) + 1), 9))
    assert threshold(values, rate) == (math.inf if place > len(values) else sorted(values)[place - 1])


@given(scores, rates, st.randoms(use_true_random=False))
def test_the_order_of_labels_makes_no_difference(values: list[float], rate: float, random: Random) -> None:
    shuffled = list(values)
    random.shuffle(shuffled)
    assert threshold(shuffled, rate) == threshold(values, rate)


@given(scores)
def test_a_stricter_rate_never_lowers_it(values: list[float]) -> None:
    found = [threshold(values, rate) for rate in (0.5, 0.2, 0.1, 0.05, 0.02, 0.01)]
    assert all(loose <= strict for loose, strict in pairwise(found))


@given(scores, rates, st.floats(0.0, 50.0))
def test_higher_scores_never_lower_it(values: list[float], rate: float, more: float) -> None:
    assert threshold([value + more for value in values], rate) >= threshold(values, rate)


@given(scores, rates)
def test_what_cannot_be_told_counts_as_the_worst(values: list[float], rate: float) -> None:
    assert threshold([*values, math.nan], rate) == threshold([*values, math.inf], rate) >= threshold(values, rate)


@given(scores, rates)
def test_units_of_one_are_no_units(values: list[float], rate: float) -> None:
    assert threshold(values, rate, range(len(values))) == threshold(values, rate)


@given(st.lists(st.tuples(st.floats(-9.0, 9.0), st.integers(1, 5)), min_size=1, max_size=20), rates)
def test_repeating_what_one_unit_says_makes_no_difference(units: list[tuple[float, int]], rate: float) -> None:
    values = [value for value, times in units for _ in range(times)]
    names = [number for number, (_, times) in enumerate(units) for _ in range(times)]
    assert threshold(values, rate, names) == threshold([value for value, _ in units], rate)


@pytest.mark.parametrize(("rate", "count"), [(0.1, 30), (0.05, 99), (0.01, 150)])
def test_a_further_score_is_above_it_as_often_as_promised_and_not_much_less(rate: float, count: int) -> None:
    rng = np.random.default_rng(7)
    trials = 2500
    above = sum(rng.standard_t(2) > threshold(rng.standard_t(2, count), rate) for _ in range(trials))
    exact = 1.0 - math.ceil((1 - rate) * (count + 1)) / (count + 1)
    assert exact <= rate + 1e-12
    assert above / trials == pytest.approx(exact, abs=4.0 * math.sqrt(rate / trials))


def test_units_keep_the_promise_where_scores_of_a_unit_hang_together() -> None:
    rng = np.random.default_rng(11)
    rate, trials, by_units, by_scores = 0.1, 500, 0, 0
    for _ in range(trials):
        middles, sizes = rng.normal(0.0, 3.0, 31), rng.integers(1, 40, 31)
        values = np.concatenate([rng.normal(m, 0.3, n) for m, n in zip(middles[:-1], sizes[:-1], strict=True)])
        names = np.repeat(np.arange(30), sizes[:-1]).tolist()
        further = rng.normal(middles[-1], 0.3)
        by_units += further > threshold(values, rate, names)
        by_scores += further > threshold(values, rate)
    assert by_units / trials <= rate + 3.0 * math.sqrt(rate / trials)
    assert by_scores > by_units  # taking them for independent promises too much


def test_nothing_at_all_promises_nothing() -> None:
    assert threshold([], 0.5) == math.inf
