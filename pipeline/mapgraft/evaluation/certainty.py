"""Whether what a matcher says of its certainty is true."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Map, MapType, Match, Points
from mapgraft.evaluation.truth import RIGHT_M, Truth

ELLIPSE_95 = 7.815  # chi² of three degrees of freedom: x, y, yaw
_PLANAR = (0, 1, 5)  # places of x, y, yaw in a covariance
WIDE_M = RIGHT_M / 2.0  # two standard deviations of this may be a wrong place: degenerate


class Certainty(NamedTuple):
    """What the covariance of a match says where the donor's walls lie.

    ``middle_m`` (2,) is the middle of them, ``covariance`` (3, 3) that of x, y and yaw there.
    """

    middle_m: Points
    covariance: NDArray[np.float64]

    @property
    def sigma_max_m(self) -> float:
        """The greatest standard deviation of a shift, whatever its direction."""
        return math.sqrt(float(np.linalg.eigvalsh(self.covariance[:2, :2])[1]))

    @property
    def degenerate(self) -> bool:
        return self.sigma_max_m > WIDE_M

    def distance2(self, truth: Truth, match: Match) -> float:
        """The squared Mahalanobis distance of the error of the match."""
        meant = truth.points_m.mean(axis=0)
        turn_rad = math.remainder(match.T_receiver_donor.yaw_rad - truth.T_receiver_donor.yaw_rad, 2.0 * math.pi)
        error = np.array([self.middle_m[0] - meant[0], self.middle_m[1] - meant[1], turn_rad])
        return float(error @ np.linalg.solve(self.covariance, error))


def walls_middle(truth: Truth | None, donor_type: MapType, donor: Map) -> Points:
    """The middle of the donor's walls in its own frame: of those by which errors are measured where there is a truth.

    The origin where the donor has none.
    """
    if truth is not None:
        seen_m: Points = truth.points_m.mean(axis=0)[None]
        there_m: Points = truth.T_receiver_donor.inverse().apply(seen_m)[0] / truth.scale
        return there_m
    walls_m: Points = donor_type.structure(donor)
    middle_m: Points = walls_m.mean(axis=0) if len(walls_m) else np.zeros(2)
    return middle_m


def certainty(match: Match, middle_m: Points) -> Certainty | None:
    """What the covariance of a match says at a point of the donor's frame; None without a covariance that is one."""
    if match.covariance is None or np.shape(match.covariance) != (6, 6):
        return None
    covariance = np.asarray(match.covariance, np.float64)[np.ix_(_PLANAR, _PLANAR)]
    if not np.isfinite(covariance).all():
        return None
    T = match.T_receiver_donor
    found = T.apply(match.scale * middle_m[None])[0]
    arm_x, arm_y = found[0] - T.x_m, found[1] - T.y_m
    there = np.array([[1.0, 0.0, -arm_y], [0.0, 1.0, arm_x], [0.0, 0.0, 1.0]])
    covariance = there @ covariance @ there.T
    return Certainty(found[:2], covariance) if np.linalg.eigvalsh(covariance)[0] > 0.0 else None
