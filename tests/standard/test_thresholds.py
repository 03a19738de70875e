"""Verifying: when a merge is kept, confirmed or reverted, and the numbers in the reason."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import ConfigError, Measurement, PluginError, Sample
from mapgraft_standard.thresholds import Thresholds

REVERSALS = ("ledger", "multi_map", "single_map")
VERIFIER = Thresholds(metrics={"similarity": {"min": 0.9}}, patience=3, confirm_after=20, new_support=0.1)


def sample(
    value: float, observations: int = 0, support: int = 100, name: str = "similarity", **details: float
) -> Sample:
    return Sample(observations, observations, {name: Measurement(name, value, "1", support, "higher", details)})


def history(values: Sequence[float], growth: int = 10) -> list[Sample]:
    return [sample(value, 10 * n, 100 + growth * n) for n, value in enumerate(values)]


def test_nothing_measured_is_kept() -> None:
    assert VERIFIER.verify([], "ledger").action == "keep"


@pytest.mark.parametrize(
    ("values", "action"),
    [
        ([0.95], "keep"),
        ([0.8], "keep"),
        ([0.95, 0.8, 0.8], "keep"),
        ([0.8, 0.8, 0.8], "revert"),
        ([0.95, 0.8, 0.8, 0.8], "revert"),
        ([0.8, 0.8, 0.95, 0.8], "keep"),
        ([0.95, 0.95], "keep"),
        ([0.95, 0.95, 0.95], "confirm"),
        ([0.8, 0.95, 0.95, 0.95], "confirm"),
        ([0.95, 0.95, 0.8, 0.95], "keep"),
        ([0.8, 0.8, math.nan], "keep"),
        ([0.8, 0.8, math.nan, 0.8], "revert"),
        ([0.8, 0.8, 0.8, math.nan], "keep"),
        ([math.nan] * 9, "keep"),
        ([0.95, 0.95, math.nan, 0.95], "keep"),
    ],
)
def test_patience(values: list[float], action: str) -> None:
    assert VERIFIER.verify(history(values), "ledger").action == action


def test_reasons_name_numbers_and_limits() -> None:
    reverted = VERIFIER.verify(history([0.8] * 4), "ledger").reason
    assert "similarity 0.8 < 0.9" in reverted and "4 samples in a row" in reverted
    kept = VERIFIER.verify(history([0.95], growth=0), "ledger").reason
    assert all(said in kept for said in ("similarity 0.95 ≥ 0.9", "0 of 20 observations", "0 of 10 %"))
    confirmed = VERIFIER.verify(history([0.95] * 4), "ledger").reason
    assert "30 observations" in confirmed and "+30 %" in confirmed


def test_it_tells_the_limits_in_force() -> None:
    assert VERIFIER.verify(history([0.95]), "ledger").evidence == {
        "similarity.revert_at": 0.9,
        "similarity.confirm_at": 0.9,
    }
    asked = {"similarity": {"min": 0.5, "max": 0.9, "details": {"free": {"min": 0.2}}}}
    verifier = Thresholds(metrics=asked, patience=1, confirm_after=None)
    assert verifier.verify([sample(0.4, free=0.5)], "ledger").evidence == {
        "similarity.revert_at.min": 0.5,
        "similarity.revert_at.max": 0.9,
        "similarity.free.revert_at": 0.2,
    }
    assert Thresholds(patience=1).verify([sample(0.8, limit=0.9)], "ledger").evidence["similarity.revert_at"] == 0.9


def test_a_confirmation_rests_on_new_support() -> None:
    """What the transform was chosen on cannot test it."""
    assert VERIFIER.verify(history([0.95] * 30, growth=0), "ledger").action == "keep"
    assert VERIFIER.verify([*history([0.95] * 30, growth=0), sample(0.95, 300, 110)], "ledger").action == "confirm"


def test_too_little_support_judges_nothing() -> None:
    verifier = Thresholds(metrics={"similarity": {"min": 0.9, "support_min": 1000}}, confirm_after=0, new_support=0)
    for values in ([0.1] * 9, [0.95] * 9):
        verdict = verifier.verify(history(values), "ledger")
        assert verdict.action == "keep" and "< 1000" in verdict.reason


def test_one_metric_suffices_to_revert_and_all_are_needed_to_confirm() -> None:
    verifier = Thresholds(metrics={"a": {"min": 0.9}, "b": {"min": 0.5}}, patience=2, confirm_after=0, new_support=0)

    def both(a: float, b: float) -> list[Sample]:
        one, other = sample(a, name="a").measurements, sample(b, name="b").measurements
        return [Sample(n, n, {**one, **other}) for n in range(2)]

    actions = [
        verifier.verify(both(*values), "ledger").action for values in ((0.95, 0.6), (0.95, 0.4), (0.95, math.nan))
    ]
    assert actions == ["confirm", "revert", "keep"]


def test_a_reversal_may_have_limits_of_its_own() -> None:
    verifier = Thresholds(
        metrics={"similarity": {"min": 0.9}},
        patience=2,
        confirm_after=0,
        reversals={"single_map": {"metrics": {"similarity": {"min": 0.97}}, "new_support": 0, "patience": 3}},
    )
    seen = history([0.95] * 3, growth=0)
    assert [verifier.verify(seen, name).action for name in REVERSALS] == ["keep", "keep", "revert"]
    assert [verifier.verify(seen[:2], name).action for name in REVERSALS] == ["keep", "keep", "keep"]
    merged = history([0.98] * 3, growth=0)
    assert [verifier.verify(merged, name).action for name in REVERSALS] == ["keep", "keep", "confirm"]


def test_without_metrics_those_that_name_a_limit_are_judged() -> None:
    verifier = Thresholds(patience=1)
    judged = [sample(0.8, limit=0.9)]
    unjudged = Measurement("anything", 0.0, "1", 1, "higher")
    with_more = [Sample(0, 0, {**judged[0].measurements, "anything": unjudged})]
    assert verifier.verify(with_more, "ledger").action == "revert"
    with pytest.raises(ConfigError, match="limits under `metrics`"):
        verifier.verify([Sample(0, 0, {"anything": unjudged})], "ledger")


values = st.one_of(st.just(math.nan), st.floats(0, 1))


@given(st.lists(values, min_size=1, max_size=12), st.sampled_from(REVERSALS))
def test_no_measurement_no_verdict(seen: list[float], reversal: str) -> None:
    """Whatever came before, a sample without a value neither confirms nor reverts."""
    assert VERIFIER.verify([*history(seen), sample(math.nan, 900, 900)], reversal).action == "keep"


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_a_better_history_is_never_judged_worse(seen: list[float]) -> None:
    rank = {"revert": 0, "keep": 1, "confirm": 2}
    better = [min(1.0, value + 0.2) for value in seen]
    worse, best = (VERIFIER.verify(history(h), "ledger").action for h in (seen, better))
    assert rank[worse] <= rank[best]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"patience": 0}, "patience >= 1"),
        ({"new_support": -1}, "new_support >= 0"),
        ({"confirm_after": "soon"}, "confirm_after must be a number, found 'soon'"),
        ({"reversals": {"book": {}}}, "ledger, multi_map, single_map, found"),
        (
            {"reversals": {"ledger": {"every": 3}}},
            "may replace metrics, patience, .*, found every",
        ),
        ({"metrics": {"similarity": {"most": 3}}}, "found most"),
    ],
)
def test_faulty_options_are_refused(options: Mapping[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Thresholds(**options)


def test_what_the_engine_must_keep() -> None:
    with pytest.raises(PluginError, match="'book'"):
        VERIFIER.verify(history([0.9]), "book")
    with pytest.raises(PluginError, match="similarity was not measured"):
        VERIFIER.verify([sample(0.9, name="distance")], "ledger")
