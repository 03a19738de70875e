"""Whether what a matcher says of its certainty is true."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mapgraft.contracts import Match
from mapgraft.evaluation.truth import RIGHT_M, Truth

ELLIPSE_95 = 7.815  # chi² of three degrees of freedom: x, y, yaw
_PLANAR = (0, 1, 5)  # places of x, y, yaw in a covariance
WIDE_M = RIGHT_M / 2.0  # two standard deviations of this may be a wrong place: degenerate


class Certainty(NamedTuple):
    """The squared Mahalanobis distance of the error of a match, and the greatest standard deviation of a shift.

    Both where the donor's walls lie.
    """

    distance2: float
    sigma_max_m: float

    @property
    def inside(self) -> bool:
        return self.distance2 <= ELLIPSE_95

    @property
    def degenerate(self) -> bool:
        return self.sigma_max_m > WIDE_M


def certainty(truth: Truth, match: Match) -> Certainty | None:
    """What the covariance of a match says of its error; None without a covariance that is one."""
    if match.covariance is None or np.shape(match.covariance) != (6, 6):
        return None
    covariance = np.asarray(match.covariance, np.float64)[np.ix_(_PLANAR, _PLANAR)]
    if not np.isfinite(covariance).all():
        return None
    T = match.T_receiver_donor
    meant = truth.points_m.mean(axis=0)
    found = T.apply(match.scale * truth.T_receiver_donor.inverse().apply(meant[None]))[0]
    arm_x, arm_y = found[0] - T.x_m, found[1] - T.y_m
    there = np.array([[1.0, 0.0, -arm_y], [0.0, 1.0, arm_x], [0.0, 0.0, 1.0]])
    covariance = there @ covariance @ there.T
    if np.linalg.eigvalsh(covariance)[0] <= 0.0:
        return None
    turn_rad = math.remainder(T.yaw_rad - truth.T_receiver_donor.yaw_rad, 2.0 * math.pi)
    error = np.array([found[0] - meant[0], found[1] - meant[1], turn_rad])
    distance2 = float(error @ np.linalg.solve(covariance, error))
    return Certainty(distance2, math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[1])))
