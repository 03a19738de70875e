"""A person's hand: what was said beforehand about pairs of robots, and afterwards about merges."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from mapgraft.config import PriorConfig, VerdictConfig
from mapgraft.contracts import Covariance, Prior, Transform
from mapgraft.lives import base_name

SAME_PLACE_M, SAME_TURN_RAD = 0.5, math.radians(5.0)  # what a person would call the same place
RECORDED_SIGMA_M, RECORDED_SIGMA_YAW_RAD = 0.1, 0.02  # of relative poses that the recording itself tells


@dataclass(slots=True)
class Hand:
    """Priors by (receiver, donor), forbidden pairs (either way round), and verdicts.

    A verdict that remembers the transform a person judged goes with the transform, because the numbers of later merges
    change when an earlier one is taken out; one that does not goes with the merge's id. ``obeyed`` holds those that
    were applied.
    """

    priors: Mapping[tuple[str, str], Prior] = field(default_factory=dict)
    forbidden: frozenset[frozenset[str]] = frozenset()
    verdicts: Sequence[VerdictConfig] = ()
    obeyed: list[VerdictConfig] = field(default_factory=list)

    def forbids(self, receiver: str, donor: str) -> bool:
        """Whether this pair may not merge; what was said of a robot holds for all its lives."""
        pairs = product({receiver, base_name(receiver)}, {donor, base_name(donor)})
        return any(frozenset(pair) in self.forbidden for pair in pairs)

    def verdict_on(self, merge_id: str, T_receiver_donor: Transform, about_m: Sequence[float]) -> VerdictConfig | None:
        """What a person said of this merge, noted as obeyed; ``about_m`` is where the donor's map is, in its frame."""
        pair = merge_id.rpartition(".")[0]
        for verdict in self.verdicts:
            if verdict.T_receiver_donor is None:
                meant = verdict.merge == merge_id
            else:
                judged = Transform.from_matrix(np.reshape(verdict.T_receiver_donor, (4, 4)))
                meant = verdict.merge.rpartition(".")[0] == pair and same_place(judged, T_receiver_donor, about_m)
            if meant:
                self.obeyed.append(verdict)
                return verdict
        return None

    @property
    def disregarded(self) -> list[VerdictConfig]:
        """Verdicts on merges that did not come up."""
        return [verdict for verdict in self.verdicts if verdict not in self.obeyed]


def same_place(T_a: Transform, T_b: Transform, about_m: Sequence[float]) -> bool:
    """True when two transforms put the donor's map at the same place, for a person's eye.

    Compared where the donor's map is (``about_m`` x, y in its frame) and not at its origin, which may lie far off.
    """
    point = np.array([[about_m[0], about_m[1]]])
    shift_m = float(np.linalg.norm(T_a.apply(point) - T_b.apply(point)))
    return shift_m <= SAME_PLACE_M and T_a.difference(T_b)[1] <= SAME_TURN_RAD


def prior_of(config: PriorConfig) -> Prior:
    """The prior for the receiver that a person named."""
    T = Transform.planar(config.x_m, config.y_m, config.yaw_rad)
    return Prior(T, planar_covariance(config.sigma_m, config.sigma_yaw_rad), "given by a person")


def sigma_m(prior: Prior | None) -> float | None:
    """The greatest standard deviation of a prior's translation (m); None without one."""
    if prior is None:
        return None
    return math.sqrt(max(0.0, float(np.linalg.eigvalsh(prior.covariance[:3, :3])[-1])))


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
