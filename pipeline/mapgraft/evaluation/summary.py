"""What comes of many scored pairs: recall, acceptance, what stands in the end, and how well each number tells."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from mapgraft.evaluation.certainty import ELLIPSE_95, WIDE_M
from mapgraft.evaluation.scored import Placed, Scored
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
    """The covariances of best hypotheses.

    Of right ones: ``inside``, whose 95 % ellipse holds the truth, of those that have a covariance; ``without`` counts
    those that have none, and ``degenerate`` those whose covariance says that the walls may lie 0.5 m off.
    ``degenerate_of_all`` are the same of all best hypotheses with a covariance, right or wrong.
    """

    inside: Share
    without: int
    degenerate: Share
    degenerate_of_all: Share


@dataclass(frozen=True, slots=True)
class Errors:
    """How far right best hypotheses are off: walls in metres, the angle in degrees, keypoints in pixels."""

    error_m: Spread
    error_deg: Spread
    error_px: Spread


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
    errors: Errors
    covariance: Honesty
    auc: Mapping[str, Area]


@dataclass(frozen=True, slots=True)
class Times:
    """Wall clock in milliseconds.

    Over pairs: ``match_ms``, one match; ``final_ms``, the last look at the merge; and on average over the further scans
    of the pair ``integrate_ms``, what it takes to map one, and ``verify_ms``, what it takes more when a merge stands,
    without the searches for a better transform. ``anew_ms`` is over those, each for itself.
    """

    match_ms: Spread
    integrate_ms: Spread
    verify_ms: Spread
    anew_ms: Spread
    final_ms: Spread


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
        errors=_errors([one.best for one in scored if one.best is not None and one.best.right]),
        covariance=_honesty(crowd),
        auc=_areas(scored, weights),
    )


def times_of(scored: Sequence[Scored]) -> Times:
    """How long matching, mapping, verifying and registering anew took."""
    return Times(
        match_ms=spread([1e3 * one.match_s for one in scored if one.match_s is not None]),
        integrate_ms=spread([1e3 * fmean(one.integrated_s) for one in scored if one.integrated_s]),
        verify_ms=spread([1e3 * fmean(one.verified_s) for one in scored if one.verified_s]),
        anew_ms=spread([1e3 * searched_s for one in scored for searched_s in one.anew_s]),
        final_ms=spread([1e3 * one.final_s for one in scored if one.final_s is not None]),
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
        return one.sigma_max_m is not None

    def wide(one: Scored) -> bool:
        return one.sigma_max_m is not None and one.sigma_max_m > WIDE_M

    return Honesty(
        inside=crowd.share(
            lambda one: one.distance2 is not None and one.distance2 <= ELLIPSE_95,
            lambda one: one.distance2 is not None,
        ),
        without=crowd.count(lambda one: one.right and not told(one)),
        degenerate=crowd.share(wide, lambda one: one.right and told(one)),
        degenerate_of_all=crowd.share(wide, told),
    )


def _errors(placed: Sequence[Placed]) -> Errors:
    def of(values: Sequence[float | None]) -> Spread:
        return spread([value for value in values if value is not None])

    return Errors(
        of([one.error_m for one in placed]), of([one.error_deg for one in placed]), of([one.error_px for one in placed])
    )


def _areas(scored: Sequence[Scored], weights: Weights) -> dict[str, Area]:
    """How well each number tells right from wrong best hypotheses, each in its own direction."""
    best = [(place, one) for place, one in enumerate(scored) if one.best is not None]
    places = np.array([place for place, _ in best], np.int64)
    right = np.array([one.right for _, one in best], np.bool_)
    names = dict.fromkeys(name for _, one in best for name in one.numbers)
    better = {name: way for _, one in best for name, way in one.better.items()}
    columns = {name: np.array([one.numbers.get(name, np.nan) for _, one in best]) for name in names}
    return {name: area(values, right, weights[:, places], better.get(name)) for name, values in columns.items()}
