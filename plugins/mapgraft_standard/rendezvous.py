"""What robots that saw each other say of a merge."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Comparison, ConfigError, Covariance, Measurement, Sighting, Step
from mapgraft_standard.limits import Check

NAME: Final = "rendezvous"
REFUTED: Final = -5.0  # nats: two sightings, each of which fits nowhere
TELLING: Final = 2.0  # nats: a place that fits, and would not by chance
_LEAST_AREA_M2: Final = 100.0
_S: Final = 1_000_000_000


class Rendezvous:
    """The log Bayes factor (nats) of where two robots saw each other, of this transform against any place on the map.

    Through the transform each sighting is predicted from where both robots knew themselves at that time. If the merge
    is right the measurement lies around the prediction, normally, with the sighting's own standard deviations, those
    of the match, and ``floor_m`` and ``floor_rad`` for what poses and clocks hide; a share ``outliers`` of sightings is
    of somebody else. If it is wrong, the other robot may have been anywhere on the receiver's map, turned anyhow.
    Sightings less than ``apart_s`` after the first of a group err together and count once, by their mean; all together
    say no more than ``most`` nats, either way.

    The value is NaN when the robots never saw each other as far as anybody told. The support is the number of groups.
    Details: ``sightings``, and of the one that fits least ``worst`` (nats) and ``worst_m``.

    Source: J. Ko, B. Stewart, D. Fox, K. Konolige, B. Limketkai, A practical, decision-theoretic approach to
    multi-robot mapping and exploration, IROS 2003: hypotheses on relative poses are verified by meeting.
    """

    def __init__(
        self,
        *,
        outliers: float = 0.05,
        floor_m: float = 0.1,
        floor_rad: float = 0.03,
        apart_s: float = 10.0,
        most: float = 8.0,
    ) -> None:
        if not (0.0 < outliers < 1.0 and floor_m > 0.0 and floor_rad > 0.0 and apart_s >= 0.0 and most > 0.0):
            raise ConfigError(
                "the metric rendezvous needs 0 < outliers < 1, floor_m > 0, floor_rad > 0, apart_s >= 0 and most > 0, "
                f"found {outliers=}, {floor_m=}, {floor_rad=}, {apart_s=}, {most=}"
            )
        self.outliers, self.floor_m, self.floor_rad = outliers, floor_m, floor_rad
        self.apart_ns, self.most = round(apart_s * _S), most

    def track(self, comparison: Comparison) -> _Tracker:
        return _Tracker(self, comparison)

    def log_bayes_factor(self, sighting: Sighting, comparison: Comparison, area_m2: float) -> tuple[float, float]:
        """That of one sighting (nats), and by how much the prediction misses it (m)."""
        residual, covariance = _residual(sighting, comparison)
        size = len(residual)
        covariance[:2, :2] += np.eye(2) * (sighting.sigma_m**2 + self.floor_m**2)
        if size == 3:
            covariance[2, 2] += sighting.sigma_yaw_rad**2 + self.floor_rad**2
        squared = float(residual @ np.linalg.solve(covariance, residual))
        log_normal = -0.5 * (squared + size * math.log(2.0 * math.pi) + float(np.linalg.slogdet(covariance)[1]))
        log_anywhere = -math.log(area_m2) - (math.log(2.0 * math.pi) if size == 3 else 0.0)
        hit = math.log1p(-self.outliers) + log_normal - log_anywhere
        miss = math.log(self.outliers)
        top = max(hit, miss)
        return top + math.log(math.exp(hit - top) + math.exp(miss - top)), math.hypot(residual[0], residual[1])


class _Tracker:
    """Follows what is told of meetings; how large the map was when it began is how little it could be by chance."""

    __slots__ = ("_area_m2", "_comparison", "_metric")

    def __init__(self, metric: Rendezvous, comparison: Comparison) -> None:
        self._metric, self._comparison = metric, comparison
        self._area_m2: float | None = None

    def update(self, step: Step) -> Measurement:
        sightings = self._comparison.sightings
        if not sightings:
            return Measurement(NAME, math.nan, "nats", 0, "higher")
        if self._area_m2 is None:
            self._area_m2 = _area_m2(self._comparison)
        told = [self._metric.log_bayes_factor(one, self._comparison, self._area_m2) for one in sightings]
        groups = _groups(sightings, self._metric.apart_ns)
        total = math.fsum(math.fsum(told[k][0] for k in group) / len(group) for group in groups)
        worst = min(told)
        details = {"sightings": float(len(told)), "worst": worst[0], "worst_m": worst[1]}
        value = max(-self._metric.most, min(self._metric.most, total))
        return Measurement(NAME, value, "nats", len(groups), "higher", details)


def told_by(measurements: Mapping[str, Measurement]) -> float:
    """What meetings say of a match (nats), 0 where there were none."""
    found = measurements.get(NAME)
    return found.value if found is not None and found.sufficient else 0.0


def refutations(measurements: Mapping[str, Measurement], refuted: float) -> Iterator[Check]:
    """A check that is not passed, where meetings say so much against a match."""
    told = told_by(measurements)
    if told <= refuted:
        yield Check(False, f"{NAME} {told:.4g} ≤ {refuted:.4g}")


def _groups(sightings: Sequence[Sighting], apart_ns: int) -> list[list[int]]:
    """Indices of sightings in the order of time, together as long as they are near the first one."""
    order = sorted(range(len(sightings)), key=lambda k: sightings[k].stamp_ns)
    groups: list[list[int]] = []
    for k in order:
        if groups and sightings[k].stamp_ns - sightings[groups[-1][0]].stamp_ns < apart_ns:
            groups[-1].append(k)
        else:
            groups.append([k])
    return groups


def _residual(sighting: Sighting, comparison: Comparison) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What was measured less what the transform predicts, in the frame of who saw; and how unsure the prediction is."""
    T, scale = comparison.T_receiver_donor, comparison.match.scale
    own, other = sighting.T_receiver_base.matrix, sighting.T_donor_base.matrix
    lever = T.matrix[:2, :2] @ other[:2, 3] * scale
    seen_m = lever + T.matrix[:2, 3]
    yaw_rad = T.yaw_rad + sighting.T_donor_base.yaw_rad
    from_yaw, from_m, to_m, to_yaw = sighting.T_receiver_base.yaw_rad, own[:2, 3], seen_m, yaw_rad
    if sighting.by_donor:
        from_yaw, from_m, to_m, to_yaw = yaw_rad, seen_m, own[:2, 3], from_yaw
    c, s = math.cos(from_yaw), math.sin(from_yaw)
    into = np.array([[c, s], [-s, c]])
    predicted = into @ (to_m - from_m)
    residual = [sighting.x_m - predicted[0], sighting.y_m - predicted[1]]
    jacobian = np.zeros((3, 3))  # of x, y, yaw by those of the transform, but for the sign
    jacobian[:2, :2] = into
    turned = (-lever[1], lever[0])
    jacobian[:2, 2] = into @ np.array(turned)
    if sighting.by_donor:  # the frame in which it is told turns with the transform, too
        jacobian[:2, 2] += np.array([-predicted[1], predicted[0]])
    jacobian[2, 2] = 1.0
    covariance = jacobian @ _planar(comparison.match.covariance) @ jacobian.T
    if math.isnan(sighting.yaw_rad):
        return np.array(residual), covariance[:2, :2].copy()
    turn = sighting.yaw_rad - (to_yaw - from_yaw)
    return np.array([*residual, math.atan2(math.sin(turn), math.cos(turn))]), covariance


def _planar(covariance: Covariance | None) -> NDArray[np.float64]:
    """x, y and yaw of a transform's covariance; zeros where nobody knows."""
    if covariance is None:
        return np.zeros((3, 3))
    wanted = [0, 1, 5]
    return np.array(covariance[np.ix_(wanted, wanted)], dtype=np.float64)


def _area_m2(comparison: Comparison) -> float:
    """Where the other robot may be by chance: the box around the receiver's map."""
    bounds = comparison.map_type.metadata(comparison.target_layer).bounds_m
    if bounds is None:
        return _LEAST_AREA_M2
    x0, y0, x1, y1 = bounds
    return max(_LEAST_AREA_M2, (x1 - x0) * (y1 - y0))
