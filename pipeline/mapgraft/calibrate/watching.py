"""Where the sequential test confirms and reverts: wrong merges are confirmed, and right ones reverted, no more often
than promised."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from mapgraft.calibrate.acceptance import members
from mapgraft.calibrate.conformal import needed, threshold
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.labelled import Labelled
from mapgraft.calibrate.rates import Rate
from mapgraft.calibrate.sequential import Test

_STEPS = 10_000.0  # in a unit: limits are rounded to that
_TOO_MANY = "the run that was read has reverted too many right merges"
_UNKNOWN = "the run that was read has reverted wrong merges of which nobody knows whether they would be confirmed"


@dataclass(frozen=True, slots=True)
class Share:
    """The labels of one environment: how many independent ones, and the limit that they would set alone.

    ``value`` is None where they are too few, or set none.
    """

    environment: str
    labels: int
    value: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Limit:
    """One limit of the test with the labels that set it; where there is none ``value`` is None, and ``why`` says why.

    ``missing`` is how many labels are missing for one of the group's own, ``observations`` how long the merges that
    set it were watched at most. ``unwatched`` of the ``labels`` are accepted now but were not merged when they were
    made: each counts as the worst. ``harm`` is what share of them goes beyond it, ``gain`` the same of accepted merges
    of the other kind: of wrong ones that are reverted, of right ones that are confirmed. ``environments`` tells what
    single ones would set.
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
    unwatched: int = 0
    environments: Sequence[Share] = ()
    why: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Watch:
    """Some examples as far as they tell of the test, and which of them the new rules merge.

    A hypothesis that the new rules merge and the old ones did not was watched by nobody. It counts as the worst:
    otherwise the surest merges alone would set limits that are promised of all.
    """

    examples: Sequence[Labelled]
    takes: Callable[[Labelled], bool]
    test: Test

    def reversal(self, group: Group, rate: float) -> tuple[Limit, bool]:
        """The log-odds of being wrong from which a merge is reverted, and whether the fall of the prior may do it, too.

        It is set by right hypotheses that the new rules merge: those rules do not hang on them. A merge that the run
        which was read has reverted counts as one that any limit reverts. Where the fall of the prior alone reverts more
        right merges than promised, it must not.
        """
        chosen, missing = _enough(self.examples, group, rate, self.stands)
        merges = [example for example in members(self.examples, chosen or group) if self.stands(example)]
        unwatched = sum(not example.looks for example in merges)
        limit = Limit(group, rate, None, chosen, len(merges), missing, _longest(merges), unwatched=unwatched)
        if chosen is None:
            return replace(limit, why=f"{len(merges)} right hypotheses are merged, {missing} more are needed"), True
        for falls in (True, False):
            told = [self.height(example, falls=falls) for example in merges]
            value, environments = _strictest(told, merges, rate, _up)
            if value < math.inf:
                break
        else:
            why = _unseen(unwatched, len(merges), "right") or _TOO_MANY
            return replace(limit, environments=environments, why=why), True
        at = _up(value)
        misled = [e for e in members(self.examples, chosen) if e.looks and self.takes(e) and self.misleads(e)]
        harm = Rate.counted(sum(one >= at for one in told), len(told))
        gain = Rate.counted(sum(self.test.reached(e).lies_above(at, falls=falls) for e in misled), len(misled))
        return replace(limit, value=at, harm=harm, gain=gain, environments=environments), falls

    def confirmation(self, group: Group, rate: float, revert_at: float | None) -> Limit:
        """The log-odds of being wrong down to which a merge is confirmed: set by all wrong hypotheses.

        Those that the new rules do not merge are never confirmed, so that the promise is on a wrong hypothesis, merged
        or not. That the thresholds hang on the same hypotheses does no harm: a further one above a threshold
        would not have moved it. One that was reverted where the new limit would not counts as one that is confirmed.
        It is never looser than the rule had it.
        """
        chosen, missing = _enough(self.examples, group, rate, self.misleads)
        wrong = [example for example in members(self.examples, chosen or group) if self.misleads(example)]
        unwatched = sum(not example.looks for example in wrong if self.takes(example))
        limit = Limit(group, rate, None, chosen, len(wrong), missing, _longest(wrong), unwatched=unwatched)
        if chosen is None:
            return replace(limit, why=f"there are {len(wrong)} wrong hypotheses, {missing} more are needed")
        told = [-self.depth(example, revert_at) for example in wrong]
        value, environments = _strictest(told, wrong, rate, self._down)
        if value == math.inf:
            why = _unseen(unwatched, len(wrong), "wrong") or _UNKNOWN
            return replace(limit, environments=environments, why=why)
        at = self._down(value)
        right = [e for e in members(self.examples, chosen) if self.stands(e) and e.looks]
        harm = Rate.counted(sum(-one <= at for one in told), len(told))
        gain = Rate.counted(sum(self.test.reached(example).lowest <= at for example in right), len(right))
        return replace(limit, value=at, harm=harm, gain=gain, environments=environments)

    def stands(self, example: Labelled) -> bool:
        """Whether it is a right hypothesis that the new rules merge; without one that lay wrong in the end, or that
        nobody looked at again after it was merged."""
        right = example.right is True and example.right_later is not False
        return right and self._tells(example) and self.takes(example)

    def misleads(self, example: Labelled) -> bool:
        """Whether it is a wrong hypothesis that was not put right; without those that are merged and were, but that
        nobody looked at again."""
        return _lies_wrong(example) and (self._tells(example) or not self.takes(example))

    def height(self, example: Labelled, *, falls: bool) -> float:
        """The highest limit that would have reverted it; infinite where any does, or where nobody watched it.

        ``falls`` says whether the fall of the prior reverts, too.
        """
        if example.reverted or not example.looks:
            return math.inf
        reached = self.test.reached(example)
        return math.inf if falls and reached.fell else reached.highest

    def depth(self, example: Labelled, revert_at: float | None) -> float:
        """The lowest limit that would have confirmed it; infinite where none does, minus infinity where any may."""
        if not self.takes(example):
            return math.inf
        reached = self.test.reached(example)
        if not example.looks or (example.reverted and (revert_at is None or reached.highest < revert_at)):
            return -math.inf
        return reached.lowest

    def _tells(self, example: Labelled) -> bool:
        """Whether it was judged, or looked at again, if it was merged at all."""
        return len(example.looks) != 1 or self.test.reached(example).judged

    def _down(self, value: float) -> float:
        at = (math.ceil(-value * _STEPS) - 1) / _STEPS if math.isfinite(value) else self.test.confirm_at
        return min(at, self.test.confirm_at)


