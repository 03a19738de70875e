"""Each building judged by the labels of the others alone: thresholds and limits that these would set, and what they do
to its own labels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mapgraft.calibrate.acceptance import acceptance, accepted
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.labelled import Labelled
from mapgraft.calibrate.likeness import by_label, unlike
from mapgraft.calibrate.rates import Rate, above
from mapgraft.calibrate.scoring import Choose
from mapgraft.calibrate.sequential import Test
from mapgraft.calibrate.taking import Taking, Veto
from mapgraft.calibrate.units import Unit
from mapgraft.calibrate.watching import Watch


@dataclass(frozen=True, slots=True)
class Promised:
    """The rates that are to be promised, the vetoes of the rule, and its test; None where it has another verifier."""

    accept: float
    confirm: float
    revert: float
    vetoes: tuple[Veto, ...] = ()
    test: Test | None = None


@dataclass(frozen=True, slots=True)
class Trial:
    """How many labels of a building go beyond what the others have set.

    ``labels`` counts independent ones of the building by itself, without pairs across two. ``doubt`` is the probability
    of so many or more beyond if the bound held: the same two maps count once, with the share of them that is beyond,
    and what that makes in all is rounded down. It is NaN where there are none.
    """

    beyond: Rate
    labels: int
    doubt: float

    @classmethod
    def of(cls, told: Sequence[tuple[Labelled, bool]], building: str, rate: float) -> Trial:
        """``told`` are the labels that concern the building, and whether each is beyond."""
        units: dict[Unit, list[bool]] = {}
        for example, is_beyond in told:
            units.setdefault(example.unit, []).append(is_beyond)
        own = {example.unit for example, _ in told if example.environment == building}
        count = math.floor(math.fsum(sum(those) / len(those) for those in units.values()) + 1e-9)
        beyond = Rate.counted(sum(is_beyond for _, is_beyond in told), len(told))
        return cls(beyond, len(own), above(count, len(units), rate) if told else math.nan)


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """What the thresholds and limits of the others make of a building: wrong and right hypotheses that are accepted,
    wrong ones that are confirmed, right merges that are reverted.

    ``threshold`` is None where the others have too few labels, ``confirmed`` and ``reverted`` where there is no test;
    ``unlike`` is how far its scores are from any mixture of the others'.
    """

    building: str
    threshold: float | None
    wrong: Trial
    right: Rate
    unlike: float
    confirmed: Trial | None = None
    reverted: Trial | None = None


def left_out(examples: Sequence[Labelled], building: str, choose: Choose, promised: Promised) -> LeftOut:
    """Judge a building by the labels of the others; ``choose`` makes a score of examples, and says which of them are
    left to set thresholds."""
    others = [example for example in examples if building not in example.buildings]
    here = [example for example in examples if building in example.buildings]
    score, setting = choose(others)
    limits = {group: acceptance(setting, score, group, promised.accept) for group in _groups((*setting, *here))}
    told = [example for example in here if math.isfinite(limits[example.group].value)]
    wrong = [(e, limits[e.group].passes(score.of(e.numbers))) for e in told if e.right is False]
    own = score.all([example for example in here if example.environment == building])
    watch = None if promised.test is None else Watch(setting, Taking(score, limits, promised.vetoes), promised.test)
    return LeftOut(
        building,
        max((limits[example.group].value for example in told), default=None),
        Trial.of(wrong, building, promised.accept),
        accepted(told, score, limits, right=True),
        unlike(own, *by_label(others, score)),
        *((None, None) if watch is None else _watched(watch, told, building, promised)),
    )


def _watched(watch: Watch, told: Sequence[Labelled], building: str, promised: Promised) -> tuple[Trial, Trial]:
    """What the limits of the others confirm and revert; what nobody has watched tells nothing."""
    confirmed: list[tuple[Labelled, bool]] = []
    reverted: list[tuple[Labelled, bool]] = []
    for group in _groups(told):
        here = [example for example in told if example.group == group]
        revert, falls = watch.reversal(group, promised.revert)
        confirm = watch.confirmation(group, promised.confirm, revert.value)
        if revert.value is not None:
            stand = [example for example in here if example.looks and watch.stands(example)]
            reverted += [(example, watch.height(example, falls=falls) >= revert.value) for example in stand]
        if confirm.value is not None:
            wrong = [e for e in here if watch.misleads(e) and (e.looks or not watch.takes(e))]
            confirmed += [(example, watch.depth(example, revert.value) <= confirm.value) for example in wrong]
    return Trial.of(confirmed, building, promised.confirm), Trial.of(reverted, building, promised.revert)


def _groups(examples: Iterable[Labelled]) -> list[Group]:
    return sorted({example.group for example in examples}, key=lambda group: group.name)
