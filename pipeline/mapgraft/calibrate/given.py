"""The decision table that a calibration is given: of which rules labels can set limits, and which were made of one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from mapgraft.calibrate.conditions import together
from mapgraft.calibrate.groups import Group, named
from mapgraft.decision import Rule
from mapgraft.errors import UsageError

CALIBRATED: Final = "calibrated"  # the acceptor that goes by labels
SEQUENTIAL: Final = "sequential"  # the verifier whose limits labels can set
GUESSED: Final = ("posterior", CALIBRATED, "thresholds")  # acceptors that judge what a search has found
FAR: Final = 1e300  # beyond any score, and any log-odds
_KNOWN_POSE: Final = "known_pose"  # the matcher that searches nothing


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """One rule of the table, and those that an earlier calibration has made of it for single groups.

    ``kept`` says why labels cannot set its limits, empty where they can.
    """

    rule: Rule
    made: Sequence[Rule] = ()
    kept: str = ""

    @property
    def names(self) -> set[str]:
        """Its own name and those of the rules that were made of it."""
        return {self.rule.name, *(rule.name for rule in self.made)}

    def rule_for(self, group: Group) -> Rule:
        """The rule that the table has for a group: one made for it, or for the first coarser one, or the rule.

        One that no maps of the group meet is passed over: somebody has given it other conditions.
        """
        by_name = {rule.name: rule for rule in reversed(self.made)}
        for step in group.coarser:
            rule = by_name.get(step.rule_name(self.rule.name))
            if rule is not None and together(self.rule.when, rule.when, group.conditions) is not None:
                return rule
        return self.rule


def given_of(rules: Sequence[Rule]) -> list[Given]:
    """The rules of a table in its order, but for those that were made of another one, which are with that.

    Raises UsageError where a rule is one to collect examples by: its limits are those of nobody.
    """
    for rule in rules:
        if _collects(rule):
            raise UsageError(
                f"the rule {rule.name!r} merges whatever comes first, to collect examples: name the decision table "
                "that limits are to be set in with --rules, or none for the installed one"
            )
    counts = Counter(rule.name for rule in rules if rule.reject is None)
    bases = {rule.name for rule in rules if counts[rule.name] == 1 and not untouched(rule)}
    made = [(rule, base) for rule in rules if (base := _base(rule, bases)) is not None]
    known = {rule.name: base for rule, base in made}
    roots = {id(rule): _root(base, known) for rule, base in made}
    return [
        Given(
            rule,
            [other for other, _ in made if roots[id(other)] == rule.name and rule.reject is None],
            _shared(rule, counts) or untouched(rule),
        )
        for rule in rules
        if id(rule) not in roots
    ]


def untouched(rule: Rule) -> str:
    """Why labels cannot set the limits of a rule, empty where they can."""
    if rule.match is None or rule.accept is None:
        return "it turns maps away"
    if "prior_sigma_m" in rule.when or rule.match.use == _KNOWN_POSE:
        return "it goes by a pose that somebody knows, and searches none"
    if rule.accept.use not in GUESSED:
        return f"labels set limits of the acceptors {', '.join(GUESSED)}, and its own is {rule.accept.use}"
    return ""


def _shared(rule: Rule, counts: Counter[str]) -> str:
    if rule.reject is not None or counts[rule.name] == 1:
        return ""
    return "several rules have this name, and labels do not tell which of them they are of"


def _collects(rule: Rule) -> bool:
    if rule.accept is None or rule.accept.use != CALIBRATED:
        return False
    above = rule.accept.parameters.get("accept_above")
    return isinstance(above, int | float) and above <= -FAR


def _base(rule: Rule, bases: set[str]) -> str | None:
    """The name of the rule that a calibration has made this one of; None where it is one by itself."""
    group = named(rule.name)
    is_made = rule.accept is not None and rule.accept.use == CALIBRATED
    return group.rule if group is not None and is_made and group.rule in bases else None


def _root(base: str, made: Mapping[str, str]) -> str:
    """The rule at the beginning of all, where one that a calibration has made was made of another such."""
    while base in made:
        base = made[base]
    return base