def _lies_wrong(example: Labelled) -> bool:
    return example.right is False and example.right_later is not True


def _up(value: float) -> float:
    """What is more probably right than wrong is not reverted, whatever is promised."""
    return max(0.0, (math.floor(value * _STEPS) + 1) / _STEPS) if math.isfinite(value) else 0.0


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


def _strictest(
    told: Sequence[float], merges: Sequence[Labelled], rate: float, limit: Callable[[float], float]
) -> tuple[float, list[Share]]:
    """The highest of the thresholds of all together and of each environment that has labels enough; those that have
    not count as one. ``limit`` makes a limit of a threshold."""
    by: dict[str, list[int]] = {}
    for number, merge in enumerate(merges):
        by.setdefault(merge.environment, []).append(number)
    units = {name: len({merges[n].unit for n in numbers}) for name, numbers in by.items()}
    few = [n for name, numbers in by.items() if units[name] < needed(rate) for n in numbers]

    def of(numbers: Sequence[int]) -> float:
        return threshold([told[n] for n in numbers], rate, [merges[n].unit for n in numbers])

    alone = {name: of(numbers) for name, numbers in by.items() if units[name] >= needed(rate)}
    shares = [
        Share(name, units[name], limit(alone[name]) if alone.get(name, math.inf) < math.inf else None)
        for name in sorted(by)
    ]
    together = of(few) if len({merges[n].unit for n in few}) >= needed(rate) else -math.inf
    return max(of(range(len(merges))), together, *alone.values()), shares


def _unseen(unwatched: int, of: int, kind: str) -> str:
    """Why limits cannot be promised where merges were watched by nobody, and what to do; empty where that is not so."""
    if not unwatched:
        return ""
    return (
        f"{unwatched} of {of} {kind} hypotheses would be merged and were not when the examples were made, so that "
        "nobody knows how they would have been judged: collect examples by rules that merge all "
        "(calibrate --collecting)"
    )


def _longest(merges: Sequence[Labelled]) -> int:
    return max((example.looks[-1].observations for example in merges if example.looks), default=0)
