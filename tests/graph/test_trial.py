"""What both maps say by themselves of the places at which one could lie in the other."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.graph.trial import Trial

nats = st.floats(-6.0, 6.0)


def probability(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds))


@given(nats, st.lists(nats, max_size=3))
def test_at_most_one_place_is_right(standing, rivals):
    """The odds of this place alone against those of another one alone, or of none."""
    trial = Trial(standing, tuple(rivals))
    none = math.prod(1.0 - probability(one) for one in (standing, *rivals))
    others = sum(none * math.exp(one) for one in rivals)
    assert trial.support == pytest.approx(math.log(none * math.exp(standing) / (none + others)), abs=1e-6)


def test_its_numbers_and_its_sentence():
    trial = Trial(5.0, (-6.0, 2.0))
    assert trial.evidence == {"trial_log_odds": 5.0, "trial_log_odds.elsewhere": 2.0}
    assert (
        trial.sentence == "measured on both maps, its log-odds of being right are 5.0, and 2.0 where the others put it"
    )
    assert Trial(5.0).evidence == {"trial_log_odds": 5.0}
    assert Trial(5.0).support == 5.0
    assert "they cannot be compared" in Trial(5.0).sentence
