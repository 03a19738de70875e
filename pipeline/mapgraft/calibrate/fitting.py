"""Labels in, thresholds out: the whole of a calibration, rule by rule."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mapgraft.calibrate.acceptance import Floor, Threshold, acceptance, accepted, cost_floor, members
from mapgraft.calibrate.given import CALIBRATED, Given, given_of
from mapgraft.calibrate.groups import Group, named
from mapgraft.calibrate.labelled import Labelled, Labels
from mapgraft.calibrate.others import Promised, left_out
from mapgraft.calibrate.quality import Quality, quality
from mapgraft.calibrate.rates import Rate
from mapgraft.calibrate.remarks import remarks, unwatched
from mapgraft.calibrate.scoring import UNFITTED, Score, fitted, single
from mapgraft.calibrate.taking import Taking, vetoes_of
from mapgraft.calibrate.transfer import Transfer, building_threshold, judged, target_of
from mapgraft.calibrate.verifier import confirms, is_sequential, test_of
from mapgraft.calibrate.watching import Limit, Watch
from mapgraft.decision import Rule
from mapgraft.errors import UsageError

AUTO, FIT = "auto", "fit"
_LOG_ODDS = ".log_odds"
_NEARLY_ALL = 0.9


@dataclass(frozen=True, slots=True)
class Asked:
    """What is to be promised: at most these shares of wrong hypotheses merged, of wrong ones confirmed, and of right
    merges reverted.

    ``score`` is ``fit``, the name of a number, or ``auto``: the log-odds that the rule's acceptor goes by where they
    were measured, else a fit. With ``cost_false_accept`` nothing is merged that costs more than it saves, where not to
    merge what is right costs ``cost_miss``.
    """

    false_accept: float = 0.01
    false_confirm: float = 0.001
    false_revert: float = 0.01
    score: str = AUTO
    cost_false_accept: float | None = None
    cost_miss: float = 1.0

    def __post_init__(self) -> None:
        for name in ("false_accept", "false_confirm", "false_revert"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise UsageError(
                    f"{name.replace('_', '-')} must be a rate between 0 and 1, found {getattr(self, name):g}"
                )
        for name in ("cost_false_accept", "cost_miss"):
            cost = getattr(self, name)
            if cost is not None and not 0.0 < cost < math.inf:
                raise UsageError(f"{name.replace('_', '-')} must be above 0, found {cost:g}")


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """What labels say of one group: three limits, what they do to the labels that set them, and by environment.

    Where the verifier is another than the sequential test, its limits stay, and ``kept`` tells what they did to the
    merges that were read: the share of right ones that was reverted, and of wrong ones that was confirmed.
    ``prior_reverts`` says whether the fall of the probability may still revert a merge, and ``confirm`` is None where
    the rule never confirms such merges, whatever labels say. ``wrong`` and ``right`` are the
    shares that are accepted of the group's labels; ``overlaps`` the latter by overlap.
    """

    group: Group
    accept: Threshold
    revert: Limit | None
    confirm: Limit | None
    prior_reverts: bool
    wrong: Rate
    right: Rate
    overlaps: Sequence[tuple[str, Rate]] = ()
    kept: tuple[Rate, Rate] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RuleFit:
    """One rule of the decision table with everything that labels say of it."""

    given: Given
    score: Score
    examples: int
    setting: int
    fits: Sequence[Fit]
    quality: Quality
    transfer: Transfer
    by_quality: Sequence[tuple[str, Threshold]]

    @property
    def rule(self) -> Rule:
        """The rule as the given table has it."""
        return self.given.rule

    @property
    def finest(self) -> list[Fit]:
        """The groups that labels tell of."""
        return [fit for fit in self.fits if fit.group.resolutions]


@dataclass(frozen=True, slots=True, eq=False)
class Left:
    """A rule that stays as it was, and why; of what turns maps away nothing need be said."""

    rule: Rule
    why: str


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The given decision table in its order, each rule with what labels say of it or left as it was.

    ``remarks`` are sentences about what is doubtful.
    """

    asked: Asked
    labels: Labels
    table: Sequence[RuleFit | Left]
    remarks: Sequence[str]

    @property
    def rules(self) -> list[RuleFit]:
        """The rules of which labels have set the limits."""
        return [one for one in self.table if isinstance(one, RuleFit)]

    @property
    def others(self) -> list[Left]:
        """The procedures that stay as they were, and of which nothing is promised."""
        return [one for one in self.table if isinstance(one, Left) and one.rule.reject is None]


