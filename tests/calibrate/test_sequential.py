"""What labels tell of the sequential test is what the test does: the verifier's own verdicts are the measure."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pytest

from mapgraft.calibrate import Labelled, sequential
from mapgraft.calibrate.labelled import Look
from mapgraft.contracts import Measurement, Sample
from mapgraft.examples.looks import MOST, Looks
from mapgraft_standard.rendezvous import NAME, TELLING
from mapgraft_standard.sequential import Sequential

Make = Callable[..., list[Labelled]]
TEST = sequential.Test()


def news(agreed: float, against: float, agreed_m: float) -> Measurement:
    support = round(agreed + against)
    details = {"agreed": agreed, "against": against, "agreed_m": agreed_m, "places": 5.0}
    value = against / support if support else math.nan
    return Measurement("news", value, "1", support, "lower", details)


def posterior(value: float) -> Measurement:
    return Measurement("posterior", value, "1", 50, "higher")


def rendezvous(nats: float) -> Measurement:
    return Measurement("rendezvous", nats, "nats", 1, "higher")


def watched(made: Make, samples: Sequence[Mapping[str, Measurement]]) -> Labelled:
    """A merge whose verifier decides nothing, as its example tells of it."""
    verifier, looks, history = Sequential(revert_at=1e300, revert_below=0.0, confirm=False), Looks(), list[Sample]()
    for number, measured in enumerate(samples):
        history = [*history[:1], Sample(number, 10 * number, measured)]
        looks.add(history[-1], verifier.verify(history, "ledger") if number else None)
    rows = looks.columns()["history"]
    assert isinstance(rows, list)
    stamps = dict.fromkeys(row["stamp"] for row in rows)
    told = [
        Look(10 * stamp, {row["metric"]: row["value"] for row in rows if row["stamp"] == stamp}) for stamp in stamps
    ]
    return dataclasses.replace(made("a", 1, 1)[0], looks=told)


def actions(
    samples: Sequence[Mapping[str, Measurement]], *, confirm_at: float, revert_at: float, revert_below: float = 0.0
) -> set[str]:
    """All that the verifier would have said with these limits."""
    verifier = Sequential(revert_at=revert_at, confirm_at=confirm_at, revert_below=revert_below)
    history = [
        [Sample(n, 10 * n, one) for n, one in ((0, samples[0]), (k, samples[k]))] for k in range(1, len(samples))
    ]
    return {verifier.verify(one, "ledger").action for one in history}


def drive(rng: np.random.Generator, count: int) -> list[dict[str, Measurement]]:
    """A merge that is watched: blocks agree or not, walls come later than blocks, robots may see each other."""
    right = float(rng.uniform(0.12, 0.999))
    against = float(rng.choice([0.03, 0.2, 0.5]))
    meets = int(rng.integers(1, count)) if rng.random() < 0.4 else count
    nats = float(rng.uniform(-3.0, 6.0))
    samples, told = [{"news": news(0.0, 0.0, 0.0), "posterior": posterior(right)}], [0.0, 0.0, 0.0]
    for number in range(1, count):
        if rng.random() < 0.7:
            told[0] += 1.0
            told[2] += float(rng.exponential(0.3))
            told[1] += float(rng.random() < against)
        samples.append({"news": news(*told), "posterior": posterior(max(0.02, right - 0.01 * told[1]))})
        if number >= meets:
            samples[-1]["rendezvous"] = rendezvous(nats)
    return samples


@pytest.mark.parametrize("seed", range(25))
def test_a_limit_confirms_and_reverts_what_the_verifier_would(made: Make, seed: int) -> None:
    samples = drive(np.random.default_rng(seed), 30)
    reached = TEST.reached(watched(made, samples))
    for confirm_at in (-7.0, -5.0, -3.0, -1.0):
        said = actions(samples, confirm_at=confirm_at, revert_at=1e300)
        assert ("confirm" in said) == (reached.lowest <= confirm_at)
    for revert_at in (-0.5, 0.5, 2.0, 6.0):
        for falls, revert_below in ((False, 0.0), (True, 0.1)):
            said = actions(samples, confirm_at=-1e300, revert_at=revert_at, revert_below=revert_below)
            assert ("revert" in said) == reached.lies_above(revert_at, falls=falls)


def test_robots_that_see_each_other_can_confirm_without_new_walls(made: Make) -> None:
    before = {"news": news(0.0, 0.0, 0.0), "posterior": posterior(0.99)}
    samples = [before, before | {"rendezvous": rendezvous(8.0)}]
    assert actions(samples, confirm_at=-5.3, revert_at=6.9) == {"confirm"}
    reached = TEST.reached(watched(made, samples))
    assert reached.judged
    assert reached.lowest == pytest.approx(-8.0 - math.log(0.99 / 0.01))
    faint = TEST.reached(watched(made, [before, before | {"rendezvous": rendezvous(1.5)}]))
    assert (faint.lowest, faint.judged) == (math.inf, True)  # too faint to stand in for walls


def test_walls_that_come_when_the_odds_stay_count(made: Make) -> None:
    samples = [
        {"news": news(0.0, 0.0, 0.0), "posterior": posterior(0.99)},
        {"news": news(4.0, 0.0, 1.0), "posterior": posterior(0.99)},
        {"news": news(4.0, 0.0, 3.0), "posterior": posterior(0.99)},
    ]
    reached = TEST.reached(watched(made, samples))
    assert reached.lowest == reached.highest < -5.3
    assert actions(samples[:2], confirm_at=-5.3, revert_at=6.9) == {"keep"}
    assert actions(samples, confirm_at=-5.3, revert_at=6.9) == {"keep", "confirm"}


def test_where_nothing_new_was_seen_nothing_was_judged(made: Make) -> None:
    still = {"news": news(0.0, 0.0, 0.0), "posterior": posterior(0.999)}
    reached = TEST.reached(watched(made, [still, still, still]))
    assert (reached.lowest, reached.highest, reached.judged) == (math.inf, -math.inf, False)


@pytest.mark.parametrize("seed", range(4))
def test_of_a_merge_that_was_watched_for_long_the_extremes_are_known(made: Make, seed: int) -> None:
    rng = np.random.default_rng(seed)
    samples = [{"news": news(0.0, 0.0, 0.0), "posterior": posterior(0.9)}]
    for number in range(1, 5 * MOST):
        agreed, against = float(number), max(0.0, 0.2 * number + float(rng.normal(0.0, 2.0)))
        samples.append({"news": news(agreed, against, 0.1 * number), "posterior": posterior(0.9)})
    peak, trough = (int(place) for place in rng.choice(np.arange(40, 5 * MOST), 2, replace=False))
    samples[peak] = samples[peak] | {"news": news(1.0, 80.0, 50.0)}
    samples[trough] = samples[trough] | {"news": news(2000.0, 0.0, 50.0)}
    example = watched(made, samples)
    assert MOST < len(example.looks) <= 2 * MOST
    reached = TEST.reached(example)
    exactly = [Sequential().verify([Sample(0, 0, samples[0]), Sample(1, 9, one)], "ledger") for one in samples[1:]]
    told = [verdict.evidence["log_odds_wrong"] for verdict in exactly]
    assert reached.highest == max(told) == told[peak - 1]
    assert reached.lowest == min(told) == told[trough - 1]


def test_a_fall_of_the_probability_is_seen_among_very_many_looks(made: Make) -> None:
    samples = [{"news": news(float(n), 0.0, 0.1 * n), "posterior": posterior(0.9)} for n in range(3 * MOST)]
    assert not TEST.reached(watched(made, samples)).fell
    samples[301] = samples[301] | {"posterior": posterior(0.05)}
    assert TEST.reached(watched(made, samples)).fell


def test_meetings_stand_in_for_walls_from_where_they_do_for_the_verifier() -> None:
    assert sequential.TELLING == TELLING
    assert f"verifier.{NAME}" == sequential.MEETINGS
