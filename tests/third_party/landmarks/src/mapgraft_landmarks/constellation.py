"""The matcher ``constellation``: how the landmarks of two maps lie to each other, by the distances between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, Covariance, EmptyMapError, Map, Match, Points, Prior, Transform
from mapgraft_landmarks.hypotheses import Pairing, moved, propose, refine
from mapgraft_landmarks.landmarks import LandmarkMap, as_map

_BINS = 200  # proposals that are refined
_PLANAR = (0, 1, 5)  # x, y, yaw among x, y, z, roll, pitch, yaw
_POSITION_SIGMA_M = 0.05  # floor of a landmark's standard deviation: its cell evidence is a mean over viewpoints
_CHANCE = (1e-4, 0.5)  # limits of the chance that some landmark lies there by accident
_GATE = 16.3  # 99.9 % quantile of chi-square with 3 degrees of freedom


@dataclass(frozen=True, slots=True, eq=False)
class _Hypothesis:
    pairing: Pairing
    score: float
    joint: int
    denied: int


class Constellation:
    """Proposes poses by pairs of landmarks of equal distance, and scores what each map says of the other's landmarks.

    The score is a log likelihood ratio in nats: a landmark in the place that both maps looked at is either confirmed by
    the other map (probability ``seen_again`` under a right match, by accident otherwise) or denied. A place counts as
    looked at from ``looks_min`` scans. ``tolerance_m``: how far two sightings of one landmark may lie apart;
    ``pair_min_m``: shorter pairs propose nothing; ``landmarks_most``: of each map, the most sighted ones propose;
    ``pairs_min``: landmarks a hypothesis must bring together; ``separation_m``: hypotheses that move the source's
    landmarks less than this against each other (root mean square) are one; ``hypotheses_most``: returned at most.
    """

    def __init__(
        self,
        *,
        tolerance_m: float = 0.3,
        pair_min_m: float = 1.0,
        landmarks_most: int = 48,
        pairs_min: int = 3,
        seen_again: float = 0.9,
        looks_min: int = 8,
        separation_m: float = 1.0,
        hypotheses_most: int = 6,
    ) -> None:
        if pairs_min < 2 or hypotheses_most < 2 or landmarks_most < pairs_min or not 0.5 < seen_again < 1.0:
            raise ConfigError(
                "constellation needs pairs_min ≥ 2, hypotheses_most ≥ 2, landmarks_most ≥ pairs_min and seen_again in "
                f"(0.5, 1), found {pairs_min}, {hypotheses_most}, {landmarks_most} and {seen_again}"
            )
        if min(tolerance_m, pair_min_m, separation_m) <= 0:
            raise ConfigError("constellation needs positive tolerance_m, pair_min_m and separation_m")
        self._tolerance_m, self._pair_min_m = tolerance_m, pair_min_m
        self._landmarks_most, self._pairs_min = landmarks_most, pairs_min
        self._seen_again, self._looks_min = seen_again, looks_min
        self._separation_m, self._hypotheses_most = separation_m, hypotheses_most

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> list[Match]:
        """Hypotheses, best first; none when fewer than ``pairs_min`` landmarks can be brought together.

        With a prior only hypotheses within its 99.9 % region are returned.
        """
        ours, theirs = as_map(target), as_map(source)
        for side, map_ in (("receiver's", ours), ("donor's", theirs)):
            if not map_.known():
                raise EmptyMapError(f"the {side} landmark map is empty: it cannot be matched")
        if min(len(ours.landmarks), len(theirs.landmarks)) < self._pairs_min:
            return []
        hypotheses = self._hypotheses(ours, theirs)
        covariances = [_covariance(h.pairing, theirs.landmarks.positions_m) for h in hypotheses]
        found = list(zip(hypotheses, covariances, strict=True))
        if prior is not None:
            found = [(h, c) for h, c in found if _agrees(h.pairing.pose, c, prior)]
        scores = [h.score for h, _ in found]
        return [
            _match(h, c, max(scores[:rank] + scores[rank + 1 :], default=-math.inf))
            for rank, (h, c) in enumerate(found[: self._hypotheses_most])
        ]

    def _hypotheses(self, ours: LandmarkMap, theirs: LandmarkMap) -> list[_Hypothesis]:
        """Distinct hypotheses, best first; of equal scores the more compact pairing, then the earlier proposal."""
        target = ours.landmarks.strongest(self._landmarks_most).positions_m
        source = theirs.landmarks.strongest(self._landmarks_most).positions_m
        proposals = propose(target, source, self._tolerance_m, self._pair_min_m, _BINS)
        all_ours, all_theirs = ours.landmarks.positions_m, theirs.landmarks.positions_m
        pairings = [refine(all_ours, all_theirs, pose, self._tolerance_m) for pose in proposals]
        scored = [self._scored(ours, theirs, p) for p in pairings if len(p.target) >= self._pairs_min]
        scored.sort(key=lambda h: (-h.score, float(h.pairing.residuals_m.mean())))
        distinct: list[_Hypothesis] = []
        places: list[Points] = []
        for hypothesis in scored:
            placed = moved(all_theirs, hypothesis.pairing.pose)
            if all(_rms_m(placed - other) > self._separation_m for other in places):
                distinct.append(hypothesis)
                places.append(placed)
        return distinct

    def _scored(self, ours: LandmarkMap, theirs: LandmarkMap, pairing: Pairing) -> _Hypothesis:
        back = _inverse(pairing.pose)
        seen_by_them = theirs.looks_at(moved(ours.landmarks.positions_m, back)) >= self._looks_min
        seen_by_us = ours.looks_at(moved(theirs.landmarks.positions_m, pairing.pose)) >= self._looks_min
        seen_by_them[pairing.target] = True
        seen_by_us[pairing.source] = True
        confirmed = len(pairing.target)
        denied_ours, denied_theirs = int(seen_by_them.sum()) - confirmed, int(seen_by_us.sum()) - confirmed
        # both maps tell much the same: their mean
        gain_ours = self._gain(confirmed, denied_ours, self._chance(theirs))
        gain_theirs = self._gain(confirmed, denied_theirs, self._chance(ours))
        denied = denied_ours + denied_theirs
        return _Hypothesis(pairing, (gain_ours + gain_theirs) / 2.0, confirmed + denied, denied)

    def _gain(self, confirmed: int, denied: int, chance: float) -> float:
        yes = math.log(self._seen_again / chance)
        no = math.log((1.0 - self._seen_again) / (1.0 - chance))
        return confirmed * yes + denied * no

    def _chance(self, map_: LandmarkMap) -> float:
        """The chance that a landmark of this map lies within the tolerance of any place it looked at."""
        density = len(map_.landmarks) / (map_.known() * map_.cell_m**2)
        chance = 1.0 - math.exp(-density * math.pi * self._tolerance_m**2)
        return min(max(chance, _CHANCE[0]), _CHANCE[1])


def _match(hypothesis: _Hypothesis, covariance: Covariance, other_score: float) -> Match:
    pairing = hypothesis.pairing
    x_m, y_m, yaw_rad = (float(value) for value in pairing.pose)
    return Match(
        Transform.planar(x_m, y_m, yaw_rad),
        score=hypothesis.score,
        margin=hypothesis.score - other_score,
        covariance=covariance,
        evidence={
            "pairs": float(len(pairing.target)),
            "joint": float(hypothesis.joint),
            "denied": float(hypothesis.denied),
            "residual_m": _rms_m(pairing.residuals_m[:, None]),
        },
    )


def _covariance(pairing: Pairing, source: Points) -> Covariance:
    """Of the least-squares pose, from the spread of its residuals; z, roll and pitch are known (0)."""
    pose = pairing.pose
    arms = moved(source[pairing.source], np.array([0.0, 0.0, pose[2]]))
    variance = max(float((pairing.residuals_m**2).sum()) / max(2 * len(arms) - 3, 1), _POSITION_SIGMA_M**2)
    information = np.zeros((3, 3))
    for x, y in arms:
        jacobian = np.array([[1.0, 0.0, -y], [0.0, 1.0, x]])
        information += jacobian.T @ jacobian
    covariance = np.zeros((6, 6))
    inverse = np.linalg.inv(information)
    covariance[np.ix_(_PLANAR, _PLANAR)] = variance * (inverse + inverse.T) / 2.0  # symmetric to the last bit
    return covariance


def _agrees(pose: NDArray[np.float64], covariance: Covariance, prior: Prior) -> bool:
    """Whether a hypothesis lies where the prior expects it, both with their uncertainty."""
    expected = prior.T_receiver_donor
    turn = math.remainder(pose[2] - expected.yaw_rad, math.tau)
    off = np.array([pose[0] - expected.x_m, pose[1] - expected.y_m, turn])
    spread = (covariance + prior.covariance)[np.ix_(_PLANAR, _PLANAR)]
    return bool(off @ np.linalg.solve(spread, off) <= _GATE)


def _inverse(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = moved(pose[None, :2], np.array([0.0, 0.0, -pose[2]]))[0]
    return np.array([-x, -y, -pose[2]])


def _rms_m(offsets: NDArray[np.float64]) -> float:
    return float(np.sqrt((offsets**2).sum(axis=1).mean()))
