"""A known pose passes through unchanged, and what is no pose or no map is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from mapgraft.contracts import EmptyMapError, MapError, Prior, Transform, UsageError
from mapgraft_standard.known_pose import KnownPose


@dataclass(frozen=True, slots=True)
class Cairns:
    """A map of a type that nobody here knows."""

    size: int
    map_type: str = "cairns"

    def known(self) -> int:
        return self.size


HERE = Transform.planar(3.0, -2.0, 0.7)
SOME = Cairns(5)


def prior(covariance: object) -> Prior:
    return Prior(HERE, np.asarray(covariance, np.float64), "a person")


def test_the_prior_is_the_match() -> None:
    covariance = np.diag([0.04, 0.09, 1e-9, 1e-9, 1e-9, 0.0025])
    covariance[0, 1] = covariance[1, 0] = 0.03
    (match,) = KnownPose().match(SOME, SOME, prior(covariance))
    assert match.T_receiver_donor == HERE and match.covariance is not None
    assert np.array_equal(match.covariance, covariance)
    assert match.score == 1.0 and match.margin == math.inf and match.scale == 1.0
    assert match.evidence["sigma_yaw_rad"] == pytest.approx(0.05)
    assert match.evidence["sigma_m"] ** 2 == pytest.approx(np.linalg.eigvalsh(covariance[:2, :2]).max())


def test_without_a_prior_there_is_no_pose() -> None:
    with pytest.raises(UsageError, match=r"needs a prior.*when: \{prior: true\}"):
        KnownPose().match(SOME, SOME)


@pytest.mark.parametrize(("target", "source", "side"), [(Cairns(0), SOME, "target"), (SOME, Cairns(0), "source")])
def test_empty_maps_are_refused(target: Cairns, source: Cairns, side: str) -> None:
    with pytest.raises(EmptyMapError, match=f"the {side} map knows nothing"):
        KnownPose().match(target, source, prior(np.eye(6)))


@pytest.mark.parametrize(
    "covariance",
    [np.eye(3), np.full((6, 6), np.nan), np.diag([1, 1, 1, 1, 1, -1.0]), np.triu(np.ones((6, 6)))],
    ids=["shape", "NaN", "negative", "asymmetric"],
)
def test_what_is_no_covariance_is_refused(covariance: object) -> None:
    with pytest.raises(MapError, match="covariance of the prior from a person"):
        KnownPose().match(SOME, SOME, prior(covariance))
