"""The threshold of acceptance where scores, or what mistakes cost, go to extremes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.calibrate import Asked, Labelled, Labels, calibrate
from mapgraft.calibrate.acceptance import acceptance, cost_floor
from mapgraft.calibrate.page import page_of
from mapgraft.calibrate.regression import Curve
from mapgraft.calibrate.scoring import single
from mapgraft.calibrate.table import rules_text
from mapgraft.commands.calibrate import row
from mapgraft.decision import Rule

Make = Callable[..., list[Labelled]]


@pytest.mark.parametrize("count", [60, 400])  # a logistic curve, and steps
@pytest.mark.parametrize("cost", [1e9, 1e17, 1e308])
def test_costs_that_no_label_is_sure_enough_for_accept_nothing_and_say_so(
    made: Make, installed: list[Rule], count: int, cost: float
) -> None:
    labels = Labels(made("a", count, 1) + made("b", count, 2))
    found = calibrate(labels, installed, Asked(0.02, cost_false_accept=cost))
    fit, text = found.rules[0].fits[0], rules_text(found)
    assert fit.accept.missing == 0
    if math.isinf(fit.accept.value):
        assert "no label is as sure as the costs ask" in row(fit)[1]
        assert "Accepts nothing: no label is as sure as the costs ask." in " ".join(text.split())
        assert "no label is as sure as the costs ask" in page_of(found)
    assert "above inf" not in text
    assert ("accept_above" in text) == math.isfinite(fit.accept.value)
    assert math.isinf(fit.accept.value) or cost < 1e17


@given(st.floats(1e-300, 1e300), st.floats(1e-300, 1e300), st.floats(1e-6, 1e6), st.floats(-1e6, 1e6))
def test_a_score_whose_probability_is_worth_a_mistake_has_a_floor_for_any_costs(
    cost: float, miss: float, slope: float, offset: float
) -> None:
    floors = [
        cost_floor(curve, cost, miss).value
        for curve in (Curve("logistic", slope, offset), Curve("steps", scores=(0.0, 1.0), probabilities=(0.1, 0.9)))
    ]
    assert not any(math.isnan(floor) for floor in floors)


@pytest.mark.parametrize(("high", "share"), [(math.inf, 0.1), (1e306, 0.1), (math.inf, 0.001)])
def test_wrong_ones_of_the_highest_score_are_not_accepted(made: Make, high: float, share: float) -> None:
    rest = made("a", 1000, 1, share=0.0)
    scores = [high if n < share * len(rest) else e.numbers["score"] for n, e in enumerate(rest)]
    examples = [dataclasses.replace(e, numbers={"margin": score}) for e, score in zip(rest, scores, strict=True)]
    limit = acceptance(examples, single("margin"), examples[0].group, 0.02)
    taken = sum(limit.passes(score) for score in scores)
    assert taken <= 0.02 * len(scores)
    assert not limit.passes(high) or share < 0.02
    assert bool(limit.refusal) == math.isinf(limit.value)
