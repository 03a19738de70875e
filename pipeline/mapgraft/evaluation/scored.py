"""A trial held against the truth, in plain numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mapgraft.contracts import Match, Measurement, Transform
from mapgraft.evaluation.building import Pair
from mapgraft.evaluation.certainty import certainty
from mapgraft.evaluation.growth import Growth
from mapgraft.evaluation.trial import Trial, Verdict
from mapgraft.evaluation.truth import Error


@dataclass(frozen=True, slots=True)
class Placed:
    """A transform with its error; ``error`` is None where the two maps do not belong together: then it is wrong."""

    x_m: float
    y_m: float
    yaw_rad: float
    scale: float
    error: Error | None

    @property
    def right(self) -> bool:
        return self.error is not None and self.error.right


@dataclass(frozen=True, slots=True)
class Scored:
    """What one procedure made of two maps, and whether it was right.

    ``overlap`` is None where the maps do not belong together. ``best`` is the matcher's first hypothesis, ``numbers``
    everything that was told or measured of it by name, and ``lower`` names those that should be low. ``accepted`` is
    the transform that was merged, ``final`` where the merge stood in the end, with its ``state``. ``distance2`` and
    ``sigma_max_m`` hold where the best hypothesis is right and has a covariance. Times in seconds, per further scan
    where there are several.
    """

    overlap: float | None
    verdict: Verdict
    reason: str
    rule: str
    best: Placed | None
    numbers: Mapping[str, float]
    lower: frozenset[str]
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
    best = None if trial.best is None else _placed(pair, trial.best.T_receiver_donor, trial.best.scale)
    sure = None
    if best is not None and best.right and trial.best is not None and pair.truth is not None:
        sure = certainty(pair.truth, trial.best)
    verified_s = zip(trial.observed_s, growth.integrated_s, strict=False)
    return Scored(
        overlap=None if pair.truth is None else pair.truth.overlap,
        verdict=trial.verdict,
        reason=trial.reason,
        rule=trial.rule,
        best=best,
        numbers={} if trial.best is None else numbers_of(trial.best, trial.measurements),
        lower=frozenset(m.name for m in trial.measurements.values() if m.better == "lower"),
        accepted=None if trial.T_accepted is None else _placed(pair, trial.T_accepted, trial.scale),
        state=trial.state,
        state_reason=trial.state_reason,
        final=None if trial.T_final is None else _placed(pair, trial.T_final, trial.scale),
        later=measured(trial.later),
        walls_m=growth.walls_m,
        distance2=None if sure is None else sure.distance2,
        sigma_max_m=None if sure is None else sure.sigma_max_m,
        match_s=trial.match_s,
        verified_s=tuple(observed - integrated for observed, integrated in verified_s),
        integrated_s=growth.integrated_s,
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


def _placed(pair: Pair, T: Transform, scale: float) -> Placed:
    error = None if pair.truth is None else pair.truth.error(T, scale)
    return Placed(T.x_m, T.y_m, T.yaw_rad, scale, error)
