"""A person's hand: what was said beforehand about pairs of robots, and afterwards about merges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mapgraft.config import PriorConfig, VerdictConfig
from mapgraft.contracts import Covariance, Prior, Transform

RECORDED_SIGMA_M, RECORDED_SIGMA_YAW_RAD = 0.1, 0.02  # of relative poses that the recording itself tells


@dataclass(frozen=True, slots=True)
class Hand:
    """Priors by (receiver, donor), forbidden pairs (either way round), and verdicts by merge id."""

    priors: Mapping[tuple[str, str], Prior] = field(default_factory=dict)
    forbidden: frozenset[frozenset[str]] = frozenset()
    verdicts: Mapping[str, VerdictConfig] = field(default_factory=dict)

    def forbids(self, receiver: str, donor: str) -> bool:
        return frozenset((receiver, donor)) in self.forbidden


def prior_of(config: PriorConfig) -> Prior:
    """The prior for the receiver that a person named."""
    T = Transform.planar(config.x_m, config.y_m, config.yaw_rad)
    return Prior(T, planar_covariance(config.sigma_m, config.sigma_yaw_rad), "given by a person")


def planar_covariance(sigma_m: float, sigma_yaw_rad: float) -> Covariance:
    """A (6, 6) covariance that knows z, roll and pitch: their rows are zero."""
    covariance = np.zeros((6, 6))
    covariance[0, 0] = covariance[1, 1] = sigma_m**2
    covariance[5, 5] = sigma_yaw_rad**2
    return covariance


def inverse_prior(prior: Prior) -> Prior:
    """The same knowledge seen from the other robot; the planar covariance is carried over to first order."""
    T = prior.T_receiver_donor
    c, s = math.cos(T.yaw_rad), math.sin(T.yaw_rad)
    jacobian = np.zeros((6, 6))
    jacobian[0, [0, 1, 5]] = -c, -s, s * T.x_m - c * T.y_m
    jacobian[1, [0, 1, 5]] = s, -c, c * T.x_m + s * T.y_m
    jacobian[5, 5] = -1.0
    return Prior(T.inverse(), jacobian @ prior.covariance @ jacobian.T, prior.origin)


def recorded_priors(T_world_map: Mapping[str, Transform]) -> dict[tuple[str, str], Prior]:
    """Priors for every pair of robots whose map frames the recording itself places in one world."""
    covariance = planar_covariance(RECORDED_SIGMA_M, RECORDED_SIGMA_YAW_RAD)
    return {
        (receiver, donor): Prior(T_receiver.inverse() @ T_donor, covariance, "told by the recording")
        for receiver, T_receiver in T_world_map.items()
        for donor, T_donor in T_world_map.items()
        if receiver != donor
    }


def given_priors(configs: list[PriorConfig]) -> dict[tuple[str, str], Prior]:
    """What persons said, both ways round; the direct word goes before one turned around."""
    priors: dict[tuple[str, str], Prior] = {}
    for config in configs:
        priors[config.donor, config.receiver] = inverse_prior(prior_of(config))
    for config in configs:
        priors[config.receiver, config.donor] = prior_of(config)
    return priors
