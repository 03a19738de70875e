"""Matching by not having to: somebody already knows the relative pose."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mapgraft.contracts import EmptyMapError, Map, MapError, Match, Prior, UsageError

YAW = 5  # place of the yaw in a covariance of x, y, z, roll, pitch, yaw
_SYMMETRIC = 1e-9
_NOT_NEGATIVE = -1e-9


class KnownPose:
    """The prior as the one match, with its covariance; the maps are not looked at beyond being there at all.

    Its score is 1 and its margin infinite: a known pose competes with nothing. Evidence: ``sigma_m``, the larger
    standard deviation of x and y, and ``sigma_yaw_rad``.
    """

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        """The prior; UsageError without one, EmptyMapError on an empty map, MapError when its covariance is none."""
        if prior is None:
            raise UsageError(
                "known_pose needs a prior, and nobody knows one for this pair: give one, "
                "or let the rule apply only with `when: {prior: true}`"
            )
        for side, map_ in (("target", target), ("source", source)):
            if map_.known() == 0:
                raise EmptyMapError(f"the {side} map knows nothing yet, so that there is nothing to merge")
        sigma_m, sigma_yaw_rad = _deviations(prior)
        return [
            Match(
                prior.T_receiver_donor,
                score=1.0,
                margin=math.inf,
                covariance=prior.covariance,
                evidence={"sigma_m": sigma_m, "sigma_yaw_rad": sigma_yaw_rad},
            )
        ]


def _deviations(prior: Prior) -> tuple[float, float]:
    given = np.asarray(prior.covariance, dtype=np.float64)
    usable = given.shape == (6, 6) and np.isfinite(given).all() and abs(given - given.T).max() <= _SYMMETRIC
    if not usable or np.linalg.eigvalsh(given)[0] < _NOT_NEGATIVE:
        raise MapError(
            f"the covariance of the prior from {prior.origin} must be a finite, symmetric (6, 6) matrix without "
            f"negative eigenvalue, found shape {given.shape}: mend it where it comes from"
        )
    plane = np.linalg.eigvalsh(given[:2, :2])[1]
    return math.sqrt(max(0.0, float(plane))), math.sqrt(max(0.0, float(given[YAW, YAW])))
