"""What a prior leaves to be searched: a range of rotations, and an ellipse of places."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Prior, Transform

SIGMAS: Final = 3.5  # of the prior, to either side
FLOOR_M: Final = 0.3  # beyond these: what two maps may be off even where a prior is sure
FLOOR_RAD: Final = math.radians(1.5)


class Gate(NamedTuple):
    """Where the source's centre may come to lie (m, in the target's frame), and the yaws it may have there.

    ``half`` (2, 2) is the ellipse: places with dᵀ · half⁻¹ · d ≤ 1 are within.
    """

    place_m: NDArray[np.float64]
    half: NDArray[np.float64]
    yaw_rad: float
    half_yaw_rad: float

    @classmethod
    def of(cls, prior: Prior, centre_m: NDArray[np.float64]) -> Gate:
        """The gate of a prior: 3.5 standard deviations, and a little more.

        Raises MapError when its covariance is not (6, 6) and finite, with no negative variance.
        """
        covariance = np.asarray(prior.covariance, dtype=np.float64)
        if covariance.shape != (6, 6) or not np.isfinite(covariance).all() or (np.diag(covariance) < 0.0).any():
            raise MapError(
                "a prior needs a finite (6, 6) covariance of x, y, z, roll, pitch and yaw, "
                f"found shape {covariance.shape} with diagonal {np.diag(np.atleast_2d(covariance)).tolist()}"
            )
        T = prior.T_receiver_donor
        place = T.apply(centre_m[None])[0]
        of = np.zeros((2, 6))  # how place moves with x, y and yaw
        of[0, 0] = of[1, 1] = 1.0
        of[:, 5] = T.y_m - place[1], place[0] - T.x_m
        half = SIGMAS**2 * (of @ covariance @ of.T) + FLOOR_M**2 * np.eye(2)
        return cls(place, half, T.yaw_rad, SIGMAS * math.sqrt(covariance[5, 5]) + FLOOR_RAD)

    def admits(self, poses: NDArray[np.float64], slack_m: float = 0.0, slack_rad: float = 0.0) -> NDArray[np.bool_]:
        """Which of the poses (k, ≥ 3) of x, y and yaw lie within, or no farther out than the slack."""
        turn = np.abs(np.remainder(poses[:, 2] - self.yaw_rad + math.pi, 2.0 * math.pi) - math.pi)
        return self.admits_places(poses[:, :2], slack_m) & (turn <= self.half_yaw_rad + slack_rad)

    def admits_places(self, places: NDArray[np.float64], slack_m: float = 0.0) -> NDArray[np.bool_]:
        """Which of the places (k, 2) of the source's centre lie within, or no farther out than the slack."""
        off = places - self.place_m
        inside = np.linalg.inv(self.half + slack_m**2 * np.eye(2))
        near: NDArray[np.bool_] = np.einsum("ki,ij,kj->k", off, inside, off) <= 1.0
        return near

    def admits_yaw(self, yaw_rad: float, slack_rad: float = 0.0) -> bool:
        """Whether the yaw is within, or no farther out than the slack."""
        return abs(math.remainder(yaw_rad - self.yaw_rad, 2.0 * math.pi)) <= self.half_yaw_rad + slack_rad

    def clipped(self, wanted: Transform, otherwise: Transform, centre_m: NDArray[np.float64]) -> Transform:
        """The wanted transform if it is within, else the other."""
        pose = np.array([[*wanted.apply(centre_m[None])[0], wanted.yaw_rad]])
        return wanted if self.admits(pose)[0] else otherwise

    def lattice(self, step_m: float, step_rad: float, most: int) -> NDArray[np.float64] | None:
        """Poses (k, 4) with score 0 on a lattice that fill the gate; None when they are more than ``most``."""
        reach_m = np.sqrt(np.diag(self.half))
        counts = [*(np.floor(reach_m / step_m).tolist()), math.floor(min(self.half_yaw_rad, math.pi) / step_rad)]
        if math.prod(2.0 * count + 1.0 for count in counts) > 4.0 * most:
            return None
        axes = [
            step * np.arange(-count, count + 1) for step, count in zip((step_m, step_m, step_rad), counts, strict=True)
        ]
        mesh = np.stack([part.ravel() for part in np.meshgrid(*axes, indexing="ij")], axis=1)
        poses = np.column_stack((mesh + np.array([*self.place_m, self.yaw_rad]), np.zeros(len(mesh))))
        poses = poses[self.admits(poses)]
        return poses if len(poses) <= most else None