OVERLAPS = ((0.0, 0.1), (0.1, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, math.inf))


def calibrate(labels: Labels, rules: Sequence[Rule], asked: Asked, meant: Labels | None = None) -> Calibration:
    """Set the limits of every rule that labels tell of.

    ``meant`` are examples of the maps for which the limits are meant; their labels are not looked at. Rules that an
    earlier calibration has made of one are set anew with that. Raises UsageError when the labels tell of no rule of
    which they can set limits, or the rules are those to collect examples by.
    """
    given = given_of(rules)
    labels, meant = _of_rules(labels, given), None if meant is None else _of_rules(meant, given)
    told = _told(labels, rules)
    fits = {id(one.rule): _rule(one, told[one.rule.name], meant, asked) for one in given if _is_set(one, told)}
    if not fits:
        why = "; ".join(f"{one.rule.name!r}: {one.kept}" for one in given if one.rule.name in told)
        raise UsageError(f"labels can set no limit of the rules they are of ({why}): these stay as they are")
    anew = {id(rule) for one in given if id(one.rule) in fits for rule in one.made}
    kept = {id(one.rule): one.kept for one in given if one.rule.name in told}
    table = [
        fits.get(id(rule)) or Left(rule, kept.get(id(rule), "no labels tell of it"))
        for rule in rules
        if id(rule) not in anew
    ]
    scores = {fit.rule.name: fit.score for fit in fits.values()}
    unset = {one.rule.name: one.kept for one in given if one.rule.name in told and one.rule.name not in scores}
    said = [f"labels of the rule {name!r} set no limits of it: {why}" for name, why in unset.items()]
    said += remarks(labels, list(told), {rule.name for rule in rules}, list(scores.items()))
    for fit in fits.values():
        said += unwatched(fit.rule.name, [limit for one in fit.fits for limit in (one.revert, one.confirm) if limit])
    return Calibration(asked, labels, table, said)


def _of_rules(labels: Labels, given: Sequence[Given]) -> Labels:
    """The same examples, those of rules that a calibration has made as examples of the rule these were made of."""
    of = {name: one.rule.name for one in given for name in one.names}

    def placed(example: Labelled) -> Labelled:
        name = example.group.rule
        made = None if name in of else named(name)
        base = of.get(name if made is None else made.rule, name)
        return example if base == name else replace(example, group=replace(example.group, rule=base))

    return replace(labels, examples=[placed(example) for example in labels.examples])


def _told(labels: Labels, rules: Sequence[Rule]) -> dict[str, list[Labelled]]:
    """The labelled examples by their rules, by name; raises UsageError when the table has none of these."""
    labelled = labels.labelled
    if not labelled:
        raise UsageError(
            f"none of {len(labels.examples)} examples in {', '.join(labels.folders)} has a label: label them with "
            "mapgraft annotate, or evaluate recordings whose poses are trusted with --examples"
        )
    told: dict[str, list[Labelled]] = {name: [] for name in sorted({example.group.rule for example in labelled})}
    for example in labelled:
        told[example.group.rule].append(example)
    names = [rule.name for rule in rules]
    if not any(name in names for name in told):
        raise UsageError(
            f"the labels are of the rules {', '.join(told)}, the decision table has {', '.join(names) or 'none'}: "
            "name the table that has these rules with --rules; of rules to collect examples by it is the one that "
            "they were made of"
        )
    return told


