"""Whether a bound carries over to another building: what the labels say, and what nobody can say from so few.

Limits are promised for pairs that are drawn like those that set them: in the same buildings. For another building
the buildings would have to be exchangeable, and there are few of them: K give no bound below 1 / (K + 1) without
assumptions. With fewer the bound carries over if hypotheses score, and merges are judged, elsewhere as they are here.
That can be refuted: by a building that is left out, and by the scores of the maps that the thresholds are meant for.
It is said of each of the three promises by itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from mapgraft.calibrate.conformal import best_rate, needed, threshold
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.labelled import Labelled
from mapgraft.calibrate.likeness import KOLMOGOROV, LEAST, by_label, unlike
from mapgraft.calibrate.others import LeftOut, Promised, Trial
from mapgraft.calibrate.rates import Rate
from mapgraft.calibrate.scoring import Score

Verdict = Literal["guaranteed", "not refuted", "none"]
Kind = Literal["accept", "confirm", "revert"]
DOUBT: Final = 0.05  # a left-out building's rate that is so improbable under the bound refutes that it carries over
SAID_OF: Final[Mapping[Kind, str]] = {
    "accept": "wrong ones merged",
    "confirm": "wrong ones confirmed",
    "revert": "right ones reverted",
}
_BEYOND: Final[Mapping[Kind, str]] = {
    "accept": "of the wrong ones in {} would be accepted",
    "confirm": "of the wrong ones in {} would be confirmed",
    "revert": "of the right merges in {} would be reverted",
}
_ASSUMED: Final[Mapping[Kind, str]] = {
    "accept": "wrong hypotheses score there as they do here",
    "confirm": "wrong hypotheses score, and wrong merges are judged, there as they are here",
    "revert": "right merges are judged there as they are here",
}
_TELLING: Final[Mapping[Kind, str]] = {
    "accept": "wrong hypotheses",
    "confirm": "wrong hypotheses",
    "revert": "right merges",
}


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


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """Whether one promise holds in another building, with the reason in a sentence."""

    verdict: Verdict
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Transfer:
    """Whether the bounds hold elsewhere: that on wrong hypotheses merged, and those on confirmed and on reverted ones.

    The latter two are None where nothing is promised of them here either.
    """

    accept: Elsewhere
    confirm: Elsewhere | None
    revert: Elsewhere | None
    buildings: int
    best_rate: float
    left_out: Sequence[LeftOut]
    target: Sequence[Target]

    @property
    def told(self) -> Sequence[tuple[Kind, Elsewhere]]:
        """What is said of each promise that is made here."""
        kinds: tuple[tuple[Kind, Elsewhere | None], ...] = (
            ("accept", self.accept),
            ("confirm", self.confirm),
            ("revert", self.revert),
        )
        return [(kind, said) for kind, said in kinds if said is not None]


def building_threshold(examples: Sequence[Labelled], score: Score, rate: float) -> float:
    """The threshold whose promise is on a further building; infinite where there are too few buildings for it."""
    wrong = [example for example in examples if example.right is False and len(example.buildings) == 1]
    scores = np.nan_to_num(score.all(wrong), nan=-np.inf)
    return threshold(scores, rate, [example.environment for example in wrong])


def target_of(
    examples: Sequence[Labelled], meant: Sequence[Labelled], score: Score, limits: Mapping[Group, float], apart: float
) -> list[Target]:
    """How the maps for which thresholds are meant compare with what was labelled, an environment at a time.

    ``apart`` is how far the labelled buildings are from each other. Pairs across two buildings are left out: they are
    all wrong, and no mission has them.
    """
    out = []
    known = {example.group for example in examples if example.right is not None}
    right, wrong = by_label(examples, score)
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
    buildings: int,
    promised: Promised,
    tested: Sequence[LeftOut],
    meant: Sequence[Target],
    *,
    by_buildings: bool,
    confirms: bool,
    reverts: bool,
) -> Transfer:
    """What can be said of another building.

    ``by_buildings`` says that the thresholds are at least those of which a further building is promised; ``confirms``
    and ``reverts`` that there are limits that labels have set.
    """
    merged = [(one.building, one.wrong) for one in tested]
    confirmed = [(one.building, one.confirmed) for one in tested if one.confirmed is not None]
    reverted = [(one.building, one.reverted) for one in tested if one.reverted is not None]
    against = [_why(target) for target in meant if target.refuted]
    if by_buildings:
        reason = f"labels of {buildings} buildings are enough, if another is exchangeable with them"
        accept = _refuted(against) if against else Elsewhere("guaranteed", reason)
    else:
        accept = _by_trials("accept", promised.accept, merged, buildings, against)
    confirm = _by_trials("confirm", promised.confirm, confirmed, buildings, against) if confirms else None
    revert = _by_trials("revert", promised.revert, reverted, buildings, against) if reverts else None
    return Transfer(accept, confirm, revert, buildings, best_rate(buildings), tested, meant)


def _by_trials(
    kind: Kind, rate: float, trials: Sequence[tuple[str, Trial]], buildings: int, against: Sequence[str]
) -> Elsewhere:
    """What buildings that were left out in turn say of a promise.

    Any of them can refute it; but that it is not refuted says something only where two have labels enough that they
    could have.
    """
    asked = [(name, trial) for name, trial in trials if trial.beyond.of]
    said = list(against)
    if asked and min(trial.doubt for _, trial in asked) * len(asked) < DOUBT:  # Bonferroni
        said.append(_too_many(kind, rate, *min(asked, key=lambda one: one[1].doubt), buildings))
    if said:
        return _refuted(said)
    if buildings < 2:
        return Elsewhere("none", "limits are set by labels of one building only, which say nothing about another")
    able = [name for name, trial in asked if trial.labels >= needed(rate)]
    if len(able) < 2:
        return Elsewhere(
            "none",
            f"no two buildings have labels enough to refute each other: that takes {needed(rate)} {_TELLING[kind]} in "
            "each",
        )
    few = sorted({name for name, _ in trials} - {*able})
    return Elsewhere(
        "not refuted",
        f"{_no_bound(kind, buildings, rate)}; the bound carries over if {_ASSUMED[kind]}, which no building that was "
        f"left out refutes{f' ({_named(few)} too few labels to tell)' if few else ''}",
    )


def _no_bound(kind: Kind, buildings: int, rate: float) -> str:
    if kind != "accept":
        return f"labels of {buildings} buildings bound nothing in another one without assumptions"
    return (
        f"{buildings} buildings give no bound below {100 * best_rate(buildings):.3g} % for another one without "
        f"assumptions ({needed(rate)} would)"
    )


def _named(few: Sequence[str]) -> str:
    return f"{', '.join(few)} {'has' if len(few) == 1 else 'have'}"


def _too_many(kind: Kind, rate: float, building: str, trial: Trial, buildings: int) -> str:
    said = (
        f"with labels of the other buildings alone {trial.beyond.text} {_BEYOND[kind].format(building)} where "
        f"{100 * rate:g} % was asked for: they differ too much for the bound to carry over"
    )
    if kind != "accept":
        return said
    return (
        f"{said}; the strictest of these {buildings} has set the threshold, and of {buildings + 1} that are "
        f"exchangeable a further one is stricter still with probability 1/{buildings + 1}"
    )


def _refuted(against: Sequence[str]) -> Elsewhere:
    """No guarantee, because of what is against it."""
    return Elsewhere("none", ". ".join(one[:1].upper() + one[1:] for one in against))


def _why(target: Target) -> str:
    if target.unknown_groups:
        return f"of {target.environment} there are maps without any labels: {target.unknown_groups[0]}"
    if math.isnan(target.unlike):
        return f"of {target.environment} there are {target.examples} examples, {LEAST} are needed to be compared"
    return (
        f"of {target.environment} the scores are {target.unlike:.2f} away from any mixture of the labelled ones, the "
        f"labelled buildings at most {target.expected:.2f} from each other or by chance"
    )
