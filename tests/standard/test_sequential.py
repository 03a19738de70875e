"""The sequential test of a merge: its verdicts, and that its error rates are what it says."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import ConfigError, Measurement, PluginError, Sample
from mapgraft_standard.sequential import Sequential


def sample(
    agreed: int = 0,
    against: int = 0,
    places: int | None = None,
    posterior: float = math.nan,
    state: Literal["provisional", "confirmed"] = "provisional",
) -> Sample:
    spoke = agreed + against
    details = {
        "agreed": float(agreed),
        "against": float(against),
        "agreed_m": 0.5 * agreed,
        "places": float(against if places is None else places),
    }
    news = Measurement("news", against / spoke if spoke else math.nan, "1", spoke, "lower", details)
    return Sample(0, 0, {"news": news, "posterior": Measurement("posterior", posterior, "1", 9, "higher")}, state)


@pytest.mark.parametrize(
    ("agreed", "against", "action"),
    [(0, 0, "keep"), (5, 1, "keep"), (60, 2, "confirm"), (0, 12, "revert"), (12, 12, "revert"), (3, 3, "keep")],
)
def test_verdict_follows_the_evidence(agreed: int, against: int, action: str) -> None:
    verdict = Sequential().verify([sample(posterior=0.5), sample(agreed, against)], "ledger")
    assert verdict.action == action
    assert verdict.reason


def test_without_new_evidence_it_stays_as_it_is_and_says_so() -> None:
    verdict = Sequential().verify([sample(posterior=0.9999)] * 3, "ledger")
    assert (verdict.action, verdict.reason) == ("keep", "no new evidence yet")


@pytest.mark.parametrize(("reversal", "confirms"), [("ledger", True), ("multi_map", True), ("single_map", False)])
def test_it_tells_where_it_stands_and_its_limits(reversal: str, confirms: bool) -> None:
    verifier = Sequential(reversals={"single_map": {"confirm": False}})
    for news in (sample(), sample(agreed=5, against=1), sample(agreed=60, against=2), sample(against=12)):
        verdict = verifier.verify([sample(posterior=0.5), news], reversal)
        told = dict(verdict.evidence)
        wrong = told["log_odds_wrong"]
        assert (verdict.action == "revert") == (wrong >= told["log_odds_wrong.revert_at"])
        assert ("log_odds_wrong.confirm_at" in told) == confirms
        assert verdict.action != "confirm" or wrong <= told["log_odds_wrong.confirm_at"]
        assert ("posterior.revert_at" in told) == (reversal != "single_map")


def test_a_sure_start_needs_less_and_still_something_new() -> None:
    verifier = Sequential(prior_max=9.0)
    sure, unsure = sample(posterior=1.0), sample(posterior=0.9)
    assert verifier.verify([sure, sample(agreed=3)], "ledger").action == "keep"  # 1.5 of 2 m
    assert verifier.verify([sure, sample(agreed=4)], "ledger").action == "confirm"
    assert verifier.verify([unsure, sample(agreed=4)], "ledger").action == "keep"
    assert verifier.verify([unsure, sample(agreed=9)], "ledger").action == "confirm"


def test_a_confirmed_merge_is_watched_on() -> None:
    start = sample(posterior=0.99)
    one_place, three = sample(4, 12, 1, state="confirmed"), sample(4, 12, 3, state="confirmed")
    assert Sequential().verify([start, one_place], "ledger").action == "keep"
    assert Sequential().verify([start, three], "ledger").action == "revert"
    assert Sequential().verify([start, sample(4, 12, 1)], "ledger").action == "revert"  # while it is provisional


def test_a_merge_that_is_no_longer_probable_goes() -> None:
    start = sample(posterior=0.999)
    assert "on the maps as they are now" in Sequential().verify([start, sample(posterior=0.02)], "ledger").reason
    assert Sequential().verify([start, sample(posterior=0.02)], "ledger").action == "revert"
    assert Sequential().verify([start, sample(posterior=0.2)], "ledger").action == "keep"
    assert Sequential().verify([sample(posterior=0.02)], "ledger").action == "keep"  # as accepted, by whomever


def test_what_holds_the_donor_itself_may_be_left_unconfirmed() -> None:
    verifier = Sequential(reversals={"single_map": {"confirm": False}})
    seen = [sample(posterior=0.999), sample(agreed=50)]
    assert verifier.verify(seen, "ledger").action == "confirm"
    assert verifier.verify(seen, "single_map").action == "keep"


@given(st.integers(0, 60), st.integers(0, 60), st.floats(0.0, 1.0))
def test_more_against_never_helps(agreed: int, against: int, posterior: float) -> None:
    order = {"confirm": 0, "keep": 1, "revert": 2}
    start = sample(posterior=posterior)
    verdicts = [Sequential().verify([start, sample(agreed, n)], "ledger").action for n in (against, against + 1)]
    assert order[verdicts[0]] <= order[verdicts[1]]


RATES = {"false_revert": 0.02, "false_confirm": 0.02, "against_right": 0.1, "against_wrong": 0.5, "new_m": 0.0}


def played(verifier: Sequential, share: float, posterior: float, random: np.random.Generator) -> str:
    """What becomes of a merge that was accepted with this probability, block by block."""
    agreed = against = 0
    for is_against in random.random(400) < share:
        against, agreed = against + int(is_against), agreed + int(not is_against)
        action = verifier.verify([sample(posterior=posterior), sample(agreed, against)], "ledger").action
        if action != "keep":
            return action
    return "keep"


@pytest.mark.parametrize(("share", "error"), [(0.1, "revert"), (0.5, "confirm")])
def test_without_a_prior_the_rates_are_walds(share: float, error: str) -> None:
    """Of right merges at most false_revert are reverted, of wrong ones false_confirm confirmed."""
    verifier = Sequential(**RATES, prior_max=0.0)
    random = np.random.default_rng(7)
    wrong_way = sum(played(verifier, share, 0.99, random) == error for _ in range(1000))
    assert wrong_way <= 32  # 20 are expected at most; three standard deviations more


@pytest.mark.parametrize("posterior", [0.8, 0.95])
def test_with_a_true_prior_the_rates_are_risks(posterior: float) -> None:
    """Of all merges accepted alike, so many are wrong and confirmed or right and reverted at most."""
    verifier = Sequential(**RATES)
    random = np.random.default_rng(8)
    confirmed = reverted = 0
    for right in (random.random(1500) < posterior).tolist():
        action = played(verifier, 0.1 if right else 0.5, posterior, random)
        confirmed, reverted = confirmed + (action == "confirm" and not right), reverted + (action == "revert" and right)
    assert confirmed <= 46  # 30 are expected at most; three standard deviations more
    assert reverted <= 46


def test_a_merged_map_says_nothing_of_the_prior_later() -> None:
    told = [sample(posterior=0.999), sample(posterior=0.02)]
    assert Sequential().verify(told, "single_map").action == "keep"


def test_the_rule_must_name_the_prior_or_want_none() -> None:
    news = {"news": sample(3, 1).measurements["news"]}
    with pytest.raises(PluginError, match="posterior was not measured at the merge"):
        Sequential().verify([Sample(0, 0, news)] * 2, "ledger")
    assert Sequential(prior_max=0.0).verify([Sample(0, 0, news)] * 2, "ledger").action == "keep"


def test_the_rule_must_name_the_news() -> None:
    lacking = Sample(0, 0, {"posterior": Measurement("posterior", 0.9, "1", 9, "higher")})
    with pytest.raises(PluginError, match="news was not measured"):
        Sequential().verify([lacking], "ledger")


@pytest.mark.parametrize(
    "options",
    [
        {"against_right": 0.6},
        {"false_revert": 0.0},
        {"places": 0},
        {"prior_max": -1.0},
        {"reversals": {"nothing": {"confirm": False}}},
        {"reversals": {"ledger": {"patience": 3}}},
    ],
)
def test_impossible_parameters_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="verifier sequential"):
        Sequential(**options)


@given(st.floats(-9.0, 0.0), st.floats(0.5, 9.0), st.integers(0, 40), st.integers(0, 20))
def test_limits_that_labels_have_set_take_the_places_of_its_own(
    confirm_at: float, revert_at: float, agreed: int, against: int
) -> None:
    verifier = Sequential(confirm_at=confirm_at, revert_at=revert_at, new_m=0.0)
    verdict = verifier.verify([sample(posterior=0.5), sample(agreed, against)], "ledger")
    wrong = verdict.evidence["log_odds_wrong"]
    assert verdict.evidence["log_odds_wrong.confirm_at"] == confirm_at
    assert (verdict.action == "revert") == (wrong >= revert_at and agreed + against > 0)
    assert (verdict.action == "confirm") == (wrong <= confirm_at and agreed + against > 0)


def test_limits_in_the_wrong_order_are_refused() -> None:
    with pytest.raises(ConfigError, match="confirm_at < revert_at, found 2 and 1"):
        Sequential(confirm_at=2.0, revert_at=1.0)


@pytest.mark.parametrize(
    ("agreed", "against", "says"),
    [
        (9, 0, "none of 9 new pieces of evidence is against it: log-odds"),
        (0, 1, "1 of 1 new piece of evidence is against it, in 1 place: log-odds"),
        (9, 1, "1 of 10 new pieces of evidence is against it, in 1 place: log-odds"),
        (9, 2, "2 of 11 new pieces of evidence are against it, in 2 places: log-odds"),
    ],
)
def test_numbers_are_told_as_one_says_them(agreed: int, against: int, says: str) -> None:
    assert Sequential().verify([sample(posterior=0.5), sample(agreed, against)], "ledger").reason.startswith(says)