def _is_set(given: Given, told: Mapping[str, Sequence[Labelled]]) -> bool:
    return given.rule.name in told and not given.kept


def _rule(given: Given, examples: Sequence[Labelled], meant: Labels | None, asked: Asked) -> RuleFit:
    rule = given.rule

    def choose(some: Sequence[Labelled]) -> tuple[Score, Sequence[Labelled]]:
        return choice(some, rule, asked)

    score, setting = choose(examples)
    if asked.score not in (AUTO, FIT) and not np.isfinite(score.all(examples)).any():
        there = ", ".join(sorted({name for example in examples for name in example.numbers}))
        raise UsageError(f"no example tells the number {asked.score}: choose one of {there}")
    known = quality(setting, score, choose)
    floor = cost_floor(known.curve, asked.cost_false_accept, asked.cost_miss)
    buildings = sorted({name for example in setting for name in example.buildings})
    everywhere = building_threshold(setting, score, asked.false_accept)
    if math.isfinite(everywhere) and everywhere > floor.value:
        floor = Floor(everywhere, "buildings, of which a further one is promised, too,")
    fits = _fits(setting, examples, score, given, asked, floor)
    promised = _promised(rule, asked)
    tested = [left_out(examples, name, choose, promised) for name in buildings] if len(buildings) > 1 else []
    limits = {fit.group: fit.accept.value for fit in fits}
    apart = max((one.unlike for one in tested if not math.isnan(one.unlike)), default=0.0)
    unlabelled = [example for example in (meant.examples if meant else ()) if example.group.rule == rule.name]
    targets = target_of(setting, unlabelled, score, limits, apart)
    transfer = judged(
        len(buildings),
        promised,
        tested,
        targets,
        by_buildings=math.isfinite(everywhere),
        confirms=any(fit.confirm is not None and fit.confirm.value is not None for fit in fits),
        reverts=any(fit.revert is not None and fit.revert.value is not None for fit in fits),
    )
    return RuleFit(
        given, score, len(examples), len(setting), fits, known, transfer, _by_quality(setting, score, rule, asked)
    )


def choice(examples: Sequence[Labelled], rule: Rule, asked: Asked) -> tuple[Score, Sequence[Labelled]]:
    """The score of some examples, and those that are left to set thresholds: of buildings it was not fitted on."""
    if asked.score not in (AUTO, FIT):
        return single(asked.score), examples
    number = _log_odds(rule) if asked.score == AUTO and examples else None
    if number is not None:
        has = sum(not math.isnan(example.numbers.get(number, math.nan)) for example in examples)
        if has >= _NEARLY_ALL * len(examples):
            return single(number), examples
    ours, theirs = parts(examples)
    found = fitted(ours)
    return (single(UNFITTED), examples) if found is None or not theirs else (found, theirs)


def parts(examples: Sequence[Labelled]) -> tuple[list[Labelled], list[Labelled]]:
    """Two parts with about as many labels each that share no building; pairs of a building of either are left out.

    Which building goes where depends on the names of all, not on their order.
    """
    sizes: dict[str, int] = {}
    for example in examples:
        for name in example.buildings:
            sizes[name] = sizes.get(name, 0) + 1
    total, ours = {True: 0, False: 0}, dict[str, bool]()
    for name in sorted(sizes, key=lambda name: (-sizes[name], hashlib.blake2b(name.encode()).digest())):
        side = total[True] < total[False]
        ours[name] = side
        total[side] += sizes[name]
    first = [example for example in examples if all(ours[name] for name in example.buildings)]
    return first, [example for example in examples if not any(ours[name] for name in example.buildings)]


def _log_odds(rule: Rule) -> str | None:
    """The log-odds by which a rule accepts; None where it goes by another score of its own."""
    told = {} if rule.accept is None else rule.accept.parameters
    if rule.accept is None or rule.accept.use != CALIBRATED:
        return f"{told.get('metric') or 'posterior'}{_LOG_ODDS}"
    score = told.get("score")
    if not isinstance(score, Mapping) or list(score.values()) != [1.0] or told.get("intercept"):
        return None
    number = str(next(iter(score)))
    return number if number.endswith(_LOG_ODDS) else None


