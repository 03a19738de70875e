"""Putting walls onto each other, and how certain the result is."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Covariance
from mapgraft_lines.crossing import crossing_m
from mapgraft_lines.kernels import aligning
from mapgraft_lines.scene import TURN_COSINE, Scene

STAGES: Final = ((0.5, 0.2, 4), (0.3, 0.08, 4))  # walls within (m), scale of the robust loss (m), steps
CORRELATED_M: Final = 2.0  # of wall: a longer overlap is several observations, a shorter one part of one
PLACES_M: Final = 0.03  # both maps bend, and rooms are not quite straight: standard deviation beyond what walls tell
STILL_M, STILL_RAD = 5e-4, 5e-5  # a smaller step is the last one
FLAT: Final = 1e-3  # of the largest eigenvalue: what tells less does not move
YAW_CAP_RAD: Final = 1.0


class Fit(NamedTuple):
    """How certain an alignment is, and what it rests on.

    ``covariance`` (3, 3) of x, y, yaw, of where it brings the place ``about_m`` (in the target's centred frame);
    ``sigma_max_m`` the greatest standard deviation of the shift and ``direction_rad`` its direction in [0, π);
    ``pairs`` overlaps of walls, ``inlier_m`` their length, ``crossing_m`` the length of those that run across the rest,
    ``residual_m`` the root mean square of how far they are off.
    """

    covariance: NDArray[np.float64]
    about_m: NDArray[np.float64]
    sigma_max_m: float
    direction_rad: float
    pairs: int
    inlier_m: float
    crossing_m: float
    residual_m: float


def aligned(target: Scene, source: Scene, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The pose (3,) moved to where the walls lie on each other best; along what no wall tells it stays.

    Gauss-Newton on Geman and McClure's loss of the distances across the walls.
    """
    pose = pose.copy()
    for across_m, scale_m, steps in STAGES:
        for _ in range(steps):
            rows = _equations(target, source, pose, across_m)
            if not len(rows):
                return pose
            weights = _weights(rows) / (1.0 + (rows[:, 4] / scale_m) ** 2) ** 2
            about = weights @ rows[:, :2] / weights.sum()
            x, y, turn = _step(rows, weights, about).tolist()
            c, s = math.cos(turn), math.sin(turn)
            arm = pose[:2] - about
            pose[:2] = about + np.array([c * arm[0] - s * arm[1] + x, s * arm[0] + c * arm[1] + y])
            pose[2] = math.remainder(pose[2] + turn, math.tau)
            if math.hypot(x, y) < STILL_M and abs(turn) < STILL_RAD:
                break
    return pose


def fit_of(target: Scene, source: Scene, pose: NDArray[np.float64]) -> Fit | None:
    """How certain the pose is if it is right; None when no wall lies on another."""
    across_m, scale_m, _ = STAGES[-1]
    rows = _equations(target, source, pose, across_m)
    if not len(rows):
        return None
    robust = 1.0 / (1.0 + (rows[:, 4] / scale_m) ** 2) ** 2
    residual = math.sqrt(float(np.average(rows[:, 4] ** 2, weights=rows[:, 5] * robust)))
    weights = rows[:, 5] / CORRELATED_M * robust / (rows[:, 6] + residual**2 + PLACES_M**2)
    about = np.average(rows[:, :2], axis=0, weights=weights)
    lever = max(math.sqrt(float(np.average(((rows[:, :2] - about) ** 2).sum(axis=1), weights=weights))), 0.1)
    cap = np.array([target.extent_m, target.extent_m, YAW_CAP_RAD])
    scale = np.array([1.0, 1.0, 1.0 / lever])
    told = aligning.information(rows, weights, *about)[:, :3] * np.outer(scale, scale)
    covariance = np.linalg.inv(told + np.diag((cap / scale) ** -2)) * np.outer(scale, scale)
    values, vectors = np.linalg.eigh(covariance[:2, :2])
    return Fit(
        (covariance + covariance.T) / 2.0,
        about,
        math.sqrt(values[1]),
        math.atan2(vectors[1, 1], vectors[0, 1]) % math.pi,
        int(rows[-1, 7]) + 1,
        float(rows[:, 5].sum()),
        crossing_m(np.arctan2(rows[:, 3], rows[:, 2]), rows[:, 5]),
        residual,
    )


def planar_covariance(fit: Fit, pose: NDArray[np.float64], origin_m: NDArray[np.float64]) -> Covariance:
    """The (6, 6) covariance of T_target_source, whose source frame has its origin at ``origin_m`` in the target's
    centred frame.
    """
    jacobian = np.zeros((6, 3))
    jacobian[0, 0] = jacobian[1, 1] = jacobian[5, 2] = 1.0
    jacobian[:2, 2] = fit.about_m[1] - origin_m[1], origin_m[0] - fit.about_m[0]
    out = jacobian @ fit.covariance @ jacobian.T
    symmetric: Covariance = (out + out.T) / 2.0
    return symmetric


def _equations(target: Scene, source: Scene, pose: NDArray[np.float64], across_m: float) -> NDArray[np.float64]:
    rows: NDArray[np.float64] = aligning.equations(
        *(target.ends, target.faced, target.variance),
        *(source.ends, source.faced, source.variance),
        *(pose, across_m, TURN_COSINE),
    )
    return rows


def _weights(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    weights: NDArray[np.float64] = rows[:, 5] / (rows[:, 6] + PLACES_M**2)
    return weights


def _step(rows: NDArray[np.float64], weights: NDArray[np.float64], about: NDArray[np.float64]) -> NDArray[np.float64]:
    """The least squares step (3,) about a place, none in directions of which the walls tell nothing."""
    normal = aligning.information(rows, weights, *about)
    lever = max(math.sqrt(normal[2, 2] / max(normal[0, 0] + normal[1, 1], 1e-12)), 0.1)
    scale = np.array([1.0, 1.0, 1.0 / lever])
    values, vectors = np.linalg.eigh(normal[:, :3] * np.outer(scale, scale))
    inverse = np.where(values > FLAT * values[-1], 1.0 / np.maximum(values, 1e-300), 0.0)
    step: NDArray[np.float64] = scale * (vectors @ (inverse * (vectors.T @ (scale * normal[:, 3]))))
    return step
