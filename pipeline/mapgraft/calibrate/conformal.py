"""Split-conformal thresholds: how high a score must be that wrong things reach it no more often than promised.

Nothing is assumed of the scores but that the next one is exchangeable with those that are known: V. Vovk, A. Gammerman
and G. Shafer, Algorithmic learning in a random world (2005). Things that come in groups are weighted so that groups
need be exchangeable only: R. Dunn, L. Wasserman and A. Ramdas, Distribution-free prediction sets for two-layer
hierarchical models, Journal of the American Statistical Association 118 (2023).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray


def needed(rate: float) -> int:
    """How many independent scores are needed at least that a threshold can promise the rate: 99 for 0.01."""
    return math.ceil(1 / _exact(rate)) - 1


def best_rate(count: int) -> float:
    """The lowest rate that so many independent scores can promise: 1 / (n + 1)."""
    return 1.0 / (count + 1)


def threshold(scores: ArrayLike, rate: float, units: Sequence[Hashable] | None = None) -> float:
    """The score above which at most the share ``rate`` of further scores lies.

    Of n ``scores`` (n,) it is the ceil((1 - rate)(n + 1))-th smallest, and infinite where there are too few of them:
    then nothing lies above. A further score that is exchangeable with them is greater with probability ``rate`` at
    most, over the drawing of all of them. Scores that cannot be told (NaN) count as infinite.

    ``units`` names what is exchangeable where that is not each score by itself: a building, or two robots that met
    several times. K units count the same, 1 / (K + 1) each, however many scores they have; the bound then is on a
    score drawn from a further unit.
    """
    values = np.asarray(scores, np.float64)
    values = np.where(np.isnan(values), np.inf, values)
    if values.size == 0:
        return math.inf
    if units is None:
        return _nth_smallest(values, rate)
    sizes: dict[Hashable, int] = {}
    for unit in units:
        sizes[unit] = sizes.get(unit, 0) + 1
    if len(sizes) == len(values):
        return _nth_smallest(values, rate)
    return _weighted(values, [Fraction(1, sizes[unit] * (len(sizes) + 1)) for unit in units], rate)


def _nth_smallest(values: NDArray[np.float64], rate: float) -> float:
    place = math.ceil((1 - _exact(rate)) * (len(values) + 1))
    return math.inf if place > len(values) else float(np.partition(values, place - 1)[place - 1])


def _weighted(values: NDArray[np.float64], weights: list[Fraction], rate: float) -> float:
    """The smallest score up to which the weights reach 1 - rate; what is missing to 1 lies at infinity."""
    target, reached = 1 - _exact(rate), Fraction(0)
    for place in np.argsort(values, kind="stable"):
        reached += weights[int(place)]
        if reached >= target:
            return float(values[place])
    return math.inf


def _exact(rate: float) -> Fraction:
    """The rate as it is written: 0.1 is a tenth, not the double beside it."""
    return Fraction(repr(float(rate)))
