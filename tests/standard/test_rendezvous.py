"""What robots that saw each other say of a merge."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.contracts import (
    Candidate,
    ConfigError,
    MapMetadata,
    Match,
    Measurement,
    Sample,
    Sighting,
    Step,
    Transform,
)
from mapgraft_standard.acceptance import Thresholds as Accepts
from mapgraft_standard.posterior import Posterior
from mapgraft_standard.rendezvous import Rendezvous, told_by
from mapgraft_standard.sequential import Sequential
from mapgraft_standard.thresholds import Thresholds

S = 1_000_000_000
METERS = st.floats(-20, 20)
TURNS = st.floats(-3, 3)
POSES = st.builds(Transform.planar, METERS, METERS, TURNS)


@dataclass
class Box:
    """A map type that tells how large a map is, and nothing else."""

    bounds_m: tuple[float, float, float, float] | None = (0.0, 0.0, 50.0, 40.0)

    def metadata(self, layer) -> MapMetadata:
        return MapMetadata("box", bounds_m=self.bounds_m)


@dataclass
class Shown:
    """What the metric looks at of a comparison."""

    T_receiver_donor: Transform
    sightings: list[Sighting]
    covariance: np.ndarray | None = None
    map_type: Box = field(default_factory=Box)
    target_layer: object = None

    @property
    def match(self) -> Match:
        return Match(self.T_receiver_donor, 1.0, 1.0, covariance=self.covariance)


def true_sighting(T, own, other, second=0.0, by_donor=False, off_m=(0.0, 0.0), yaw=True) -> Sighting:
    """What is measured where a transform is right, and by how much it is off."""
    seen = own.inverse() @ T @ other
    seen = seen.inverse() if by_donor else seen
    yaw_rad = seen.yaw_rad if yaw else math.nan
    where = (seen.x_m + off_m[0], seen.y_m + off_m[1], yaw_rad)
    return Sighting(round(second * S), own, other, *where, 0.2, 0.1, by_donor)


def value(shown, **options) -> float:
    return Rendezvous(**options).track(shown).update(Step()).value


@given(POSES, POSES, POSES, st.booleans(), st.booleans())
def test_where_they_should_it_speaks_for_it_and_elsewhere_against(T, own, other, by_donor, yaw):
    right = true_sighting(T, own, other, by_donor=by_donor, yaw=yaw)
    wrong = true_sighting(T, own, other, by_donor=by_donor, yaw=yaw, off_m=(4.0, 0.0))
    sigma2 = 0.2**2 + 0.1**2
    density = 1 / (2 * math.pi * sigma2) * (1 / math.sqrt(2 * math.pi * (0.1**2 + 0.03**2)) if yaw else 1.0)
    chance = 1 / 2000 / (2 * math.pi if yaw else 1.0)
    assert value(Shown(T, [right]), most=99) == pytest.approx(math.log(0.95 * density / chance + 0.05), abs=1e-6)
    assert value(Shown(T, [wrong])) == pytest.approx(math.log(0.05), abs=1e-6)


@given(POSES, POSES, POSES, st.tuples(st.floats(-1, 1), st.floats(-1, 1)))
def test_a_place_seen_by_either_says_the_same(T, own, other, off_m):
    """As far as only the place is known, and the transform is: who saw whom makes no difference."""
    one = true_sighting(T, own, other, off_m=off_m, yaw=False)
    seen = T.inverse() @ own @ Transform.planar(one.x_m, one.y_m, (own.inverse() @ T @ other).yaw_rad)
    moved = Transform.planar(seen.x_m, seen.y_m, other.yaw_rad)
    back = other.inverse() @ T.inverse() @ own
    shift = other.inverse().matrix[:2, :2] @ (other.matrix[:2, 3] - moved.matrix[:2, 3])
    two = replace(one, by_donor=True, x_m=back.x_m + float(shift[0]), y_m=back.y_m + float(shift[1]))
    assert value(Shown(T, [one])) == pytest.approx(value(Shown(T, [two])), abs=1e-6)


@given(POSES, POSES, POSES, st.booleans(), st.integers(0, 2))
def test_how_unsure_the_transform_is_moves_the_prediction_so_much(T, own, other, by_donor, axis):
    """The spread of the prediction is that of transforms drawn from the covariance, to first order."""
    from mapgraft_standard.rendezvous import _residual

    step = 1e-6
    covariance = np.zeros((6, 6))
    covariance[[0, 1, 5][axis], [0, 1, 5][axis]] = 1.0
    one = true_sighting(T, own, other, by_donor=by_donor)
    _, spread = _residual(one, Shown(T, [one], covariance))
    change = [0.0, 0.0, 0.0]
    change[axis] = step
    moved = Transform.planar(T.x_m + change[0], T.y_m + change[1], T.yaw_rad + change[2])
    residual, _ = _residual(one, Shown(moved, [one]))
    at, _ = _residual(one, Shown(T, [one]))
    gradient = (residual - at) / step
    np.testing.assert_allclose(spread, np.outer(gradient, gradient), atol=1e-3)


def test_sightings_of_one_moment_count_once_and_all_together_no_more_than_most():
    T, own, other = Transform.planar(5, 1, 0.3), Transform.planar(2, 2, 0.1), Transform.planar(1, -1, 2.0)
    alone = value(Shown(T, [true_sighting(T, own, other)]), most=99)
    at_once = [true_sighting(T, own, other, second=k) for k in range(10)]
    assert value(Shown(T, at_once), most=99) == pytest.approx(alone)
    apart = [true_sighting(T, own, other, second=10 * k) for k in range(3)]
    assert value(Shown(T, apart), most=99) == pytest.approx(3 * alone)
    assert value(Shown(T, apart)) == 8.0
    measured = Rendezvous().track(Shown(T, apart)).update(Step())
    assert (measured.support, measured.details["sightings"]) == (3, 3.0)


def test_who_never_met_says_nothing():
    shown = Shown(Transform.identity(), [])
    tracker = Rendezvous().track(shown)
    assert not tracker.update(Step()).sufficient and told_by({"rendezvous": tracker.update(Step())}) == 0.0
    shown.sightings.append(true_sighting(shown.T_receiver_donor, Transform.identity(), Transform.identity()))
    assert tracker.update(Step()).sufficient
    nowhere = Shown(Transform.identity(), shown.sightings, map_type=Box(None))
    assert value(nowhere, most=99) < value(Shown(nowhere.T_receiver_donor, nowhere.sightings), most=99)


@pytest.mark.parametrize("options", [{"outliers": 0.0}, {"floor_m": 0.0}, {"apart_s": -1.0}, {"most": 0.0}])
def test_parameters_that_make_no_sense_are_refused(options):
    with pytest.raises(ConfigError):
        Rendezvous(**options)


def measured(**values: float) -> dict[str, Measurement]:
    return {name: Measurement(name, value, "", 1, "higher") for name, value in values.items()}


def candidate(**values: float) -> Candidate:
    return Candidate(Match(Transform.identity(), 1.0, 1.0), measured(**values))


def test_the_probability_of_a_candidate_takes_it_in():
    accept = Posterior().accept
    doubtful, unlikely = candidate(posterior=0.6, rendezvous=6.0), candidate(posterior=0.6, rendezvous=-3.0)
    assert accept([candidate(posterior=0.6)]).verdict == "ambiguous"
    assert accept([doubtful]).verdict == "provisional"
    assert accept([unlikely]).verdict == "unmatched"
    assert accept([unlikely, doubtful]).chosen == 1
    refuted = accept([candidate(posterior=1 - 1e-9, rendezvous=-6.0)])
    assert refuted.verdict == "unmatched" and "rendezvous -6 ≤ -5" in refuted.reason
    assert accept([candidate(posterior=math.nan, rendezvous=8.0)]).verdict == "unmatched"


def test_limits_are_not_enough_where_robots_saw_each_other_elsewhere():
    accept = Accepts().accept
    assert accept([candidate(rendezvous=1.0)]).verdict == "provisional"
    assert accept([candidate(rendezvous=-6.0)]).verdict == "unmatched"


def news(agreed: int, against: int, **values: float) -> Sample:
    details = {"agreed": float(agreed), "against": float(against), "places": float(against)}
    told = Measurement("news", 0.0, "", agreed + against, "higher", details)
    return Sample(0, 10, {**measured(**values), "news": told})


def test_a_standing_merge_is_judged_by_it():
    verify = Sequential().verify
    start = news(0, 0, posterior=0.9)
    assert verify([start, news(0, 0)], "ledger").action == "keep"
    met = verify([start, news(0, 0, rendezvous=6.0)], "ledger")
    assert met.action == "confirm" and met.evidence["rendezvous"] == 6.0
    assert met.evidence["log_odds_wrong"] == pytest.approx(-math.log(9) - 6.0)
    elsewhere = verify([start, news(0, 3, rendezvous=-6.0)], "ledger")
    assert elsewhere.action == "revert" and "says -6.0 nats for it" in elsewhere.reason
    limits = Thresholds(metrics={"score": {"min": 0.0}}).verify
    assert limits([news(0, 0, score=1.0, rendezvous=-6.0)], "ledger").action == "revert"
    assert limits([news(0, 0, score=1.0, rendezvous=2.0)], "ledger").action == "keep"
