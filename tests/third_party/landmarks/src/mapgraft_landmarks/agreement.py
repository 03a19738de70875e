"""The metric ``landmark_agreement``: which share of the landmarks that both robots could have seen, both have seen."""

from __future__ import annotations

import math

import numpy as np

from mapgraft.contracts import Comparison, ConfigError, Measurement, Step
from mapgraft_landmarks.hypotheses import mutual_pairs
from mapgraft_landmarks.landmarks import LandmarkMap, as_map

NAME = "landmark_agreement"


class LandmarkAgreement:
    """Counts landmarks of either map in places at which the other looked in at least ``looks_min`` scans.

    Such a landmark is confirmed when the other map has one within ``tolerance_m``, each used once. With fewer than
    ``support_min`` of them there is too little to measure.
    """

    def __init__(self, *, tolerance_m: float = 0.4, looks_min: int = 8, support_min: int = 3) -> None:
        if tolerance_m <= 0 or looks_min < 1 or support_min < 1:
            raise ConfigError(
                f"{NAME} needs tolerance_m > 0, looks_min ≥ 1 and support_min ≥ 1, "
                f"found {tolerance_m}, {looks_min} and {support_min}"
            )
        self._tolerance_m, self._looks_min, self._support_min = tolerance_m, looks_min, support_min

    def track(self, comparison: Comparison) -> _Agreement:
        return _Agreement(self, comparison)

    def measure(self, target: LandmarkMap, donor: LandmarkMap) -> Measurement:
        """The agreement of two maps in one frame: 1 when every landmark in the jointly seen place is confirmed."""
        a, b, _ = mutual_pairs(target.landmarks.positions_m, donor.landmarks.positions_m, self._tolerance_m)
        by_donor = donor.looks_at(target.landmarks.positions_m) >= self._looks_min
        by_target = target.looks_at(donor.landmarks.positions_m) >= self._looks_min
        by_donor[a], by_target[b] = True, True
        support = int(np.count_nonzero(by_donor)) + int(np.count_nonzero(by_target))
        confirmed = 2 * len(a)
        return Measurement(
            name=NAME,
            value=confirmed / support if support >= self._support_min else math.nan,
            unit="share",
            support=support,
            better="higher",
            details={
                "confirmed": float(confirmed),
                "denied_target": float(np.count_nonzero(by_donor) - len(a)),
                "denied_donor": float(np.count_nonzero(by_target) - len(a)),
            },
        )


class _Agreement:
    """The agreement of one comparison; measured anew only when something has changed."""

    def __init__(self, metric: LandmarkAgreement, comparison: Comparison) -> None:
        self._metric, self._comparison = metric, comparison
        self._last: Measurement | None = None

    def update(self, step: Step) -> Measurement:
        changed = step.touched is None or len(step.touched) > 0 or step.donor_changed
        if self._last is None or changed:
            self._last = self._metric.measure(as_map(self._comparison.target), as_map(self._comparison.donor))
        return self._last
