"""How well a score tells right from wrong: curves over all thresholds, and how honest the probabilities of it are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mapgraft.calibrate.labelled import Labelled
from mapgraft.calibrate.regression import Bin, Curve, Vector, brier, log_loss, probability_curve, reliability
from mapgraft.calibrate.scoring import Choose, Score
from mapgraft.evaluation.statistics import Area, area, resampled


@dataclass(frozen=True, slots=True)
class Point:
    """One threshold: what share of the wrong and of the right ones, and of what is accepted, is above it."""

    score: float
    wrong: float
    right: float
    precision: float


@dataclass(frozen=True, slots=True, eq=False)
class Honesty:
    """Probabilities of examples whose building took no part in fitting them, against what was true."""

    examples: int
    right: int
    brier: float
    brier_of_share: float
    log_loss: float
    log_loss_of_share: float
    bins: Sequence[Bin]


@dataclass(frozen=True, slots=True, eq=False)
class Quality:
    """``area`` is under the receiver operating characteristic, ``points`` the curve, ``curve`` the probability of being
    right by score; ``honesty`` is None where no two buildings can test each other."""

    area: Area
    points: Sequence[Point]
    curve: Curve
    honesty: Honesty | None


def quality(examples: Sequence[Labelled], score: Score, choose: Choose) -> Quality:
    """What is known of a score; ``choose`` makes one of the examples of some buildings."""
    known = [example for example in examples if example.right is not None]
    right = np.array([example.right for example in known], np.bool_)
    scores = np.nan_to_num(score.all(known), nan=-np.inf)
    places = {name: number for number, name in enumerate(sorted({str(example.unit) for example in known}))}
    weights = resampled([places[str(example.unit)] for example in known], seed=0)
    return Quality(
        area(scores, right, weights, "higher"),
        points(scores, right),
        probability_curve(scores, right),
        _honesty(known, choose),
    )


def points(scores: Vector, right: np.ndarray) -> list[Point]:
    """The curve from the highest threshold, which takes nothing, to the lowest, in the order of thresholds."""
    out = [Point(math.inf, 0.0, 0.0, math.nan)]
    order = np.argsort(-scores, kind="stable")
    rights, wrongs = np.cumsum(right[order]), np.cumsum(~right[order])
    ranked = scores[order]
    last = np.append(ranked[1:] != ranked[:-1], len(order) > 0)
    for place in np.flatnonzero(last).tolist():
        took_right, took_wrong = int(rights[place]), int(wrongs[place])
        out.append(
            Point(
                float(ranked[place]),
                took_wrong / max(1, int(wrongs[-1])),
                took_right / max(1, int(rights[-1])),
                took_right / (took_right + took_wrong),
            )
        )
    return out


def _honesty(known: Sequence[Labelled], choose: Choose) -> Honesty | None:
    """Leave each building out in turn, and ask the others for the probability of its examples."""
    said: list[float] = []
    right: list[bool] = []
    for building in sorted({name for example in known for name in example.buildings}):
        others = [example for example in known if building not in example.buildings]
        here = [example for example in known if example.environment == building]
        score, setting = choose(others)
        told = {example.right for example in setting}
        if not here or told != {True, False}:
            continue
        curve = probability_curve(score.all(setting), [bool(example.right) for example in setting])
        scores = score.all(here)
        said += np.where(np.isnan(scores), 0.0, curve.at(np.nan_to_num(scores))).tolist()
        right += [bool(example.right) for example in here]
    if not said:
        return None
    share = [sum(right) / len(right)] * len(right)
    return Honesty(
        len(said),
        sum(right),
        brier(said, right),
        brier(share, right),
        log_loss(said, right),
        log_loss(share, right),
        reliability(said, right),
    )
