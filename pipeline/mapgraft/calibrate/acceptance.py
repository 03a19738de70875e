"""The score above which a first hypothesis is merged: wrong ones get there no more often than promised."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mapgraft.calibrate.conformal import needed, threshold
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.labelled import Labelled
from mapgraft.calibrate.rates import Rate
from mapgraft.calibrate.regression import Curve
from mapgraft.calibrate.scoring import Score

_STEPS = 10_000.0  # in a unit: thresholds are rounded to that, away from the side on which something is accepted


@dataclass(frozen=True, slots=True)
class Cell:
    """Wrong hypotheses of one environment: how many independent ones, and the threshold that they would set alone."""

    environment: str
    wrong: int
    value: float | None


@dataclass(frozen=True, slots=True)
class Floor:
    """A threshold below which none is set, and why."""

    value: float = -math.inf
    why: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Threshold:
    """A threshold with the labels that set it. ``value`` is infinite where nothing is accepted; ``refusal`` says why.

    ``set_by`` is the group whose labels set it, this or a coarser one, None where there are too few of them, and
    ``missing`` how many labels of wrong hypotheses are missing for one of the group's own. ``cells`` are the
    environments of ``set_by``. ``raised_by`` says what asks for more than the rate of these labels does, empty where
    nothing does.
    """

    group: Group
    rate: float
    value: float
    set_by: Group | None
    wrong: int
    missing: int
    contested: int
    cells: Sequence[Cell] = ()
    raised_by: str = ""

    @property
    def own(self) -> bool:
        return self.set_by == self.group

    @property
    def refusal(self) -> str:
        """Why nothing is accepted, empty where something is."""
        if math.isfinite(self.value):
            return ""
        if self.set_by is None:
            return f"{self.missing} labels missing"
        if self.raised_by:
            return f"no label is as sure as the {self.raised_by} ask"
        return "too many wrong hypotheses have the highest score there is, or none has a score"

    def passes(self, score: float) -> bool:
        """Whether a score is above it; what has no score is not."""
        return score > self.value


def members(examples: Sequence[Labelled], group: Group) -> list[Labelled]:
    """The examples of a group; a coarser group has those of all that fall back to it."""
    return [example for example in examples if group.holds(example.group)]


def acceptance(
    examples: Sequence[Labelled], score: Score, group: Group, rate: float, floor: Floor | None = None
) -> Threshold:
    """The threshold of a group, of its own labels or of the first coarser group that has enough.

    It holds for wrong hypotheses of all buildings together, and for each environment by itself that has labels enough;
    those that have not count as one. It is never below ``floor``. What persons disagree about counts as wrong
    where that makes the threshold higher.
    """
    missing = 0
    for step in group.coarser:
        here = members(examples, step)
        sure = [example for example in here if example.right is False]
        lacking = max(0, needed(rate) - len({example.unit for example in sure}))
        missing = lacking if step == group else missing
        if lacking:
            continue
        doubtful = [example for example in here if example.contested]
        value, cells = _strictest(sure, score, rate)
        if doubtful:
            value = max(value, _strictest([*sure, *doubtful], score, rate)[0])
        value, floor = _up(value), floor or Floor()
        raised_by = floor.why if floor.value > value else ""
        set_by = (step, len(sure), missing, len(doubtful), cells, raised_by)
        return Threshold(group, rate, max(value, floor.value), *set_by)
    here = members(examples, group.coarser[-1])
    wrong = sum(example.right is False for example in members(examples, group))
    return Threshold(group, rate, math.inf, None, wrong, missing, sum(example.contested for example in here))


def _strictest(wrong: Sequence[Labelled], score: Score, rate: float) -> tuple[float, list[Cell]]:
    """The highest of the thresholds of all together and of each environment that has labels enough."""
    by: dict[str, list[Labelled]] = {}
    for example in wrong:
        by.setdefault(example.environment, []).append(example)
    few = [name for name, those in by.items() if len({e.unit for e in those}) < needed(rate)]
    parts = {name: those for name, those in by.items() if name not in few}
    parts[""] = [example for name in few for example in by[name]]
    values = {name: _of(those, score, rate) for name, those in parts.items()}
    cells = [
        Cell(name, len({e.unit for e in by[name]}), values[name] if name not in few else None) for name in sorted(by)
    ]
    told = [value for value in values.values() if math.isfinite(value)]
    return max([_of(wrong, score, rate), *told]), cells


def _of(wrong: Sequence[Labelled], score: Score, rate: float) -> float:
    """The threshold of these; one without a score is never accepted, and never lower than the lowest score there is."""
    told = score.all(wrong)
    scores = np.where(np.isnan(told), -np.inf, told)  # an infinite score stays infinite: nothing is above it
    finite = scores[np.isfinite(scores)]
    lowest = float(finite.min()) if finite.size else math.inf
    return max(threshold(scores, rate, [example.unit for example in wrong]), lowest)


def cost_floor(curve: Curve, false_accept: float | None, miss: float) -> Floor:
    """The score from which merging costs less than not merging, by what the two mistakes cost.

    A hypothesis is worth merging when it is right with a probability above C_fa / (C_fa + C_miss). Where no costs are
    told there is no floor.
    """
    if false_accept is None:
        return Floor()
    return Floor(_up(curve.reaches(1.0 / (1.0 + miss / false_accept))), "costs")


def _up(value: float) -> float:
    steps = value * _STEPS
    return max(value, math.ceil(steps) / _STEPS) if math.isfinite(steps) else value


def accepted(examples: Sequence[Labelled], score: Score, limits: Mapping[Group, Threshold], *, right: bool) -> Rate:
    """How many of the right, or of the wrong, hypotheses the thresholds take."""
    asked = [example for example in examples if example.right is right]
    return Rate.counted(sum(limits[e.group].passes(score.of(e.numbers)) for e in asked), len(asked))
