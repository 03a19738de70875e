"""Rates, regressions and probabilities, against laws and against each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.calibrate.rates import Rate, above
from mapgraft.calibrate.regression import brier, log_loss, logistic, probability_curve, reliability
from mapgraft.evaluation.statistics import clopper_pearson

truth = st.lists(st.tuples(st.floats(-20.0, 20.0), st.booleans()), min_size=2, max_size=400)


@given(st.integers(0, 60), st.integers(1, 60))
def test_exact_intervals_hold_the_rate_and_mirror(count: int, more: int) -> None:
    of = count + more
    rate, other = Rate.counted(count, of), Rate.counted(more, of)
    assert rate.low <= rate.value <= rate.high
    assert (rate.low, rate.high) == pytest.approx((1.0 - other.high, 1.0 - other.low), abs=1e-12)
    if count == 0:
        assert (rate.low, rate.high) == pytest.approx(clopper_pearson(0, of))


def test_exact_intervals_are_those_of_the_tables() -> None:
    rate = Rate.counted(5, 100)
    assert (rate.low, rate.high) == pytest.approx((0.01643, 0.11283), abs=1e-5)
    assert math.isnan(Rate.counted(0, 0).value)
    with pytest.raises(ValueError, match="3 of 2"):
        Rate.counted(3, 2)


@given(st.integers(0, 30), st.integers(1, 30), st.floats(0.01, 0.9))
def test_more_wrong_ones_are_less_probable(count: int, more: int, rate: float) -> None:
    of = count + more
    exact = sum(math.comb(of, k) * rate**k * (1.0 - rate) ** (of - k) for k in range(count, of + 1))
    assert above(count, of, rate) == pytest.approx(exact, abs=1e-9)


def test_coefficients_are_found_and_never_negative() -> None:
    rng = np.random.default_rng(3)
    features = rng.normal(size=(4000, 3))
    log_odds = 1.5 * features[:, 0] - 0.7 * features[:, 1] + 0.5
    right = rng.random(4000) < 1.0 / (1.0 + np.exp(-log_odds))
    coefficients, intercept = logistic(features, right, np.ones(4000))
    assert coefficients[1] == 0.0
    assert coefficients[0] == pytest.approx(1.4, abs=0.2)  # a little flatter without the second one
    assert intercept == pytest.approx(0.45, abs=0.15)
    heavier, _ = logistic(np.repeat(features, 2, axis=0), np.repeat(right, 2), np.full(8000, 0.5))
    assert heavier == pytest.approx(coefficients, abs=1e-4)


@settings(deadline=None, max_examples=40)
@given(truth)
def test_probabilities_never_fall_with_the_score(told: list[tuple[float, bool]]) -> None:
    scores, right = np.array([s for s, _ in told]), np.array([r for _, r in told])
    curve = probability_curve(scores, right)
    said = curve.at(np.linspace(-25.0, 25.0, 60))
    assert ((said >= 0.0) & (said <= 1.0)).all()
    assert (np.diff(said) >= -1e-12).all()


@settings(deadline=None, max_examples=15)
@given(st.floats(0.05, 0.95))
def test_the_score_at_which_a_probability_is_reached(probability: float) -> None:
    rng = np.random.default_rng(5)
    for count in (100, 400):
        scores = rng.normal(size=count)
        curve = probability_curve(scores, rng.random(count) < 1.0 / (1.0 + np.exp(-3.0 * scores)))
        at = curve.reaches(probability)
        assert math.isinf(at) or curve.at([at + 1e-9])[0] >= probability - 1e-6


def test_many_scores_make_steps_and_few_a_curve() -> None:
    rng = np.random.default_rng(1)
    scores = rng.normal(size=1000)
    right = rng.random(1000) < 1.0 / (1.0 + np.exp(-2.0 * scores))
    assert probability_curve(scores[:150], right[:150]).kind == "logistic"
    curve = probability_curve(scores, right)
    assert curve.kind == "steps"
    assert brier(curve.at(scores), right) < brier(np.full(1000, right.mean()), right)


def test_bins_hold_everything_once() -> None:
    rng = np.random.default_rng(2)
    said = rng.random(203)
    right = rng.random(203) < said
    bins = reliability(said, right)
    assert (sum(one.of for one in bins), sum(one.right for one in bins)) == (203, int(right.sum()))
    assert [one.said for one in bins] == sorted(one.said for one in bins)


def test_honest_probabilities_lose_least() -> None:
    right = np.array([True] * 3 + [False])
    for loss in (brier, log_loss):
        assert loss(np.full(4, 0.75), right) < min(loss(np.full(4, p), right) for p in (0.5, 0.65, 0.85, 0.99))
    assert math.isnan(brier([], []))
