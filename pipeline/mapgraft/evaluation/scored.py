"""A trial held against the truth, in plain numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

from mapgraft.contracts import Match, Measurement, Transform
from mapgraft.evaluation.building import Pair
from mapgraft.evaluation.certainty import certainty, walls_middle
from mapgraft.evaluation.growth import Growth
from mapgraft.evaluation.statistics import Better
from mapgraft.evaluation.trial import Trial, Verdict
from mapgraft.evaluation.truth import Truth


@dataclass(frozen=True, slots=True)
class Placed:
    """A transform, whether it is right, and how far it is off as far as that can be told.

    ``error_m`` is the mean displacement of the donor's walls, ``error_px`` that of keypoints where the truth is told
    by them. Where the two maps do not belong together it is wrong and has no error.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    scale: float
    right: bool
    error_m: float | None = None
    error_deg: float | None = None
    error_px: float | None = None

    @classmethod
    def of(cls, T: Transform, scale: float, truth: Truth | None) -> Self:
        """Held against the truth, None where the two maps do not belong together."""
        pose = (T.x_m, T.y_m, T.yaw_rad, scale)
        if truth is None:
            return cls(*pose, right=False)
        error = truth.error(T, scale)
        return cls(*pose, error.right, error.displacement_m, error.rotation_deg)


@dataclass(frozen=True, slots=True)
class Scored:
    """What one procedure made of two maps, and whether it was right.

    ``overlap`` is None where the maps do not belong together. ``best`` is the matcher's first hypothesis, ``numbers``
    everything that was told or measured of it by name, and ``better`` says of those of which it is known which way
    they should go. ``accepted`` is the transform that was merged, ``final`` where the merge stood in the end, with its
    ``state``. ``sigma_max_m`` holds where the best hypothesis has a covariance, ``distance2`` where it is also right.
    Times in seconds: ``verified_s`` and ``integrated_s`` of each further scan, ``anew_s`` of each search that registers
    the merge anew.
    """

    overlap: float | None
    verdict: Verdict
    reason: str
    rule: str
    best: Placed | None
    numbers: Mapping[str, float]
    better: Mapping[str, Better]
    accepted: Placed | None = None
    state: str = ""
    state_reason: str = ""
    final: Placed | None = None
    later: Mapping[str, float] = field(default_factory=dict)
    walls_m: float | None = None
    distance2: float | None = None
    sigma_max_m: float | None = None
    match_s: float | None = None
    verified_s: tuple[float, ...] = ()
    integrated_s: tuple[float, ...] = ()
    anew_s: tuple[float, ...] = ()
    final_s: float | None = None

    @property
    def right(self) -> bool:
        """Whether the best hypothesis is right."""
        return self.best is not None and self.best.right

    @property
    def wrong(self) -> bool:
        """Whether there is a best hypothesis and it is wrong."""
        return self.best is not None and not self.best.right

    @property
    def merged_right(self) -> bool:
        return self.accepted is not None and self.accepted.right

    @property
    def merged_wrong(self) -> bool:
        return self.accepted is not None and not self.accepted.right

    @property
    def lies_wrong(self) -> bool:
        """Whether the merge lies wrong in the end, however it was accepted."""
        return self.final is not None and not self.final.right

    def shares(self, overlap: float) -> bool:
        """Whether the maps overlap by that much or more."""
        return self.overlap is not None and self.overlap >= overlap


def score(pair: Pair, trial: Trial, growth: Growth) -> Scored:
    """Hold a trial against the truth about its pair."""
    truth, match = pair.truth, trial.best
    best = None if match is None else Placed.of(match.T_receiver_donor, match.scale, truth)
    sure = None
    if match is not None:
        sure = certainty(match, walls_middle(truth, pair.donor.map_type, pair.donor.map))
    verified_s = zip(trial.observed_s, trial.searched_s, growth.integrated_s, strict=False)
    distance2 = None
    if match is not None and truth is not None and sure is not None and best is not None and best.right:
        distance2 = sure.distance2(truth, match)
    return Scored(
        overlap=None if truth is None else truth.overlap,
        verdict=trial.verdict,
        reason=trial.reason,
        rule=trial.rule,
        best=best,
        numbers={} if match is None else numbers_of(match, trial.measurements),
        better=better_of(trial.measurements),
        accepted=None if trial.T_accepted is None else Placed.of(trial.T_accepted, trial.scale, truth),
        state=trial.state,
        state_reason=trial.state_reason,
        final=None if trial.T_final is None else Placed.of(trial.T_final, trial.scale, truth),
        later=measured(trial.later),
        walls_m=growth.walls_m,
        distance2=distance2,
        sigma_max_m=None if sure is None else sure.sigma_max_m,
        match_s=trial.match_s,
        verified_s=tuple(observed - searched - integrated for observed, searched, integrated in verified_s),
        integrated_s=growth.integrated_s,
        anew_s=tuple(searched_s for searched_s in trial.searched_s if searched_s > 0.0),
        final_s=trial.final_s,
    )


def numbers_of(match: Match, measurements: Mapping[str, Measurement]) -> dict[str, float]:
    """Everything by which one could judge a match: score, margin, evidence, measurements and their details."""
    told = {"score": match.score, "margin": match.margin}
    told |= {f"evidence.{name}": value for name, value in match.evidence.items()}
    return {name: float(value) for name, value in told.items()} | measured(measurements)


def measured(measurements: Mapping[str, Measurement]) -> dict[str, float]:
    """The values of measurements by name, and their details as ``name.detail``."""
    numbers: dict[str, float] = {}
    for name, measurement in measurements.items():
        numbers[name] = float(measurement.value)
        numbers |= {f"{name}.{detail}": float(value) for detail, value in measurement.details.items()}
    return numbers


def better_of(measurements: Mapping[str, Measurement]) -> dict[str, Better]:
    """Which way the numbers of which that is known should go: score and margin by contract, metrics as they say.

    Of evidence and details nobody says it.
    """
    told: dict[str, Better] = {"score": "higher", "margin": "higher"}
    return told | {name: measurement.better for name, measurement in measurements.items()}