def _promised(rule: Rule, asked: Asked) -> Promised:
    """What is asked for, and what of the rule it hangs on."""
    test = test_of(rule) if is_sequential(rule) else None
    return Promised(asked.false_accept, asked.false_confirm, asked.false_revert, vetoes_of(rule), test)


def _fits(
    setting: Sequence[Labelled], examples: Sequence[Labelled], score: Score, given: Given, asked: Asked, floor: Floor
) -> list[Fit]:
    """All groups of a rule, the finest first: thresholds, then the limits of what they let through."""
    finest = sorted({example.group for example in examples}, key=lambda group: group.name)
    steps = [step for level in range(3) for group in finest for step in group.coarser[level : level + 1]]
    limits = {group: acceptance(setting, score, group, asked.false_accept, floor) for group in dict.fromkeys(steps)}
    return [_fit(group, limits, setting, score, asked, given.rule_for(group)) for group in limits]


def _fit(
    group: Group,
    limits: Mapping[Group, Threshold],
    setting: Sequence[Labelled],
    score: Score,
    asked: Asked,
    rule: Rule,
) -> Fit:
    """``rule`` is the one that the table has for the group: limits of confirmation are never looser than its own."""
    limit, here = limits[group], members(setting, group)
    same = {example.group: limit for example in here}
    right, wrong = (accepted(here, score, same, right=kind) for kind in (True, False))
    revert, confirm, falls = None, None, True
    promised = _promised(rule, asked)
    if promised.test is not None and math.isfinite(limit.value):
        by = limits if group.resolutions else dict.fromkeys(limits, limit)  # what takes the members of a coarser group
        watch = Watch(setting, Taking(score, by, promised.vetoes), promised.test)
        revert, falls = watch.reversal(group, promised.revert)
        found = watch.confirmation(group, promised.confirm, revert.value)
        confirm = found if found.value is None or confirms(rule.verify, group.reversal) else None
        falls = falls and promised.test.revert_below > 0.0
    kept = None if is_sequential(rule) else _kept(here)
    return Fit(group, limit, revert, confirm, falls, wrong, right, _by_overlap(here, score, same), kept)


def _kept(examples: Sequence[Labelled]) -> tuple[Rate, Rate]:
    """Of the merges that were read, how many right ones were reverted and how many wrong ones confirmed."""
    right, wrong = ([e for e in examples if e.looks and e.right is kind] for kind in (True, False))
    return Rate.counted(sum(e.reverted for e in right), len(right)), Rate.counted(
        sum(e.confirmed and e.right_later is not True for e in wrong), len(wrong)
    )


def _by_overlap(
    examples: Sequence[Labelled], score: Score, limits: Mapping[Group, Threshold]
) -> list[tuple[str, Rate]]:
    out = []
    for low, high in OVERLAPS:
        here = [e for e in examples if e.overlap is not None and low < e.overlap + (low == 0.0) * 1e-12 <= high]
        name = f"above {low:g}" if math.isinf(high) else f"{low:g} to {high:g}"
        out.append((name, accepted(here, score, limits, right=True)))
    return out


def _by_quality(examples: Sequence[Labelled], score: Score, rule: Rule, asked: Asked) -> list[tuple[str, Threshold]]:
    """The threshold that each third of the wrong hypotheses, by the quality of the worse map, would set alone."""
    wrong = sorted(
        (e for e in examples if e.right is False and e.quality is not None), key=lambda e: (e.quality or 0.0, e.unit)
    )
    out, group = [], Group(rule.name)
    for n in range(3):
        third = wrong[len(wrong) * n // 3 : len(wrong) * (n + 1) // 3]
        if third:
            name = f"{third[0].quality:.2f} to {third[-1].quality:.2f}"
            out.append((name, acceptance(third, score, group, asked.false_accept)))
    return out
