"""Accepting by a score above a threshold: the first hypothesis or none, and what cannot be told is not taken."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import Candidate, ConfigError, Match, Measurement, PluginError, Transform
from mapgraft_standard.calibrated import Calibrated

SCORE = {"posterior.log_odds": 1.0, "margin": {"weight": 0.5, "log": True, "most": 100.0}, "evidence.rivals": -2.0}
numbers = st.floats(-50.0, 50.0)


def candidate(log_odds: float, margin: float = 0.0, rivals: float = 0.0, crossed: float = 0.0) -> Candidate:
    measured = {
        "posterior": Measurement("posterior", 0.5, "1", 9, "higher", {"log_odds": log_odds}),
        "paths": Measurement("paths", crossed, "cells", 40, "lower"),
    }
    return Candidate(Match(Transform.identity(), 7.0, margin, evidence={"rivals": rivals}), measured)


def test_the_first_is_taken_above_the_threshold_and_no_other() -> None:
    acceptor = Calibrated(score={"posterior.log_odds": 1.0}, accept_above=2.0, ambiguous_above=0.0)
    assert acceptor.accept([]).verdict == "unmatched"
    assert acceptor.accept([candidate(2.01)]).chosen == 0
    assert acceptor.accept([candidate(2.0)]).verdict == "ambiguous"  # above it, not at it
    assert acceptor.accept([candidate(0.0)]).verdict == "unmatched"
    assert acceptor.accept([candidate(-1.0), candidate(9.0)]).verdict == "unmatched"
    assert "2.01 > 2" in acceptor.accept([candidate(2.01)]).reason


def test_the_score_is_the_sum_of_its_terms() -> None:
    acceptor = Calibrated(score=SCORE, intercept=-1.0, accept_above=0.0)
    assert acceptor.score(candidate(3.0, 9.0, 0.25)) == pytest.approx(-1.0 + 3.0 + 0.5 * math.log(10.0) - 0.5)
    assert acceptor.score(candidate(3.0, math.inf)) == pytest.approx(2.0 + 0.5 * math.log(101.0))
    assert acceptor.score(candidate(3.0, -9.0)) == pytest.approx(2.0 - 0.5 * math.log(10.0))


def test_without_a_threshold_nothing_is_taken() -> None:
    decision = Calibrated(score={"score": 1.0}).accept([candidate(1e9)])
    assert decision.verdict == "unmatched"
    assert "labels have set no threshold" in decision.reason


def test_what_cannot_be_told_is_not_taken() -> None:
    acceptor = Calibrated(score={"posterior.log_odds": 1.0, "evidence.lead": 1.0}, accept_above=-100.0)
    decision = acceptor.accept([candidate(math.nan)])
    assert decision.verdict == "unmatched"
    assert "posterior.log_odds, evidence.lead could not be measured" in decision.reason


def test_a_veto_only_makes_it_rarer() -> None:
    acceptor = Calibrated(accept_above=0.0, metrics={"posterior": {}, "paths": {"max": 4}})
    assert acceptor.accept([candidate(0.0, crossed=4.0)]).chosen == 0
    assert "paths 5 > 4" in acceptor.accept([candidate(0.0, crossed=5.0)]).reason
    assert acceptor.accept([candidate(0.0, crossed=math.nan)]).chosen == 0
    with pytest.raises(PluginError, match="speed was not measured"):
        Calibrated(accept_above=0.0, metrics={"speed": {"max": 4}}).accept([candidate(0.0)])


def test_limits_are_those_of_thresholds_and_only_make_it_rarer() -> None:
    limits = {"margin_min": 2.0, "evidence": {"rivals": {"max": 1.0}}, "metrics": {"paths": {"max": 4.0}}}
    acceptor = Calibrated(score={"posterior.log_odds": 1.0}, accept_above=0.0, limits=limits)
    good, near = candidate(3.0, 1.0), candidate(2.0, -1.0)  # both with a score of the matcher of 7
    assert acceptor.accept([good]).chosen == 0  # nobody else keeps the limits: the margin need not be large
    assert acceptor.accept([good, candidate(2.0, -1.0, crossed=5.0)]).chosen == 0
    assert acceptor.accept([good, near]).verdict == "ambiguous"
    for broken in (candidate(3.0, crossed=5.0), candidate(3.0, crossed=math.nan), candidate(3.0, rivals=2.0)):
        decision = acceptor.accept([broken, good])
        assert (decision.verdict, decision.chosen) == ("unmatched", None)
        assert "by its limits" in decision.reason
    assert acceptor.accept([candidate(-1.0, 9.0)]).verdict == "unmatched"
    with pytest.raises(ConfigError, match=r"limits takes score_min.*, found marginmin"):
        Calibrated(limits={"marginmin": 2.0})


@pytest.mark.parametrize(("told", "taken"), [(-5.0, False), (-4.9, True), (8.0, True), (math.nan, True)])
def test_robots_that_saw_each_other_elsewhere_are_a_veto(told: float, taken: bool) -> None:
    met = Measurement("rendezvous", told, "nats", 0 if math.isnan(told) else 2, "higher")
    given = candidate(3.0)
    seen = Candidate(given.match, {**given.measurements, "rendezvous": met})
    acceptor = Calibrated(score={"posterior.log_odds": 1.0}, accept_above=0.0)
    assert (acceptor.accept([seen]).chosen == 0) == taken
    assert Calibrated(score={"posterior.log_odds": 1.0}, accept_above=0.0, refuted=-100.0).accept([seen]).chosen == 0


@given(st.lists(numbers, min_size=1, max_size=5), numbers, numbers)
def test_a_higher_threshold_never_takes_more(scores: list[float], one: float, other: float) -> None:
    candidates = [candidate(score) for score in scores]
    low, high = sorted((one, other))
    score = {"posterior.log_odds": 1.0}
    if Calibrated(score=score, accept_above=high).accept(candidates).chosen is not None:
        assert Calibrated(score=score, accept_above=low).accept(candidates).chosen == 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"accept_above": 1.0, "ambiguous_above": 2.0}, "ambiguous_above <= accept_above"),
        ({"score": {"margin": {"wheight": 1.0}}}, "found wheight"),
        ({"score": {"margin": {"log": 1}}}, "log true or false"),
        ({"score": {"margin": {"most": 0.0}}}, "most > 0"),
        ({"score": {"margin": "much"}}, "must be a number"),
        ({"intercept": math.nan}, "must be a number"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Calibrated(**options)
