"""Whether a bound carries over to another building: what the labels say, and what nobody can say from so few.

A threshold is promised for pairs that are drawn like those that set it: in the same buildings. For another building
the buildings would have to be exchangeable, and there are few of them: K give no bound below 1 / (K + 1) without
assumptions. With fewer the bound carries over if wrong hypotheses score elsewhere as they do here. That can be refuted:
by a building that is left out, and by the scores of the maps that the thresholds are meant for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mapgraft.calibrate.acceptance import acceptance, accepted
from mapgraft.calibrate.conformal import best_rate, needed, threshold
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.labelled import Labelled
from mapgraft.calibrate.rates import Rate, above
from mapgraft.calibrate.regression import Vector
from mapgraft.calibrate.scoring import Score

Choose = Callable[[Sequence[Labelled]], tuple[Score, Sequence[Labelled]]]
Verdict = Literal["guaranteed", "not refuted", "none"]
DOUBT = 0.05  # a left-out building's rate that is so improbable under the bound refutes that it carries over
KOLMOGOROV = 1.63  # of two samples' distance that chance exceeds in 1 % of cases
_LEAST = 30  # examples: fewer tell nothing of a distribution


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """A building judged by the labels of the others: what their threshold takes of it.

    ``threshold`` is None where the others have too few labels; ``doubt`` is the probability of so many wrong ones
    accepted if the bound held, and ``unlike`` how far its scores are from any mixture of the others'.
    """

    building: str
    threshold: float | None
    wrong: Rate
    right: Rate
    doubt: float
    unlike: float


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """Maps for which the thresholds are meant, without labels: how far their scores are from what was labelled."""

    environment: str
    examples: int
    accepted: Rate
    unlike: float
    unlike_here: float
    chance: float
    unknown_groups: tuple[str, ...]

    @property
    def expected(self) -> float:
        """The distance up to which nothing is surprising."""
        return max(self.unlike_here, self.chance)

    @property
    def refuted(self) -> bool:
        """Whether its scores are further off than those of any labelled building, and than chance explains.

        What is too little to be compared, or of a kind without labels, is not vouched for either.
        """
        return bool(self.unknown_groups) or not self.unlike <= self.expected


@dataclass(frozen=True, slots=True, eq=False)
class Transfer:
    """Whether the bound holds elsewhere, with the reason in a sentence."""

    verdict: Verdict
    reason: str
    buildings: int
    best_rate: float
    left_out: Sequence[LeftOut]
    target: Sequence[Target]


def building_threshold(examples: Sequence[Labelled], score: Score, rate: float) -> float:
    """The threshold whose promise is on a further building; infinite where there are too few buildings for it."""
    wrong = [example for example in examples if example.right is False and len(example.buildings) == 1]
    scores = np.nan_to_num(score.all(wrong), nan=-np.inf)
    return threshold(scores, rate, [example.environment for example in wrong])


def left_out(examples: Sequence[Labelled], building: str, choose: Choose, rate: float) -> LeftOut:
    """Judge a building by score and threshold of the others; ``choose`` makes a score of examples, and says which of
    them are left to set a threshold."""
    others = [example for example in examples if building not in example.buildings]
    here = [example for example in examples if building in example.buildings]
    score, setting = choose(others)
    limits = {group: acceptance(setting, score, group, rate) for group in {e.group for e in here}}
    told = [example for example in here if math.isfinite(limits[example.group].value)]
    wrong, right = (accepted(told, score, limits, right=kind) for kind in (False, True))
    finite = [limit.value for limit in limits.values() if math.isfinite(limit.value)]
    return LeftOut(
        building,
        max(finite) if finite else None,
        wrong,
        right,
        above(wrong.count, wrong.of, rate) if wrong.of else math.nan,
        unlike(score.all([e for e in here if e.environment == building]), *_by_label(others, score)),
    )


def unlike(scores: Vector, right: Vector, wrong: Vector) -> float:
    """How far a distribution of scores is from the nearest mixture of right and wrong ones (Kolmogorov's distance).

    How many are right elsewhere is not known and may differ; how right and wrong ones score should not. NaN where there
    are fewer than 30 scores, or none of one kind.
    """
    told, right, wrong = (values[np.isfinite(values)] for values in (scores, right, wrong))
    if len(told) < _LEAST or not len(right) or not len(wrong):
        return math.nan
    at = np.unique(np.concatenate((told, right, wrong)))
    here, of_right, of_wrong = (np.searchsorted(np.sort(v), at, side="right") / len(v) for v in (told, right, wrong))
    shares = np.linspace(0.0, 1.0, 101)[:, None]
    return float(np.abs(here - (shares * of_right + (1.0 - shares) * of_wrong)).max(axis=1).min())


def target_of(
    examples: Sequence[Labelled], meant: Sequence[Labelled], score: Score, limits: Mapping[Group, float], apart: float
) -> list[Target]:
    """How the maps for which thresholds are meant compare with what was labelled, an environment at a time.

    ``apart`` is how far the labelled buildings are from each other. Pairs across two buildings are left out: they are
    all wrong, and no mission has them.
    """
    out = []
    known = {example.group for example in examples if example.right is not None}
    right, wrong = _by_label(examples, score)
    for name in sorted({example.environment for example in meant if len(example.buildings) == 1}):
        here = [example for example in meant if example.environment == name]
        scores = score.all(here)
        took = sum(value > limits.get(e.group, math.inf) for value, e in zip(scores.tolist(), here, strict=True))
        chance = KOLMOGOROV * math.sqrt(1.0 / len(here) + 1.0 / max(1, min(len(right), len(wrong))))
        strange = tuple(sorted({example.group.name for example in here if example.group not in known}))
        out.append(
            Target(name, len(here), Rate.counted(took, len(here)), unlike(scores, right, wrong), apart, chance, strange)
        )
    return out


def judged(
    buildings: int, rate: float, tested: Sequence[LeftOut], meant: Sequence[Target], *, by_buildings: bool
) -> Transfer:
    """What can be said of another building."""

    def said(verdict: Verdict, reason: str) -> Transfer:
        return Transfer(verdict, reason, buildings, best_rate(buildings), tested, meant)

    asked = [one for one in tested if one.wrong.of]
    against = [_why(target) for target in meant if target.refuted]
    if asked and not by_buildings and min(one.doubt for one in asked) * len(asked) < DOUBT:  # Bonferroni
        one = min(asked, key=lambda one: one.doubt)
        against.append(
            f"with labels of the other buildings alone {one.wrong.text} of the wrong ones in {one.building} would be "
            f"accepted where {100 * rate:g} % was asked for: they differ too much for the bound to carry over; the "
            f"strictest of these {buildings} has set the threshold, and of {buildings + 1} that are exchangeable a "
            f"further one is stricter still with probability 1/{buildings + 1}"
        )
    if against:
        return said("none", ". ".join(sentence[:1].upper() + sentence[1:] for sentence in against))
    if by_buildings:
        return said("guaranteed", f"labels of {buildings} buildings are enough, if another is exchangeable with them")
    if buildings < 2:
        return said("none", "thresholds are set by labels of one building only, which say nothing about another")
    if len(asked) < 2:
        return said("none", "no two buildings have labels enough to be tested on each other")
    return said(
        "not refuted",
        f"{buildings} buildings give no bound below {100 * best_rate(buildings):.3g} % for another one without "
        f"assumptions ({needed(rate)} would); the bound carries over if wrong hypotheses score there as they do here, "
        "which no building that was left out refutes",
    )


def _why(target: Target) -> str:
    if target.unknown_groups:
        return f"of {target.environment} there are maps without any labels: {target.unknown_groups[0]}"
    if math.isnan(target.unlike):
        return f"of {target.environment} there are {target.examples} examples, {_LEAST} are needed to be compared"
    return (
        f"of {target.environment} the scores are {target.unlike:.2f} away from any mixture of the labelled ones, the "
        f"labelled buildings at most {target.expected:.2f} from each other or by chance"
    )


def _by_label(examples: Sequence[Labelled], score: Score) -> tuple[Vector, Vector]:
    right, wrong = ([e for e in examples if e.right is kind] for kind in (True, False))
    return score.all(right), score.all(wrong)
