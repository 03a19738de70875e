"""What a robot believes about its way: odometry drifts without bound, SLAM errs a little and stays bounded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft_recordings.simulator.driving import Poses


@dataclass(frozen=True, slots=True)
class SlamError:
    """Errors of the SLAM poses: standard deviations, and the time over which they forget themselves."""

    sigma_m: float = 0.01
    sigma_yaw_rad: float = 0.003
    memory_s: float = 15.0


@dataclass(frozen=True, slots=True)
class OdometryError:
    """Errors of wheel odometry as shares of the way and of the turning: systematic ones, and noise of each step."""

    scale: float = 0.01
    turn_scale: float = 0.015
    noise: float = 0.02


def slam_poses(truth: Poses, period_s: float, error: SlamError, rng: np.random.Generator) -> Poses:
    """The true poses (n, 3), taken every ``period_s``, each moved by a first-order Gauss-Markov error; world frame."""
    kept = float(np.exp(-period_s / error.memory_s))
    fresh = rng.normal(0.0, 1.0, truth.shape) * np.array([error.sigma_m, error.sigma_m, error.sigma_yaw_rad])
    drift = np.empty_like(truth)
    drift[0] = fresh[0]
    for k in range(1, len(truth)):
        drift[k] = kept * drift[k - 1] + np.sqrt(1.0 - kept * kept) * fresh[k]
    believed: Poses = truth + drift
    return believed


def odometry_poses(truth: Poses, error: OdometryError, rng: np.random.Generator) -> Poses:
    """The way (n, 3) summed up from its own steps with their errors, starting at the identity."""
    scale = 1.0 + rng.normal(0.0, error.scale)
    turn_scale = 1.0 + rng.normal(0.0, error.turn_scale)
    c, s = np.cos(truth[:-1, 2]), np.sin(truth[:-1, 2])
    step = np.diff(truth, axis=0)
    ahead, aside = c * step[:, 0] + s * step[:, 1], c * step[:, 1] - s * step[:, 0]
    noise = 1.0 + rng.normal(0.0, error.noise, (len(step), 2))
    yaw = np.concatenate(([0.0], np.cumsum(step[:, 2] * turn_scale * noise[:, 1])))
    c, s = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    ahead, aside = ahead * scale * noise[:, 0], aside * scale
    x = np.concatenate(([0.0], np.cumsum(c * ahead - s * aside)))
    y = np.concatenate(([0.0], np.cumsum(s * ahead + c * aside)))
    return np.stack((x, y, yaw), axis=1)


def in_frame(T_target_source: NDArray[np.float64], poses: Poses) -> Poses:
    """Poses (n, 3) given in the source frame, seen from the target frame; the transform is x, y, yaw (3,)."""
    x, y, yaw = T_target_source
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack(
        (x + c * poses[:, 0] - s * poses[:, 1], y + s * poses[:, 0] + c * poses[:, 1], poses[:, 2] + yaw), axis=1
    )


def inverse(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse of a planar transform x, y, yaw (3,)."""
    x, y, yaw = pose
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([-c * x - s * y, s * x - c * y, -yaw])
