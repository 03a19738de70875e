"""What passes between robots is bytes, and what comes out is what went in."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.config import PriorConfig
from mapgraft.contracts import MapError, MapMetadata, Provenance, Transform
from mapgraft.exchange import Offer
from mapgraft.persons import given_priors, inverse_prior, planar_covariance, prior_of, recorded_priors

NAMES = st.text(min_size=1, max_size=8)


@given(
    provenance=st.builds(Provenance, NAMES, st.integers(0, 9), st.integers(0, 10**6)),
    bounds=st.none() | st.tuples(*[st.floats(-1e3, 1e3)] * 4),
    extra=st.dictionaries(NAMES, st.one_of(st.booleans(), st.floats(-1, 1), NAMES), max_size=3),
    corrections=st.integers(0, 3),
)
def test_an_offer_survives_the_way(provenance, bounds, extra, corrections):
    metadata = MapMetadata("grid", 0.05, bounds_m=bounds, can_send=("rays",), extra=extra)
    offer = Offer(provenance, metadata, corrections)
    assert Offer.decode(offer.encode()) == offer
    assert Offer.decode(offer.encode()).encode() == offer.encode()


@given(data=st.binary(max_size=60))
def test_noise_is_no_offer(data):
    with pytest.raises(MapError, match="an offer of"):
        Offer.decode(data)


def _offer(**changed: object) -> bytes:
    sound = json.loads(Offer(Provenance("a", 1, 2), MapMetadata("grid", 0.05, extra={"x": 1.0})).encode())
    metadata = {**sound["metadata"], **{k: v for k, v in changed.items() if k in sound["metadata"]}}
    told = {k: v for k, v in changed.items() if k in (*sound, "corrections")}
    return json.dumps({**sound, "metadata": metadata, **told}).encode()


UNFIT = {
    "an infinite epoch": _offer(provenance=["a", math.inf, 1]),
    "an epoch before the first": _offer(provenance=["a", -1, 1]),
    "a version that nobody counts to": _offer(provenance=["a", 1, 1 << 63]),
    "a source without a name": _offer(provenance=["", 1, 1]),
    "a source whose name no message holds": _offer(provenance=["a" * 401, 1, 1]),
    "too short": _offer(provenance=["a", 1]),
    "metadata as a word": _offer(metadata="x"),
    "a type that is no word": _offer(type=[]),
    "a resolution that is no number": _offer(resolution_m="fine"),
    "a resolution that is true": _offer(resolution_m=True),
    "three bounds": _offer(bounds_m=[1, 2, 3]),
    "a bound that is a word": _offer(bounds_m=[1, 2, 3, "x"]),
    "nothing to call what it can send": _offer(can_send=[1]),
    "more than plain values": _offer(extra={"x": [1]}),
    "corrections that are no number": _offer(corrections="often"),
    "fewer corrections than none": _offer(corrections=-1),
    "more corrections than anybody counts": _offer(corrections=1 << 32),
    "lists in lists": b"[" * 3000,
}


@pytest.mark.parametrize("data", UNFIT.values(), ids=UNFIT)
def test_an_offer_that_nobody_would_write_is_refused(data):
    with pytest.raises(MapError, match=r"an offer of .* cannot be read"):
        Offer.decode(data)


def test_the_offer_that_these_are_made_of_is_sound():
    assert Offer.decode(_offer()).metadata.extra == {"x": 1.0}


@given(x=st.floats(-20, 20), y=st.floats(-20, 20), yaw=st.floats(-3, 3))
def test_a_prior_turned_around_twice_is_itself(x, y, yaw):
    prior = prior_of(PriorConfig(receiver="a", donor="b", x_m=x, y_m=y, yaw_rad=yaw))
    twice = inverse_prior(inverse_prior(prior))
    assert np.allclose(twice.T_receiver_donor.matrix, prior.T_receiver_donor.matrix, atol=1e-9)
    assert np.allclose(twice.covariance, prior.covariance, atol=1e-9)


def test_the_covariance_of_an_inverse_is_that_of_samples():
    rng = np.random.default_rng(1)
    prior = prior_of(PriorConfig(receiver="a", donor="b", x_m=8, y_m=-3, yaw_rad=1.1, sigma_m=0.05, sigma_yaw_rad=0.02))
    T = prior.T_receiver_donor
    drawn = rng.normal((T.x_m, T.y_m, T.yaw_rad), (0.05, 0.05, 0.02), (20_000, 3))
    inverses = np.array([(i.x_m, i.y_m, i.yaw_rad) for i in (Transform.planar(*d).inverse() for d in drawn)])
    planar = inverse_prior(prior).covariance[np.ix_((0, 1, 5), (0, 1, 5))]
    assert np.allclose(np.cov(inverses.T), planar, rtol=0.08, atol=2e-4)


def test_the_direct_word_goes_before_one_turned_around():
    ab = PriorConfig(receiver="a", donor="b", x_m=1, y_m=0, yaw_rad=0)
    ba = PriorConfig(receiver="b", donor="a", x_m=5, y_m=0, yaw_rad=0)
    priors = given_priors([ab, ba])
    assert priors["a", "b"].T_receiver_donor.x_m == 1
    assert priors["b", "a"].T_receiver_donor.x_m == 5
    assert given_priors([ab])["b", "a"].T_receiver_donor.x_m == -1


def test_recorded_poses_become_priors_of_every_pair():
    worlds = {"a": Transform.planar(1, 2, 0), "b": Transform.planar(4, 2, math.pi / 2), "c": Transform.identity()}
    priors = recorded_priors(worlds)
    assert len(priors) == 6
    assert priors["a", "b"].T_receiver_donor.x_m == pytest.approx(3)
    assert priors["b", "a"].T_receiver_donor.y_m == pytest.approx(3)
    assert np.array_equal(priors["a", "b"].covariance, planar_covariance(0.1, 0.02))
