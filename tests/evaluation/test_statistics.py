"""Shares, areas and their intervals against brute force and against scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest, mannwhitneyu

from mapgraft.evaluation.statistics import area, clopper_pearson, resampled, share, spread

SEEDS = st.integers(0, 2**32 - 1)


def brute_area(values: np.ndarray, right: np.ndarray, weights: np.ndarray) -> float:
    """Every right thing against every wrong one."""
    won = both = 0.0
    for i in np.flatnonzero(right):
        for j in np.flatnonzero(~right):
            pair = weights[i] * weights[j]
            won += pair * (1.0 if values[i] > values[j] else 0.5 if values[i] == values[j] else 0.0)
            both += pair
    return won / both if both else math.nan


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(2, 25), st.sampled_from([2, 5, 1000]))
def test_the_area_is_the_share_of_pairs_that_are_won(seed, n, levels):
    rng = np.random.default_rng(seed)
    values = rng.integers(0, levels, n).astype(float)
    values[rng.random(n) < 0.1] = math.inf
    right = rng.random(n) < 0.5
    if right.all() or not right.any():
        right[0] = not right[0]
    weights = rng.integers(0, 3, (40, n)).astype(float)
    found = area(values, right, weights, "higher")
    assert found.value == pytest.approx(brute_area(values, right, np.ones(n)))
    statistic = mannwhitneyu(np.minimum(values[right], 1e9), np.minimum(values[~right], 1e9)).statistic
    assert found.value == pytest.approx(statistic / (right.sum() * (~right).sum()))
    resampled_areas = [a for w in weights if not math.isnan(a := brute_area(values, right, w))]
    if resampled_areas:
        low, high = np.quantile(resampled_areas, (0.025, 0.975)).tolist()
        if low == high:
            bound = 0.025 ** (1.0 / min(right.sum(), (~right).sum()))
            low, high = bound * found.value, 1.0 - bound * (1.0 - found.value)
        assert (found.low, found.high) == pytest.approx((low, high))
    assert (found.right, found.wrong) == (right.sum(), (~right).sum())
    lower = area(values, right, weights, "lower")
    assert (lower.better, lower.told) == ("lower", True)
    assert lower.value == pytest.approx(brute_area(-values, right, np.ones(n)))
    assert (lower.low, lower.high) == pytest.approx((1.0 - found.high, 1.0 - found.low), nan_ok=True)
    either = area(values, right, weights)
    assert not either.told and either.value == max(found.value, lower.value)
    assert either.better == ("lower" if lower.value > found.value else "higher")


def test_the_area_leaves_out_what_was_not_measured():
    weights = np.ones((10, 5))
    found = area([3.0, math.nan, 1.0, math.nan, 2.0], [True, True, False, False, True], weights)
    assert (found.right, found.wrong, found.value) == (2, 1, 1.0)
    for right in ([True] * 5, [False] * 5):
        nothing = area([1.0, 2.0, 3.0, 4.0, 5.0], right, weights)
        assert math.isnan(nothing.value) and math.isnan(nothing.low)
        assert nothing.right + nothing.wrong == 5


@pytest.mark.parametrize(
    ("right", "wrong", "bound"), [(1, 1, 0.025), (2, 10, 0.158), (12, 12, 0.735), (300, 40, 0.912)]
)
def test_an_area_that_no_resample_can_change_is_as_sure_as_its_counts_allow(right, wrong, bound):
    is_right = np.arange(right + wrong) < right
    weights = resampled(np.arange(right + wrong), 0)
    best = area(np.where(is_right, 2.0, 1.0), is_right, weights, "higher")
    assert (best.value, best.high) == (1.0, 1.0) and best.low == pytest.approx(bound, abs=1e-3)
    worst = area(np.where(is_right, 1.0, 2.0), is_right, weights, "higher")
    assert (worst.value, worst.low) == (0.0, 0.0) and worst.high == pytest.approx(1.0 - bound, abs=1e-3)
    tied = area(np.ones(right + wrong), is_right, weights, "higher")
    assert (tied.low, tied.high) == pytest.approx((bound / 2.0, 1.0 - bound / 2.0), abs=1e-3)


def test_the_interval_of_a_perfect_area_holds_the_truth_about_as_often_as_it_says():
    """Of numbers that tell in 0.85 of all pairs, few things often look as if they always told."""
    rng = np.random.default_rng(5)
    missed = 0
    for seed in range(300):
        is_right = np.arange(10) < 4
        found = area(rng.normal(1.4657 * is_right), is_right, resampled(np.arange(10), seed, 50), "higher")
        missed += found.value == 1.0 and found.low > 0.85
    assert missed <= 15  # of 300


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(1, 30))
def test_a_share_is_counted_and_its_interval_is_that_of_the_resamples(seed, n):
    rng = np.random.default_rng(seed)
    hits, among = rng.random(n) < 0.4, rng.random(n) < 0.7
    weights = rng.integers(0, 3, (50, n)).astype(float)
    found = share(hits, among, weights)
    count, of = int((hits & among).sum()), int(among.sum())
    assert (found.count, found.of) == (count, of)
    if of == 0:
        assert math.isnan(found.value) and math.isnan(found.low) and math.isnan(found.high)
    elif count in (0, of):
        exact = binomtest(count, of).proportion_ci(0.95, "exact")
        assert (found.low, found.high) == pytest.approx((exact.low, exact.high))
    else:
        drawn = [w[hits & among].sum() / w[among].sum() for w in weights if w[among].sum() > 0]
        expected = tuple(np.quantile(drawn, (0.025, 0.975))) if drawn else (math.nan, math.nan)
        assert (found.low, found.high) == pytest.approx(expected, nan_ok=True)


def test_the_exact_interval_is_for_none_or_all():
    assert clopper_pearson(0, 100) == pytest.approx((0.0, 0.0362167), abs=1e-6)
    for count, of in ((1, 2), (0, 0), (3, 2)):
        with pytest.raises(ValueError, match="none or all"):
            clopper_pearson(count, of)


def test_things_of_one_block_are_drawn_together():
    blocks = np.array([[7, 3], [3, 7], [7, 7], [1, 1]])
    weights = resampled(blocks, seed=1, resamples=200)
    assert weights.shape == (200, 4)
    assert np.array_equal(weights[:, 0], weights[:, 1])
    seven, one = np.sqrt(weights[:, 2]), np.sqrt(weights[:, 3])
    assert np.array_equal(seven, np.round(seven)) and np.array_equal(one, np.round(one))
    three = np.divide(weights[:, 0], seven, out=3.0 - one, where=seven > 0)
    assert np.array_equal(seven + three + one, np.full(200, 3.0))


def test_resampling_goes_by_the_seed_and_by_nothing_else():
    blocks = np.arange(30) // 3
    assert np.array_equal(resampled(blocks, 4), resampled(blocks, 4))
    assert np.array_equal(resampled(blocks, 4), resampled(blocks * 10 + 2, 4))
    assert not np.array_equal(resampled(blocks, 4), resampled(blocks, 5))
    assert resampled(np.empty((0, 2)), 4).shape == (1000, 0)


def test_intervals_hold_the_truth_about_as_often_as_they_say():
    """Blocks of ten things that are right or wrong together: as if there were a tenth of them, they must be wide."""
    held = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        of_block = rng.random(40) < 0.3
        hits = np.repeat(of_block, 10)
        found = share(hits, np.ones(400, bool), resampled(np.repeat(np.arange(40), 10), seed, 300))
        held += found.low <= 0.3 <= found.high
    assert 175 <= held <= 199  # of 200


def test_a_spread_is_the_median_and_the_95th_percentile():
    found = spread([*range(101), math.nan])
    assert (found.count, found.median, found.p95, found.largest) == (101, 50.0, 95.0, 100.0)
    assert spread([]).count == 0 and math.isnan(spread([math.nan]).median)
