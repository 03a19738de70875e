"""What thresholds are set for one by one: maps of certain types and resolutions, met by one rule under one reversal."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from mapgraft.decision import Condition, Range

_ALIKE = 0.01  # resolutions that differ by less are the same
_MAP = r"(\S+?)(?: (\d+(?:\.\d+)?(?:e[+-]\d+)?) m)?"
_MADE = re.compile(rf"(.+): {_MAP} ← {_MAP}(, any resolution)?, (\w+)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Group:
    """Examples that share a threshold. What is None or empty is not told apart.

    ``resolutions`` says whether resolutions are told apart; one that is None then is of a type that has none.
    """

    rule: str
    receiver_type: str = ""
    donor_type: str = ""
    reversal: str = ""
    own_m: float | None = None
    other_m: float | None = None
    resolutions: bool = False

    @property
    def coarser(self) -> tuple[Group, ...]:
        """This group and those that it falls back to where labels are too few, the finest first."""
        steps = [self]
        if self.resolutions:
            steps.append(replace(self, own_m=None, other_m=None, resolutions=False))
        if self.receiver_type:
            steps.append(Group(self.rule))
        return tuple(steps)

    def holds(self, other: Group) -> bool:
        """Whether a group is this one, or falls back to it."""
        if self.rule != other.rule or not self.receiver_type:
            return self.rule == other.rule
        told = (self.receiver_type, self.donor_type, self.reversal)
        if told != (other.receiver_type, other.donor_type, other.reversal):
            return False
        return not self.resolutions or (self.own_m, self.other_m) == (other.own_m, other.other_m)

    @property
    def name(self) -> str:
        """What it is called for persons: ``occupancy_grid 0.07 m ← occupancy_grid 0.1 m, ledger``."""
        if not self.receiver_type:
            return "all maps of the rule"
        own, other = (
            f"{kind} {metres:g} m" if metres else kind
            for kind, metres in ((self.receiver_type, self.own_m), (self.donor_type, self.other_m))
        )
        rest = "" if self.resolutions else ", any resolution"
        return f"{own} ← {other}{rest}, {self.reversal}"

    def rule_name(self, base: str) -> str:
        """What the rule for this group alone is called that is made of the rule ``base``."""
        return f"{base}: {self.name}" if self.receiver_type else base

    def base_of(self, rule: str) -> str | None:
        """The rule that a rule for this group was made of, None where it is another one."""
        suffix = f": {self.name}"
        return rule.removesuffix(suffix) if self.receiver_type and rule.endswith(suffix) else None

    @property
    def conditions(self) -> dict[str, Condition]:
        """The conditions of a decision table under which maps are of this group, beside those of the rule."""
        when: dict[str, Condition] = {}
        if self.receiver_type:
            when |= {"own.type": self.receiver_type, "other.type": self.donor_type, "reversal": self.reversal}
        for side, metres in (("own", self.own_m), ("other", self.other_m)):
            if metres is not None:
                low, high = (float(f"{metres * off:.4g}") for off in (1 - _ALIKE, 1 + _ALIKE))
                when[f"{side}.resolution_m"] = Range(min=low, max=high)
        return when


def named(rule: str) -> Group | None:
    """The group that a rule was made for, by the name that ``Group.rule_name`` gave it; None where it has another.

    The group's ``rule`` is what that was made of.
    """
    found = _MADE.fullmatch(rule)
    if found is None:
        return None
    base, own, own_m, other, other_m, any_m, reversal = found.groups()
    receiver_m, donor_m = (None if metres is None else float(metres) for metres in (own_m, other_m))
    group = Group(base, own, other, reversal, receiver_m, donor_m, resolutions=any_m is None)
    return group if group.rule_name(base) == rule else None


def told(metres: float | None) -> float | None:
    """A resolution as groups tell it: rounded, so that what differs by noise is the same."""
    return None if metres is None or metres <= 0.0 else float(f"{metres:.3g}")
