"""Shares and areas under curves with 95 % intervals, by bootstrap over blocks of what was drawn together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

RESAMPLES = 1000
LEVEL = 0.95
_TAILS = ((1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0)

Better = Literal["higher", "lower"]
Weights = NDArray[np.float64]  # (resamples, n) how often each thing was drawn in each resample


@dataclass(frozen=True, slots=True)
class Share:
    """``count`` of ``of`` things, their share and its interval; NaN where there is nothing to count."""

    count: int
    of: int
    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Area:
    """How well a number tells right from wrong, with its interval; NaN where one of the two is missing.

    The area under the receiver operating characteristic: the share of pairs of one right and one wrong thing of which
    the right one has the better number, ties counted half. ``better`` says which that is, ``told`` whether that was
    known beforehand; if not it is the one that tells more, and the area at least .5. ``right`` and ``wrong`` say how
    many of each had the number. Where no resample can differ, as where every right thing has a better number than every
    wrong one, the interval is what the smaller of the two counts allows (``_unvaried``).
    """

    right: int
    wrong: int
    value: float
    low: float
    high: float
    better: Better = "higher"
    told: bool = True


@dataclass(frozen=True, slots=True)
class Spread:
    """The median, the 95th percentile and the largest of ``count`` numbers; NaN where there is none."""

    count: int
    median: float
    p95: float
    largest: float


def resampled(blocks: ArrayLike, seed: int, resamples: int = RESAMPLES) -> Weights:
    """How often each of n things is drawn when the blocks they come from are drawn anew, with replacement.

    ``blocks`` (n,) or (n, k) names the blocks of each thing, by any integers: what was made of windows of k blocks is
    there as often as the product of how often each is (A. B. Owen, The pigeonhole bootstrap, Annals of Applied
    Statistics 1, 2007: intervals come out a little wide rather than narrow).
    """
    given = np.asarray(blocks, np.int64)
    given = given[:, None] if given.ndim == 1 else given
    names, members = np.unique(given, return_inverse=True)
    members = members.reshape(given.shape)
    if not names.size:
        return np.ones((resamples, 0))
    rng = np.random.default_rng([seed, names.size])
    drawn = rng.multinomial(names.size, np.full(names.size, 1.0 / names.size), resamples).astype(np.float64)
    weights: Weights = np.ones((resamples, len(given)))
    for column in members.T:
        weights *= drawn[:, column]
    return weights


def share(hits: ArrayLike, among: ArrayLike, weights: Weights) -> Share:
    """The share of ``hits`` (n,) bool in those ``among`` (n,) bool.

    Where none or all are hits no resample can differ: then the interval is that of Clopper and Pearson, as if the
    things had nothing to do with each other.
    """
    inside = np.asarray(among, np.bool_)
    hit = np.asarray(hits, np.bool_) & inside
    count, of = int(hit.sum()), int(inside.sum())
    if of == 0:
        return Share(0, 0, math.nan, math.nan, math.nan)
    if count in (0, of):
        low, high = clopper_pearson(count, of)
        return Share(count, of, count / of, low, high)
    total = weights[:, inside].sum(axis=1)
    some = total > 0.0
    shares = weights[:, hit].sum(axis=1)[some] / total[some]
    low, high = _percentiles(shares)
    return Share(count, of, count / of, low, high)


def clopper_pearson(count: int, of: int) -> tuple[float, float]:
    """The exact interval of a share when none or all of ``of`` independent things are hits."""
    tail = (1.0 - LEVEL) / 2.0
    if of < 1 or count not in (0, of):
        raise ValueError(f"this interval is for none or all of at least one thing, found {count} of {of}")
    bound: float = tail ** (1.0 / of)
    return (0.0, 1.0 - bound) if count == 0 else (bound, 1.0)


def area(values: ArrayLike, right: ArrayLike, weights: Weights, better: Better | None = None) -> Area:
    """The area under the curve of ``values`` (n,) for telling the things that are ``right`` (n,) bool from the others.

    Without ``better`` it is found out which way the values tell more. Things whose value is NaN are left out.
    """
    higher = _area(values, right, weights)
    lower = replace(higher, value=1.0 - higher.value, low=1.0 - higher.high, high=1.0 - higher.low, better="lower")
    if better is not None:
        return lower if better == "lower" else higher
    return replace(lower if lower.value > higher.value else higher, told=False)


def _area(values: ArrayLike, right: ArrayLike, weights: Weights) -> Area:
    """The area where more is better."""
    given, is_right = np.asarray(values, np.float64), np.asarray(right, np.bool_)
    there = ~np.isnan(given)
    given, is_right, weights = given[there], is_right[there], weights[:, there]
    count = int(is_right.sum())
    if count in (0, len(given)):
        return Area(count, len(given) - count, math.nan, math.nan, math.nan)
    areas = _areas(given, is_right, np.vstack((np.ones(len(given)), weights)))
    wrong, value = len(given) - count, float(areas[0])
    low, high = _percentiles(areas[1:][~np.isnan(areas[1:])])
    if low == high:
        low, high = _unvaried(value, min(count, wrong))
    return Area(count, wrong, value, low, high)


def _unvaried(value: float, pairs: int) -> tuple[float, float]:
    """The interval of an area in which all resamples agree.

    So many ``pairs`` of one right and one wrong thing can be made of which no two share a thing, and all went alike.
    By Clopper and Pearson at least the share ``bound`` of all pairs goes as these did, and the others as they will.
    """
    bound, _ = clopper_pearson(pairs, pairs)
    return bound * value, 1.0 - bound * (1.0 - value)


def _areas(values: NDArray[np.float64], right: NDArray[np.bool_], weights: Weights) -> NDArray[np.float64]:
    """The area (r,) with each row of weights; NaN where a row holds only right or only wrong things."""
    order = np.argsort(values, kind="stable")
    ranked = values[order]
    starts = np.flatnonzero(np.append(True, ranked[1:] != ranked[:-1]))
    weights = weights[:, order]
    rights = np.add.reduceat(weights * right[order], starts, axis=1)
    wrongs = np.add.reduceat(weights * ~right[order], starts, axis=1)
    below = np.cumsum(wrongs, axis=1) - 0.5 * wrongs
    both = rights.sum(axis=1) * wrongs.sum(axis=1)
    won = (rights * below).sum(axis=1)
    found: NDArray[np.float64] = np.divide(won, both, out=np.full(len(won), np.nan), where=both > 0.0)
    return found


def spread(values: ArrayLike) -> Spread:
    """The median and the 95th percentile of the values that are not NaN."""
    given = np.asarray(values, np.float64)
    given = given[~np.isnan(given)]
    if not given.size:
        return Spread(0, math.nan, math.nan, math.nan)
    median, p95, largest = np.quantile(given, (0.5, 0.95, 1.0)).tolist()
    return Spread(len(given), median, p95, largest)


def _percentiles(values: NDArray[np.float64]) -> tuple[float, float]:
    if not values.size:
        return math.nan, math.nan
    low, high = np.quantile(values, _TAILS).tolist()
    return low, high
