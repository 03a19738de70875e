"""Accepting by a probability: what is taken, what is left open, what is vetoed."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import Candidate, ConfigError, Match, Measurement, PluginError, Transform
from mapgraft_standard.posterior import Posterior

ACCEPTOR = Posterior(provisional=0.99, ambiguous=0.5, metrics={"paths": {"max": 2}})


def candidate(probability: float, crossed: float = 0.0) -> Candidate:
    measured = {
        "posterior": Measurement("posterior", probability, "1", 100, "higher"),
        "paths": Measurement("paths", crossed, "cells", 40, "lower"),
    }
    return Candidate(Match(Transform.identity(), 1.0, 1.0), measured)


@pytest.mark.parametrize(
    ("probabilities", "verdict", "chosen"),
    [
        ([], "unmatched", None),
        ([0.2], "unmatched", None),
        ([math.nan, math.nan], "unmatched", None),
        ([0.7, 0.1], "ambiguous", None),
        ([0.995], "provisional", 0),
        ([0.99, 0.1], "ambiguous", None),  # 0.989: one of them is right at most
        ([0.991, 0.1], "provisional", 0),
        ([0.2, 0.999], "provisional", 1),
        ([math.nan, 0.999], "provisional", 1),
        ([0.995, 0.6], "ambiguous", None),
        ([0.99999, 0.6], "provisional", 0),  # far more probable than the other
        ([0.999, 0.9999], "ambiguous", None),
    ],
)
def test_verdict_follows_the_probabilities(probabilities: list[float], verdict: str, chosen: int | None) -> None:
    decision = ACCEPTOR.accept([candidate(p) for p in probabilities])
    assert (decision.verdict, decision.chosen) == (verdict, chosen)
    assert decision.reason


def test_a_veto_takes_a_candidate_out_and_says_so() -> None:
    decision = ACCEPTOR.accept([candidate(0.999, crossed=7.0), candidate(0.3)])
    assert decision.verdict == "unmatched"
    assert "candidate 1: paths 7 > 2" in decision.reason
    assert ACCEPTOR.accept([candidate(0.999, crossed=7.0), candidate(0.998)]).chosen == 1


def test_what_cannot_be_measured_is_no_veto() -> None:
    assert ACCEPTOR.accept([candidate(0.999, crossed=math.nan)]).verdict == "provisional"


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6))
def test_never_takes_what_is_less_probable_than_asked_or_than_another(probabilities: list[float]) -> None:
    decision = ACCEPTOR.accept([candidate(p) for p in probabilities])
    if decision.chosen is not None:
        best = probabilities[decision.chosen]
        assert best == max(probabilities) >= 0.99
        odds = [p / max(1.0 - p, 1e-12) for p in probabilities]
        assert odds[decision.chosen] / (1.0 + sum(odds)) >= 0.99 - 1e-9


def test_impossible_probabilities_are_refused() -> None:
    with pytest.raises(ConfigError, match="0 < ambiguous <= provisional < 1"):
        Posterior(provisional=0.4, ambiguous=0.5)


def test_the_rule_must_name_the_metric() -> None:
    with pytest.raises(PluginError, match="posterior was not measured"):
        ACCEPTOR.accept(
            [dataclasses.replace(candidate(0.5), measurements={"paths": candidate(0.5).measurements["paths"]})]
        )


@pytest.mark.parametrize(
    ("probability", "says"),
    [(0.5, "0.5"), (0.8765, "0.876"), (0.99, "0.99"), (0.99978, "0.99978"), (1 - 2.3e-5, "0.999977")],
)
def test_probabilities_are_told_with_the_digits_that_differ(probability: float, says: str) -> None:
    assert f"is right with probability {says} " in ACCEPTOR.accept([candidate(probability)]).reason


def test_what_is_next_to_certain_is_told_in_few_digits() -> None:
    assert "with probability over 0.999999999 ≥ 0.99" in ACCEPTOR.accept([candidate(1.0)]).reason
