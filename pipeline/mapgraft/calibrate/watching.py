"""Where the sequential test confirms and reverts: wrong merges are confirmed, and right ones reverted, no more often
than promised."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from mapgraft.calibrate.acceptance import members
from mapgraft.calibrate.conformal import needed, threshold
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.labelled import Labelled, Look
from mapgraft.calibrate.rates import Rate

_STEPS = 10_000.0  # in a unit: limits are rounded to that
WRONG_ODDS = "verifier.log_odds_wrong"  # what the verifier ``sequential`` tells of each look


@dataclass(frozen=True, slots=True)
class Test:
    """What the rule's verifier ``sequential`` is asked: names, what confirming needs, and where it confirmed so far."""

    news: str = "news"
    prior: str = "posterior"
    new_m: float = 2.0
    revert_below: float = 0.1
    confirm_at: float = -5.3

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

    ``missing`` is how many labels are missing for one of the group's own, ``observations`` how long the merges that
    set it were watched at most. ``harm`` is what share of them goes beyond it, ``gain`` the same of accepted merges of
    the other kind: of wrong ones that are reverted, of right ones that are confirmed.
    """

    group: Group
    rate: float
    value: float | None
    set_by: Group | None
    labels: int
    missing: int
    observations: int = 0
    harm: Rate | None = None
    gain: Rate | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Watch:
    """The merges of some examples that were watched, and which of them the new thresholds accept."""

    examples: Sequence[Labelled]
    takes: Callable[[Labelled], bool]
    test: Test

    def reversal(self, group: Group, rate: float) -> tuple[Limit, bool]:
        """The log-odds of being wrong from which a merge is reverted, and whether the fall of the prior may do it, too.

        It is set by right merges that the new thresholds accept: those do not hang on them. A merge that the run which
        was read has reverted counts as one that any limit reverts. Where the fall of the prior alone reverts more right
        merges than promised, it must not.
        """
        chosen, missing = _enough(self.examples, group, rate, self._stands)
        merges = [example for example in members(self.examples, chosen or group) if self._stands(example)]
        if chosen is None:
            return Limit(group, rate, None, None, len(merges), missing), True
        units = [example.unit for example in merges]
        told = [math.inf if example.reverted else self.test.highest(example) for example in merges]
        value, falls = threshold(told, rate, units), True
        if value == math.inf:
            still = replace(self.test, revert_below=0.0)
            told = [math.inf if example.reverted else still.highest(example) for example in merges]
            value, falls = threshold(told, rate, units), False
        if value == math.inf:
            return Limit(group, rate, None, chosen, len(merges), missing), False
        least = 0.0  # what is more probably right than wrong is not reverted, whatever is promised
        value = max(least, (math.floor(value * _STEPS) + 1) / _STEPS if math.isfinite(value) else least)
        wrong = [example for example in members(self.examples, chosen) if self._misled(example)]
        harm = Rate.counted(sum(one >= value for one in told), len(told))
        gain = Rate.counted(sum(self.test.highest(example) >= value for example in wrong), len(wrong))
        return Limit(group, rate, value, chosen, len(merges), missing, _longest(merges), harm, gain), falls

    def confirmation(self, group: Group, rate: float, revert_at: float | None) -> Limit:
        """The log-odds of being wrong down to which a merge is confirmed: set by all wrong hypotheses.

        Those that the new thresholds do not accept are never confirmed, so that the promise is on a wrong hypothesis,
        merged or not. That the thresholds hang on the same hypotheses does no harm: a further one above a threshold
        would not have moved it. One that was reverted where the new limit would not counts as one that is confirmed.
        It is never looser than the rule had it.
        """
        chosen, missing = _enough(self.examples, group, rate, _lies_wrong)
        wrong = [example for example in members(self.examples, chosen or group) if _lies_wrong(example)]
        if chosen is None:
            return Limit(group, rate, None, None, len(wrong), missing)
        told = [self._confirmable(example, revert_at) if self.takes(example) else -math.inf for example in wrong]
        value = threshold(told, rate, [example.unit for example in wrong])
        if value == math.inf:
            return Limit(group, rate, None, chosen, len(wrong), missing)
        at = (math.ceil(-value * _STEPS) - 1) / _STEPS if math.isfinite(value) else self.test.confirm_at
        at = min(at, self.test.confirm_at)
        right = [example for example in members(self.examples, chosen) if self._stands(example)]
        harm = Rate.counted(sum(-one <= at for one in told), len(told))
        gain = Rate.counted(sum(self.test.lowest(example) <= at for example in right), len(right))
        return Limit(group, rate, at, chosen, len(wrong), missing, _longest(wrong), harm, gain)

    def _confirmable(self, example: Labelled, revert_at: float | None) -> float:
        if example.reverted and (revert_at is None or self.test.highest(example) < revert_at):
            return math.inf
        return -self.test.lowest(example)

    def _stands(self, example: Labelled) -> bool:
        """Whether it is a merge that is right, was watched, and that the new thresholds accept."""
        right = example.right is True and example.right_later is not False and len(example.looks) > 1
        return right and self.takes(example)

    def _misled(self, example: Labelled) -> bool:
        """Whether it is a wrong merge that the new thresholds accept."""
        return _lies_wrong(example) and self.takes(example)


def _lies_wrong(example: Labelled) -> bool:
    return example.right is False and example.right_later is False and len(example.looks) > 1


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
