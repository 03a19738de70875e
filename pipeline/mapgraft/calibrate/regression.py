"""From numbers to a score and from a score to a probability: regressions with few parameters, and how good they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]

LEAST_FOR_STEPS = 200  # scores: with fewer, steps follow chance, and a curve of two parameters is safer
_RIDGE = 1.0  # pseudo-observations that hold each coefficient of a standardised feature at 0
_CLOSEST = 1e-6  # no probability is nearer to 0 or 1 in a log loss


def logistic(
    features: Vector, right: NDArray[np.bool_], weights: Vector, ridge: float = _RIDGE
) -> tuple[Vector, float]:
    """Coefficients (k,), none of them negative, and intercept of the log-odds of what is right by ``features`` (n, k).

    ``weights`` (n,) say how much each counts. The features should be of one size and grow with what speaks for it.
    """
    from scipy.optimize import minimize

    n, k = features.shape
    design = np.column_stack((features, np.ones(n)))
    sign = np.where(right, 1.0, -1.0)
    total = float(weights.sum())

    def loss(parameters: Vector) -> tuple[float, Vector]:
        margin = sign * (design @ parameters)
        value = float((weights * np.logaddexp(0.0, -margin)).sum()) + 0.5 * ridge * float(
            parameters[:k] @ parameters[:k]
        )
        slope = -sign * weights * _probability(-margin)
        gradient = design.T @ slope
        gradient[:k] += ridge * parameters[:k]
        return value / total, gradient / total

    bounds = [(0.0, None)] * k + [(None, None)]
    found = minimize(loss, np.zeros(k + 1), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 1000})
    return found.x[:k], float(found.x[k])


def _probability(log_odds: Vector) -> Vector:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * log_odds)))


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """The probability of being right for a score, never falling: a logistic curve, or steps.

    ``scores`` and ``probabilities`` are the ends of the steps; a logistic curve has none, but ``slope`` and ``offset``.
    """

    kind: str
    slope: float = 0.0
    offset: float = 0.0
    scores: tuple[float, ...] = ()
    probabilities: tuple[float, ...] = ()

    def at(self, scores: ArrayLike) -> Vector:
        values = np.asarray(scores, np.float64)
        if self.kind == "logistic":
            return _probability(self.slope * values + self.offset)
        return np.interp(values, self.scores, self.probabilities)

    def reaches(self, probability: float) -> float:
        """The lowest score at which the probability is reached, infinite where none does.

        No score is as sure as 1, and none is needed for 0.
        """
        if not 0.0 < probability < 1.0:
            return -math.inf if probability <= 0.0 else math.inf
        if self.kind == "logistic":
            if self.slope <= 0.0:
                return math.inf
            return (math.log(probability / (1.0 - probability)) - self.offset) / self.slope
        reached = np.flatnonzero(np.asarray(self.probabilities) >= probability)
        return math.inf if not reached.size else float(self.scores[reached[0]])


def probability_curve(scores: ArrayLike, right: ArrayLike) -> Curve:
    """The probability of being right by score: steps (isotonic) from 200 scores on, else a logistic curve (Platt).

    The logistic curve is fitted to targets a little inside of 0 and 1: J. C. Platt, Probabilistic outputs for support
    vector machines (1999). The steps are those of pool adjacent violators, joined by straight lines.
    """
    values, is_right = _told(scores, right)
    if len(values) >= LEAST_FOR_STEPS and 0 < is_right.sum() < len(values):
        return _steps(values, is_right)
    return _platt(values, is_right)


def _told(scores: ArrayLike, right: ArrayLike) -> tuple[Vector, NDArray[np.bool_]]:
    values, is_right = np.asarray(scores, np.float64), np.asarray(right, np.bool_)
    told = np.isfinite(values)
    return values[told], is_right[told]


def _platt(values: Vector, right: NDArray[np.bool_]) -> Curve:
    from scipy.optimize import minimize

    rights, wrongs = int(right.sum()), int((~right).sum())
    target = np.where(right, (rights + 1.0) / (rights + 2.0), 1.0 / (wrongs + 2.0))
    middle = float(values.mean()) if len(values) else 0.0
    size = float(values.std()) if len(values) else 1.0
    size = size if size > 0.0 else 1.0
    given = (values - middle) / size

    def loss(parameters: Vector) -> tuple[float, Vector]:
        log_odds = parameters[0] * given + parameters[1]
        off = _probability(log_odds) - target
        value = float((np.logaddexp(0.0, log_odds) - target * log_odds).sum())
        return value, np.array([float((off * given).sum()), float(off.sum())])

    found = minimize(loss, np.zeros(2), jac=True, method="L-BFGS-B", bounds=[(0.0, None), (None, None)])
    slope = float(found.x[0]) / size
    return Curve("logistic", slope, float(found.x[1]) - slope * middle)


def _steps(values: Vector, right: NDArray[np.bool_]) -> Curve:
    """Pool adjacent violators: M. Ayer and others, Annals of Mathematical Statistics 26 (1955)."""
    order = np.argsort(values, kind="stable")
    blocks: list[list[float]] = []  # rights, count, lowest score, highest score
    scores, starts = np.unique(values[order], return_index=True)
    for place, score in enumerate(scores.tolist()):
        end = starts[place + 1] if place + 1 < len(starts) else len(values)
        here = right[order[starts[place] : end]]
        blocks.append([float(here.sum()), float(len(here)), score, score])
        while len(blocks) > 1 and blocks[-2][0] * blocks[-1][1] >= blocks[-1][0] * blocks[-2][1]:
            rights, count, _, high = blocks.pop()
            blocks[-1] = [blocks[-1][0] + rights, blocks[-1][1] + count, blocks[-1][2], high]
    least = 0.5 / (len(values) + 1.0)  # no step is surer than all labels together could make it
    sure = [min(max(b[0] / b[1], least), 1.0 - least) for b in blocks]
    ends = [
        (score, p) for b, p in zip(blocks, sure, strict=True) for score in ([b[2]] if b[2] == b[3] else [b[2], b[3]])
    ]
    return Curve("steps", scores=tuple(s for s, _ in ends), probabilities=tuple(p for _, p in ends))


@dataclass(frozen=True, slots=True)
class Bin:
    """Things of about the same probability: what was said, and how many of them were right."""

    said: float
    right: int
    of: int


def reliability(probabilities: ArrayLike, right: ArrayLike, bins: int = 10) -> list[Bin]:
    """How many are right of those with about the same probability; bins of as many each, as far as ties allow."""
    said, is_right = np.asarray(probabilities, np.float64), np.asarray(right, np.bool_)
    order = np.argsort(said, kind="stable")
    parts = np.array_split(order, min(bins, len(order)) or 1)
    return [Bin(float(said[part].mean()), int(is_right[part].sum()), len(part)) for part in parts if part.size]


def brier(probabilities: ArrayLike, right: ArrayLike) -> float:
    """The mean squared distance of the probabilities from what was true; NaN of nothing (G. W. Brier, 1950)."""
    said, is_right = np.asarray(probabilities, np.float64), np.asarray(right, np.float64)
    return float(((said - is_right) ** 2).mean()) if said.size else math.nan


def log_loss(probabilities: ArrayLike, right: ArrayLike) -> float:
    """The mean of -log of the probability of what was true, in nats; NaN of nothing."""
    said = np.clip(np.asarray(probabilities, np.float64), _CLOSEST, 1.0 - _CLOSEST)
    is_right = np.asarray(right, np.bool_)
    return float(-np.where(is_right, np.log(said), np.log1p(-said)).mean()) if said.size else math.nan
