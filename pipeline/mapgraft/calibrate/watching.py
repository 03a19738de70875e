"""Where the sequential test confirms and reverts: wrong merges are confirmed, and right ones reverted, no more often
than promised."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from mapgraft.calibrate.acceptance import Threshold, members
from mapgraft.calibrate.conformal import needed, threshold
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.labelled import Labelled, Look
from mapgraft.calibrate.rates import Rate
from mapgraft.calibrate.scoring import Score

_STEPS = 10_000.0  # in a unit: limits are rounded to that
WRONG_ODDS = "verifier.log_odds_wrong"  # what the verifier ``sequential`` tells of each look


@dataclass(frozen=True, slots=True)
class Test:
    """What the rule's verifier ``sequential`` is asked beside its limits: names, and what confirming needs."""

    news: str = "news"
    prior: str = "posterior"
    new_m: float = 2.0
    revert_below: float = 0.1

    def _judging(self, example: Labelled) -> Iterator[Look]:
        """The looks at which there was new evidence: at the others the verifier does nothing."""
        for look in example.looks:
            if look.numbers.get(f"{self.news}.agreed", 0.0) + look.numbers.get(f"{self.news}.against", 0.0) > 0.0:
                yield look

    def lowest(self, example: Labelled) -> float:
        """The lowest log-odds of being wrong at any look at which the merge could have been confirmed."""
        told = [
            look.numbers.get(WRONG_ODDS, math.nan)
            for look in self._judging(example)
            if look.numbers.get(f"{self.news}.agreed_m", math.inf) >= self.new_m
        ]
        return min((value for value in told if not math.isnan(value)), default=math.inf)

    def highest(self, example: Labelled) -> float:
        """The highest log-odds at any look; infinite where the merge is reverted whatever the limit."""
        later = example.looks[1:]
        if any(look.numbers.get(self.prior, math.nan) < self.revert_below for look in later):
            return math.inf
        told = [look.numbers.get(WRONG_ODDS, math.nan) for look in self._judging(example)]
        return max((value for value in told if not math.isnan(value)), default=-math.inf)


@dataclass(frozen=True, slots=True, eq=False)
class Limit:
    """One limit of the test with the labels that set it; None where there are too few.

    ``missing`` is how many merges are missing for one of the group's own, ``observations`` how long the merges that
    set it were watched at most, ``measured`` what share of them goes beyond it.
    """

    group: Group
    rate: float
    value: float | None
    set_by: Group | None
    merges: int
    missing: int
    observations: int = 0
    measured: Rate | None = None


def reversal_limit(
    examples: Sequence[Labelled], score: Score, limit: Threshold, test: Test, rate: float
) -> tuple[Limit, bool]:
    """The log-odds of being wrong from which a merge is reverted, and whether the fall of the prior may revert, too.

    It is set by right merges that the new threshold accepts. A merge that the run which was read has reverted counts as
    one that any limit reverts. Where the fall of the prior alone reverts more right merges than promised, it must not.
    """
    chosen, missing = _enough(examples, limit.group, rate, lambda e: _stands(e, score, limit))
    if chosen is None:
        return Limit(limit.group, rate, None, None, _count(examples, limit, score), missing), True
    merges = [example for example in members(examples, chosen) if _stands(example, score, limit)]
    units = [example.unit for example in merges]
    told = [math.inf if example.reverted else test.highest(example) for example in merges]
    value, falls = threshold(told, rate, units), True
    if math.isinf(value):
        still = Test(test.news, test.prior, test.new_m, 0.0)
        told = [math.inf if example.reverted else still.highest(example) for example in merges]
        value, falls = threshold(told, rate, units), False
    if math.isinf(value):
        return Limit(limit.group, rate, None, chosen, len(merges), missing), False
    value = (math.floor(value * _STEPS) + 1) / _STEPS  # above what was seen, because the limit itself reverts
    beyond = Rate.counted(sum(one >= value for one in told), len(told))
    return Limit(limit.group, rate, value, chosen, len(merges), missing, _longest(merges), beyond), falls


def confirmation_limit(
    examples: Sequence[Labelled], limit: Threshold, test: Test, rate: float, revert_at: float | None
) -> Limit:
    """The log-odds of being wrong down to which a merge is confirmed: set by all wrong merges that were watched.

    Those that the new threshold would not accept are among them, so that the promise is on a wrong hypothesis that is
    merged or not. One that was reverted where the new limit would not counts as one that is confirmed.
    """
    chosen, missing = _enough(examples, limit.group, rate, _lies_wrong)
    if chosen is None:
        wrong = sum(map(_lies_wrong, members(examples, limit.group)))
        return Limit(limit.group, rate, None, None, wrong, missing)
    merges = [example for example in members(examples, chosen) if _lies_wrong(example)]
    told = [_confirmable(example, test, revert_at) for example in merges]
    value = threshold(told, rate, [example.unit for example in merges])
    if math.isinf(value) and value > 0.0:
        return Limit(limit.group, rate, None, chosen, len(merges), missing)
    lowest = -value if math.isfinite(value) else 0.0  # no wrong merge came near being confirmed: even odds will do
    at = min((math.ceil(lowest * _STEPS) - 1) / _STEPS, 0.0)
    beyond = Rate.counted(sum(-one <= at for one in told), len(told))
    return Limit(limit.group, rate, at, chosen, len(merges), missing, _longest(merges), beyond)


def _confirmable(example: Labelled, test: Test, revert_at: float | None) -> float:
    if example.reverted and (revert_at is None or test.highest(example) < revert_at):
        return math.inf
    return -test.lowest(example)


def _stands(example: Labelled, score: Score, limit: Threshold) -> bool:
    """Whether it is a merge that is right, was watched, and that the new threshold accepts."""
    right = example.right is True and example.right_later is not False and len(example.looks) > 1
    return right and limit.passes(score.of(example.numbers))


def _lies_wrong(example: Labelled) -> bool:
    return example.right is False and example.right_later is False and len(example.looks) > 1


def _count(examples: Sequence[Labelled], limit: Threshold, score: Score) -> int:
    return sum(_stands(example, score, limit) for example in members(examples, limit.group))


def _enough(
    examples: Sequence[Labelled], group: Group, rate: float, wanted: Callable[[Labelled], bool]
) -> tuple[Group | None, int]:
    """The finest group with enough independent merges, and how many are missing in the group itself."""
    missing = 0
    for step in group.coarser:
        units = {example.unit for example in members(examples, step) if wanted(example)}
        lacking = max(0, needed(rate) - len(units))
        missing = lacking if step == group else missing
        if not lacking:
            return step, missing
    return None, missing


def _longest(merges: Sequence[Labelled]) -> int:
    return max((example.looks[-1].observations for example in merges), default=0)
