"""What a prior leaves to be searched: a range of rotations, and an ellipse of places."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Prior

SIGMAS: Final = 3.5  # of the prior, to either side
FLOOR_M: Final = 0.3  # beyond these: what two maps may be off even where a prior is sure
FLOOR_RAD: Final = math.radians(1.5)


class Gate(NamedTuple):
    """Where the source's centre may come to lie (m, in the target's frame), and the yaws it may have there.

    ``shape`` (2, 2) is the ellipse: places with dᵀ · shape⁻¹ · d ≤ 1 are within. ``pose`` is the prior's own x, y, yaw.
    """

    centre_m: NDArray[np.float64]
    place_m: NDArray[np.float64]
    shape: NDArray[np.float64]
    half_yaw_rad: float
    pose: NDArray[np.float64]

    @classmethod
    def of(cls, prior: Prior, centre_m: NDArray[np.float64]) -> Gate:
        """The gate of a prior about the centre of the source; MapError when its covariance is not (6, 6) and finite."""
        covariance = np.asarray(prior.covariance, np.float64)
        if covariance.shape != (6, 6) or not np.isfinite(covariance).all() or (np.diag(covariance) < 0.0).any():
            raise MapError(
                f"a prior needs a finite (6, 6) covariance without negative variances, found shape {covariance.shape}"
            )
        T = prior.T_receiver_donor
        place = T.apply(centre_m[None])[0]
        moves = np.zeros((2, 6))  # how the place moves with x, y and yaw
        moves[0, 0] = moves[1, 1] = 1.0
        moves[:, 5] = T.y_m - place[1], place[0] - T.x_m
        shape = SIGMAS**2 * (moves @ covariance @ moves.T) + FLOOR_M**2 * np.eye(2)
        half_yaw = SIGMAS * math.sqrt(covariance[5, 5]) + FLOOR_RAD
        return cls(centre_m, place, shape, half_yaw, np.array([T.x_m, T.y_m, T.yaw_rad]))

    def admits(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which of the poses (k, 3) x, y, yaw of T_target_source bring the centre within, at a yaw within."""
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x, y = self.centre_m
        places = np.column_stack((c * x - s * y + poses[:, 0], s * x + c * y + poses[:, 1]))
        turn = np.abs(np.remainder(poses[:, 2] - self.pose[2] + math.pi, math.tau) - math.pi)
        within: NDArray[np.bool_] = self.admits_places(places) & (turn <= self.half_yaw_rad)
        return within

    def admits_places(self, places: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which of the places (k, 2) of the source's centre lie within."""
        off = places - self.place_m
        near: NDArray[np.bool_] = np.einsum("ki,ij,kj->k", off, np.linalg.inv(self.shape), off) <= 1.0
        return near
