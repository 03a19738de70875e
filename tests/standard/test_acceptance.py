"""Accepting: the verdict, whom it chooses, and the numbers in its reason."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import Candidate, ConfigError, Match, Measurement, PluginError, Transform
from mapgraft_standard.acceptance import Thresholds


def measurement(
    name: str, value: float, support: int = 100, better: Literal["higher", "lower"] = "higher", **details: float
) -> Measurement:
    return Measurement(name, value, "1", support, better, details)


def candidate(score: float, margin: float, *measurements: Measurement, **evidence: float) -> Candidate:
    match = Match(Transform.identity(), score, margin, evidence=evidence)
    return Candidate(match, {m.name: m for m in measurements})


def similarity(value: float, support: int = 100, **details: float) -> Measurement:
    return measurement("similarity", value, support, **details)


STRICT = Thresholds(score_min=0.9, margin_min=0.02, metrics={"similarity": {"min": 0.9, "support_min": 50}})


def test_the_first_that_keeps_every_limit_is_taken() -> None:
    decision = STRICT.accept(
        [
            candidate(0.97, 0.01, similarity(0.85)),
            candidate(0.96, -0.01, similarity(0.93)),
            candidate(0.80, -0.17, similarity(0.99)),
        ]
    )
    assert decision.verdict == "provisional" and decision.chosen == 1
    assert "candidate 2 of 3" in decision.reason and "similarity 0.93 ≥ 0.9" in decision.reason


def test_two_that_pass_with_too_little_between_them_are_ambiguous() -> None:
    decision = STRICT.accept([candidate(0.97, 0.01, similarity(0.95)), candidate(0.96, -0.01, similarity(0.94))])
    assert decision.verdict == "ambiguous" and decision.chosen is None
    for said in ("candidates 1 and 2", "margin 0.01 < 0.02", "0.97", "0.96"):
        assert said in decision.reason


@pytest.mark.parametrize(
    "other",
    [candidate(0.96, -0.01, similarity(0.85)), candidate(0.9, -0.07, similarity(0.95))],
    ids=["the rival breaks a limit", "the other one that passes is far behind"],
)
def test_a_small_margin_alone_is_not_ambiguous(other: Candidate) -> None:
    assert STRICT.accept([candidate(0.97, 0.01, similarity(0.95)), other]).verdict == "provisional"


def test_an_infinite_margin_beats_a_higher_score_of_what_is_no_rival() -> None:
    lone = candidate(0.95, math.inf, similarity(0.95))
    assert STRICT.accept([lone, candidate(0.96, 0.01, similarity(0.95))]).chosen == 0


def test_nothing_that_passes_is_unmatched_with_every_reason() -> None:
    decision = STRICT.accept(
        [
            candidate(0.8, 0.1, similarity(0.7)),
            candidate(0.95, -0.1, similarity(math.nan, 3)),
            candidate(0.95, -0.1, similarity(0.99, 10)),
        ]
    )
    assert decision.verdict == "unmatched" and decision.chosen is None
    for said in (
        "none of 3",
        "candidate 1: score 0.8 < 0.9, similarity 0.7 < 0.9",
        "candidate 2: similarity cannot be measured with a support of 3",
        "candidate 3: similarity rests on a support of 10 < 50",
    ):
        assert said in decision.reason


def test_no_candidate_is_unmatched() -> None:
    decision = STRICT.accept([])
    assert (decision.verdict, decision.chosen) == ("unmatched", None) and "no hypothesis" in decision.reason


def test_without_limits_the_best_is_taken() -> None:
    assert Thresholds().accept([candidate(0.1, 0.0), candidate(0.1, 0.0)]).chosen == 0


def test_metrics_may_name_their_own_limit() -> None:
    acceptor = Thresholds(metrics={"similarity": {}, "distance": None})
    high = similarity(0.95, limit=0.9)

    def verdict(distance: float) -> str:
        low = measurement("distance", distance, better="lower", limit=4.9)
        return acceptor.accept([candidate(1.0, 1.0, high, low)]).verdict

    assert verdict(4.9) == "provisional" and verdict(5.0) == "unmatched"
    with pytest.raises(ConfigError, match="names no limit of its own"):
        acceptor.accept([candidate(1.0, 1.0, similarity(0.95), measurement("distance", 1.0))])


def test_details_and_evidence_are_bounded() -> None:
    acceptor = Thresholds(
        evidence={"walls": {"min": 40}, "scale": {"min": 0.9, "max": 1.1}},
        metrics={"similarity": {"min": 0.9, "details": {"overlap_m2": {"min": 10}}}},
    )

    def verdict(overlap_m2: float, walls: float, scale: float) -> str:
        found = similarity(0.95, overlap_m2=overlap_m2)
        return acceptor.accept([candidate(1.0, 1.0, found, walls=walls, scale=scale)]).verdict

    assert verdict(10, 40, 1.1) == "provisional"
    assert {verdict(9, 40, 1.0), verdict(10, 39, 1.0), verdict(10, 40, 1.2), verdict(math.nan, 40, 1)} == {"unmatched"}
    with pytest.raises(ConfigError, match="no evidence 'walls', it gives beams"):
        acceptor.accept([candidate(1.0, 1.0, similarity(0.95), beams=3)])


def test_a_metric_that_was_not_measured_is_the_engines_fault() -> None:
    with pytest.raises(PluginError, match="similarity was not measured"):
        STRICT.accept([candidate(0.95, 0.1)])


numbers = st.floats(0, 1)


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=5), numbers, numbers)
def test_whoever_is_chosen_keeps_the_limits(values: list[tuple[float, float]], score_min: float, least: float) -> None:
    values.sort(reverse=True)
    second = values[1][0] if len(values) > 1 else -math.inf
    candidates = [
        candidate(score, score - (second if n == 0 else values[0][0]), similarity(value))
        for n, (score, value) in enumerate(values)
    ]
    decision = Thresholds(score_min=score_min, metrics={"similarity": {"min": least}}).accept(candidates)
    passing = [n for n, (score, value) in enumerate(values) if score >= score_min and value >= least]
    assert (decision.chosen is None) == (decision.verdict != "provisional")
    if decision.chosen is not None:
        assert decision.chosen == passing[0]
    assert (decision.verdict == "unmatched") == (not passing)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"score_min": "high"}, "score_min must be a number, found 'high'"),
        ({"margin_min": -0.1}, "margin_min >= 0"),
        ({"metrics": {"similarity": {"least": 0.9}}}, "min, max, support_min and details, found least"),
        ({"metrics": {"similarity": 0.9}}, "similarity must be a mapping, found 0.9"),
        ({"metrics": {"similarity": {"min": 0.9, "max": 0.1}}}, "min 0.9 above max 0.1"),
        ({"metrics": {"similarity": {"min": True}}}, "must be a number, found True"),
        ({"metrics": {"similarity": {"details": {"kappa": {"at": 1}}}}}, "takes min and max, found at"),
        ({"evidence": {"walls": {"about": 3}}}, "takes min and max, found about"),
    ],
)
def test_faulty_options_are_refused(options: Mapping[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Thresholds(**options)
