"""How well wrong merges can be told: curves, areas under them, and thresholds, here and where they were not chosen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.config import ReversalName
from mapgraft.evaluation.evaluating import blocks_of
from mapgraft.evaluation.statistics import Area, Better, Weights, area, clopper_pearson, resampled
from mapgraft.experiments.andersone2021.outcome import Experiment, Merge
from mapgraft.experiments.andersone2021.settings import METRICS, STRATEGIES, Combination
from mapgraft.experiments.andersone2021.telling.as_published import MOMENTS, of

POOLED: Final = "together"
WATCHED: Final = "watched"  # where numbers are our own rules' and not of a way of keeping the merge
OURS: Final = ("verifier.log_odds_wrong", "posterior", "contradiction")  # what our verifier judges by
_LEAST: Final = 2  # of each kind that have a number, for a curve to say something

Values = NDArray[np.float64]  # (n,) one number per merge, NaN where it has none
Kinds = NDArray[np.bool_]  # (n,) whether a merge is right


@dataclass(frozen=True, slots=True)
class Threshold:
    """A merge is called wrong when its number is worse than ``value``: below it, or above it where less is better.

    ``false_positives`` are right merges that are called wrong, ``false_negatives`` wrong ones that are not, ``of``
    merges that have the number.
    """

    value: float
    better: Better
    false_positives: int
    false_negatives: int
    of: int

    @property
    def errors(self) -> int:
        return self.false_positives + self.false_negatives


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """How well one number tells wrong merges of a group.

    The interval of the ``area`` is by bootstrap over stretches of the recordings; where right and wrong do not overlap
    no resample can differ, and it is that of Clopper and Pearson for as many pairs of a right and a wrong merge as can
    be made of different draws. ``source`` is how the merge was kept, or ``watched``. ``points`` (k, 2) are the shares
    of right and of wrong merges that are called wrong, from none to all. ``missing`` merges do not have the number.
    """

    number: str
    moment: str
    source: str
    group: str
    area: Area
    threshold: Threshold
    points: NDArray[np.float64]
    missing: int


def judged(values: Values, right: Kinds, threshold: float | Values, better: Better) -> Threshold:
    """Count what a threshold gets wrong; it may be another one for every merge, and is then told as NaN."""
    there = ~np.isnan(values)
    limits = np.broadcast_to(np.asarray(threshold, np.float64), values.shape)
    worse = values > limits if better == "lower" else values < limits
    told = float(threshold) if isinstance(threshold, float) else math.nan
    counts = int((worse & right & there).sum()), int((~worse & ~right & there).sum())
    return Threshold(told, better, *counts, int(there.sum()))


def best_threshold(values: Values, right: Kinds, better: Better) -> Threshold:
    """The threshold with fewest false positives and false negatives together.

    It lies in the middle between two neighbouring values, or calls nothing or everything wrong. Of several as good the
    one with fewest false negatives is taken, of those the one in the widest gap between values, of those the one that
    calls most merges wrong. NaN where no merge has the number.
    """
    there = ~np.isnan(values)
    bad = values[there] if better == "lower" else -values[there]
    if not bad.size:
        return Threshold(math.nan, better, 0, 0, 0)
    is_right = right[there]
    levels = np.unique(bad)
    middles = levels[:-1] + np.diff(levels) / 2.0
    limits = np.concatenate(([np.nextafter(levels[0], -np.inf)], middles, [levels[-1]]))
    gaps = np.concatenate(([0.0], np.diff(levels), [0.0]))
    positives = (bad[None, :] > limits[:, None]) & is_right
    negatives = (bad[None, :] <= limits[:, None]) & ~is_right
    wrongly, missed = positives.sum(axis=1), negatives.sum(axis=1)
    best = int(np.lexsort((limits, -gaps, missed, wrongly + missed))[0])
    limit = float(limits[best]) if better == "lower" else -float(limits[best])
    return Threshold(limit, better, int(wrongly[best]), int(missed[best]), len(bad))


def roc(values: Values, right: Kinds, better: Better) -> NDArray[np.float64]:
    """The points (k, 2) that a threshold goes through: shares of right and of wrong merges that it calls wrong.

    From (0, 0), nothing is called wrong, to (1, 1). Merges without the number are left out; raises ValueError when
    then one of the two kinds is missing.
    """
    there = ~np.isnan(values)
    bad, is_right = (values[there] if better == "lower" else -values[there]), right[there]
    if not 0 < is_right.sum() < len(bad):
        raise ValueError(f"a curve needs right and wrong merges, found {int(is_right.sum())} right of {len(bad)}")
    order = np.argsort(-bad, kind="stable")
    last = np.append(np.flatnonzero(np.diff(bad[order])), len(bad) - 1)  # where ties end
    sides = (np.cumsum(side[order])[last] / side.sum() for side in (is_right, ~is_right))
    return np.concatenate((np.zeros((1, 2)), np.stack(list(sides), axis=1)))


def curves(experiment: Experiment, *, watched: bool = True) -> list[Curve]:
    """Every number at every moment, of all merges together and of every combination, as far as it tells something.

    Without ``watched`` only SM and DM.
    """
    found = []
    for group, merges in groups(experiment).items():
        right = _Right(rightness(merges), np.array([merge.number for merge in merges], np.int64))
        weights = resampled(blocks_of([merge.plan for merge in merges]), experiment.settings.seed)
        for number, moment, source, better in _sources(experiment, watched=watched):
            values = _values(merges, number, moment, source)
            curve = _curve((number, moment, source, group), values, right, weights, better)
            found += [curve] if curve is not None else []
    return found


def groups(experiment: Experiment) -> dict[str, list[Merge]]:
    """All merges together, and those of every combination."""
    by = {combination.name: of(experiment, combination) for combination in experiment.settings.combinations}
    return {POOLED: list(experiment.merges), **{name: merges for name, merges in by.items() if merges}}


def rightness(merges: Sequence[Merge]) -> Kinds:
    """Which merges (n,) are right."""
    return np.array([merge.right for merge in merges], np.bool_)


def metric_values(merges: Sequence[Merge], number: str, moment: str, strategy: ReversalName) -> Values:
    """A metric or one of its details, of merges that were kept in one way."""
    return np.array([getattr(merge.by[strategy], moment).get(number, math.nan) for merge in merges], np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _Right:
    """Which merges (n,) are right, and the draws (n,) that they are from."""

    right: Kinds
    draws: NDArray[np.int64]

    def pairs(self, there: NDArray[np.bool_]) -> int:
        """How many pairs of a right and a wrong merge can be made of different draws, each used once."""
        return min(len(np.unique(self.draws[there & kind])) for kind in (self.right, ~self.right))


def _curve(
    name: tuple[str, str, str, str], values: Values, kinds: _Right, weights: Weights, better: Better | None
) -> Curve | None:
    """The curve of a number; None where too few have it or it is the same for all."""
    there, right = ~np.isnan(values), kinds.right
    counts = int((right & there).sum()), int((~right & there).sum())
    if min(counts) < _LEAST or len(np.unique(values[there])) < 2:
        return None
    found = area(values, right, weights, better)
    if found.value in (0.0, 1.0):  # no resample can differ
        low, high = clopper_pearson(kinds.pairs(there) if found.value else 0, kinds.pairs(there))
        found = replace(found, low=low, high=high)
    points = roc(values, right, found.better)
    return Curve(*name, found, best_threshold(values, right, found.better), points, int((~there).sum()))


def _sources(experiment: Experiment, *, watched: bool) -> Iterator[tuple[str, str, str, Better | None]]:
    """Number, moment, source, and which way it should go, of everything that merges could be told by."""
    for strategy in STRATEGIES:
        for metric in METRICS:
            for moment in MOMENTS:
                yield metric, moment, strategy, experiment.better.get(metric, _BETTER[metric])
    for moment in MOMENTS if watched else ():
        names = dict.fromkeys(name for merge in experiment.merges for name in _watched(merge, moment))
        for name in names:
            yield name, moment, WATCHED, experiment.better.get(name)


_BETTER: Final[Mapping[str, Better]] = {"similarity": "higher", "distance": "lower"}


def _values(merges: Sequence[Merge], number: str, moment: str, source: str) -> Values:
    for strategy in STRATEGIES:
        if strategy == source:
            return metric_values(merges, number, moment, strategy)
    return np.array([_watched(merge, moment).get(number, math.nan) for merge in merges], np.float64)


def _watched(merge: Merge, moment: str) -> Mapping[str, float]:
    return merge.watched.initial if moment == "initial" else merge.watched.end


@dataclass(frozen=True, slots=True)
class Rule:
    """A way of making one threshold for all resolutions: one of the number times the resolution to some power.

    DM is in cells of the receiver's grid: to the power 1 it is in metres. Where right merges agree in cells and wrong
    ones in metres, the geometric mean of the two, as a limit, goes with the power one half.
    """

    name: str
    title: str
    metric: str
    power: float
    better: Better


RULES: Final = (
    Rule("similarity", "SM", "similarity", 0.0, "higher"),
    Rule("distance_cells", "DM in cells", "distance", 0.0, "lower"),
    Rule("distance_metres", "DM in metres", "distance", 1.0, "lower"),
    Rule("distance_root", "DM in cells · √m", "distance", 0.5, "lower"),
)


@dataclass(frozen=True, slots=True)
class Transfer:
    """A threshold that was chosen elsewhere: what it gets wrong on merges that had no part in the choice.

    ``thresholds`` holds every one that was chosen, by what was held out.
    """

    rule: Rule
    strategy: ReversalName
    held_out: str
    false_positives: int
    false_negatives: int
    of: int
    thresholds: Mapping[str, float]


def scaled(merges: Sequence[Merge], rule: Rule, strategy: ReversalName, moment: str = "end") -> Values:
    """The number that a rule puts its threshold on."""
    size_m = np.array([merge.combination.own_m for merge in merges], np.float64)
    return metric_values(merges, rule.metric, moment, strategy) * size_m**rule.power


def transfers(experiment: Experiment) -> list[Transfer]:
    """Every rule's threshold chosen on a part of the merges and applied to the rest, for each way of keeping them.

    Held out is each half of the draws, by even and odd numbers (so that a pair of windows is in one half with all
    resolutions), or each combination of resolutions.
    """
    merges = experiment.merges
    parts = {
        "half of the draws": [f"{'odd' if merge.number % 2 else 'even'} draws" for merge in merges],
        "one combination": [merge.combination.name for merge in merges],
    }
    return [
        found
        for rule in RULES
        for strategy in STRATEGIES
        for held_out, labels in parts.items()
        if (found := _transfer(merges, rule, strategy, held_out, labels)) is not None
    ]


def _transfer(
    merges: Sequence[Merge], rule: Rule, strategy: ReversalName, held_out: str, labels: Sequence[str]
) -> Transfer | None:
    """None where some part cannot be held out, because both kinds must be in what is left."""
    values, right, names = scaled(merges, rule, strategy), rightness(merges), np.array(labels)
    results, chosen = [], {}
    for label in dict.fromkeys(labels):
        rest = (names != label) & ~np.isnan(values)
        if not 0 < right[rest].sum() < rest.sum():
            return None
        limit = best_threshold(values[rest], right[rest], rule.better).value
        chosen[label] = limit
        results.append(judged(values[names == label], right[names == label], limit, rule.better))
    counts = (sum(r.false_positives for r in results), sum(r.false_negatives for r in results))
    return Transfer(rule, strategy, held_out, *counts, sum(r.of for r in results), chosen)


def shipped_limits(merges: Sequence[Merge], metric: str, strategy: ReversalName) -> Threshold:
    """What the limits get wrong that the metrics themselves state, which rest on the paper's averages alone."""
    values = metric_values(merges, metric, "end", strategy)
    limits = metric_values(merges, f"{metric}.limit", "end", strategy)
    return judged(values, rightness(merges), limits, _BETTER[metric])


def verdicts(experiment: Experiment, combination: Combination | None, right: bool) -> dict[str, int]:
    """What our own rules' verifier made of the merges: how many it reverted, confirmed, kept, or never looked at."""
    merges = of(experiment, combination, right)
    actions = [merge.watched.action or "unseen" for merge in merges]
    return {action: actions.count(action) for action in ("revert", "confirm", "keep", "unseen")}
