"""What comes of many scored pairs: recall, acceptance, what stands in the end, and how well each number tells."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from mapgraft.evaluation.certainty import ELLIPSE_95, WIDE_M
from mapgraft.evaluation.scored import Scored
from mapgraft.evaluation.statistics import Area, Share, Spread, Weights, area, share, spread

SOME_OVERLAP, MUCH_OVERLAP = 0.3, 0.5
NEW_WALL_M = 4.0
Question = Callable[[Scored], bool]
BINS = ("<= .1", ".1 - .3", ".3 - .5", ".5 - .7", "> .7")


@dataclass(frozen=True, slots=True)
class Bin:
    """Pairs of like overlap: how many of those that were matched have the right hypothesis on top.

    ``rejected`` counts those that the decision table turned away; they are not in the recall.
    """

    overlap: str
    recall: Share
    rejected: int


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Pairs that were merged, before any further mapping.

    ``right`` and ``wrong`` are shares of all pairs, ``wrong_across`` of the pairs whose maps do not belong together;
    ``right_of_right`` is the share of the right best hypotheses at an overlap of .5 or more, ``wrong_of_wrong`` that of
    all wrong best hypotheses.
    """

    right: Share
    wrong: Share
    wrong_across: Share
    right_of_right: Share
    wrong_of_wrong: Share
    ambiguous: int


@dataclass(frozen=True, slots=True)
class Afterwards:
    """What became of the merges by further mapping.

    ``wrong_confirmed`` and ``wrong_provisional``: those that stand wrongly, as shares of all pairs. The others are
    shares of the merges that were right: reverted all the same, confirmed, still provisional;
    ``right_confirmed_on_new_wall`` of those where at least 4 m more of the donor's walls have come to be known.
    """

    wrong_confirmed: Share
    wrong_provisional: Share
    wrong_reverted: Share
    right_reverted: Share
    right_provisional: Share
    right_confirmed: Share
    right_confirmed_on_new_wall: Share


@dataclass(frozen=True, slots=True)
class Honesty:
    """The covariances of right best hypotheses.

    ``inside``: whose 95 % ellipse holds the truth, of those that have a covariance; ``without`` counts those that have
    none, and ``degenerate`` those whose covariance says that the walls may lie 0.5 m off.
    """

    inside: Share
    without: int
    degenerate: Share


@dataclass(frozen=True, slots=True)
class Summary:
    """Everything that is counted, without the times. ``auc`` is by the name of the number."""

    pairs: int
    across: int
    rejected: int
    without_hypothesis: int
    right: int
    wrong: int
    recall: tuple[Bin, ...]
    recall_from_some_overlap: Share
    acceptance: Acceptance
    afterwards: Afterwards
    covariance: Honesty
    auc: Mapping[str, Area]


@dataclass(frozen=True, slots=True)
class Times:
    """Wall clock in milliseconds over pairs.

    ``match_ms``: one match. The others are per further scan, on average over those of a pair: ``integrate_ms`` what it
    takes to map it, ``verify_ms`` what it takes more when a merge stands.
    """

    match_ms: Spread
    verify_ms: Spread
    integrate_ms: Spread


def bin_of(overlap: float) -> int:
    """The place in ``BINS``; .3 and .5 begin a bin, .1 and .7 end one."""
    return int(overlap > 0.1) + int(overlap >= SOME_OVERLAP) + int(overlap >= MUCH_OVERLAP) + int(overlap > 0.7)


@dataclass(frozen=True, slots=True)
class _Crowd:
    """Scored pairs of which one asks for shares."""

    scored: Sequence[Scored]
    weights: Weights

    def of(self, question: Question) -> NDArray[np.bool_]:
        return np.array([question(one) for one in self.scored], np.bool_)

    def count(self, question: Question) -> int:
        return sum(map(question, self.scored))

    def share(self, hit: Question, among: Question = lambda _: True) -> Share:
        return share(self.of(hit), self.of(among), self.weights)


def summarize(scored: Sequence[Scored], weights: Weights) -> Summary:
    """Count over scored pairs; ``weights`` (r, n) are those of ``statistics.resampled``."""
    crowd = _Crowd(scored, weights)
    return Summary(
        pairs=len(scored),
        across=crowd.count(lambda one: one.overlap is None),
        rejected=crowd.count(lambda one: one.verdict == "rejected"),
        without_hypothesis=crowd.count(lambda one: one.best is None and one.verdict != "rejected"),
        right=crowd.count(lambda one: one.right),
        wrong=crowd.count(lambda one: one.wrong),
        recall=tuple(_bin(crowd, number) for number in range(len(BINS))),
        recall_from_some_overlap=crowd.share(
            lambda one: one.right, lambda one: one.shares(SOME_OVERLAP) and one.verdict != "rejected"
        ),
        acceptance=_acceptance(crowd),
        afterwards=_afterwards(crowd),
        covariance=_honesty(crowd),
        auc=_areas(scored, weights),
    )


def times_of(scored: Sequence[Scored]) -> Times:
    """How long matching, verifying and mapping took."""
    return Times(
        spread([1e3 * one.match_s for one in scored if one.match_s is not None]),
        spread([1e3 * fmean(one.verified_s) for one in scored if one.verified_s]),
        spread([1e3 * fmean(one.integrated_s) for one in scored if one.integrated_s]),
    )


def _bin(crowd: _Crowd, number: int) -> Bin:
    def inside(one: Scored) -> bool:
        return one.overlap is not None and bin_of(one.overlap) == number

    return Bin(
        BINS[number],
        crowd.share(lambda one: one.right, lambda one: inside(one) and one.verdict != "rejected"),
        crowd.count(lambda one: inside(one) and one.verdict == "rejected"),
    )


def _acceptance(crowd: _Crowd) -> Acceptance:
    return Acceptance(
        right=crowd.share(lambda one: one.merged_right),
        wrong=crowd.share(lambda one: one.merged_wrong),
        wrong_across=crowd.share(lambda one: one.merged_wrong, lambda one: one.overlap is None),
        right_of_right=crowd.share(lambda one: one.merged_right, lambda one: one.right and one.shares(MUCH_OVERLAP)),
        wrong_of_wrong=crowd.share(lambda one: one.merged_wrong, lambda one: one.wrong),
        ambiguous=crowd.count(lambda one: one.verdict == "ambiguous"),
    )


def _afterwards(crowd: _Crowd) -> Afterwards:
    def right(one: Scored) -> bool:
        return one.merged_right

    def reverted(one: Scored) -> bool:
        return one.state == "reverted"

    def confirmed(one: Scored) -> bool:
        return one.state == "confirmed"

    def provisional(one: Scored) -> bool:
        return one.state == "provisional"

    return Afterwards(
        wrong_confirmed=crowd.share(lambda one: confirmed(one) and one.lies_wrong),
        wrong_provisional=crowd.share(lambda one: provisional(one) and one.lies_wrong),
        wrong_reverted=crowd.share(reverted, lambda one: one.merged_wrong),
        right_reverted=crowd.share(reverted, right),
        right_provisional=crowd.share(provisional, right),
        right_confirmed=crowd.share(confirmed, right),
        right_confirmed_on_new_wall=crowd.share(
            confirmed, lambda one: right(one) and one.walls_m is not None and one.walls_m >= NEW_WALL_M
        ),
    )


def _honesty(crowd: _Crowd) -> Honesty:
    def told(one: Scored) -> bool:
        return one.distance2 is not None

    return Honesty(
        inside=crowd.share(lambda one: one.distance2 is not None and one.distance2 <= ELLIPSE_95, told),
        without=crowd.count(lambda one: one.right and not told(one)),
        degenerate=crowd.share(lambda one: one.sigma_max_m is not None and one.sigma_max_m > WIDE_M, told),
    )


def _areas(scored: Sequence[Scored], weights: Weights) -> dict[str, Area]:
    """How well each number tells right from wrong best hypotheses; metrics that should be low are turned round."""
    best = [(place, one) for place, one in enumerate(scored) if one.best is not None]
    places = np.array([place for place, _ in best], np.int64)
    right = np.array([one.right for _, one in best], np.bool_)
    names = dict.fromkeys(name for _, one in best for name in one.numbers)
    lower = frozenset[str]().union(*(one.lower for _, one in best))
    columns = {name: np.array([one.numbers.get(name, np.nan) for _, one in best]) for name in names}
    return {
        name: area(-values if name in lower else values, right, weights[:, places]) for name, values in columns.items()
    }
