"""Two robots' maps before an attempt: what is told of them, and which rule of the decision table is for them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from mapgraft.contracts import MapMetadata, Prior
from mapgraft.decision import DecisionTable, Rule, Ruling, facts_of
from mapgraft.persons import sigma_m
from mapgraft.procedures import Workshop
from mapgraft.registration import Site


@dataclass(frozen=True, slots=True, eq=False)
class Encounter:
    """What receiver and donor tell of their maps before one attempt, and what is known of how they site."""

    own: MapMetadata
    other: MapMetadata
    prior: Prior | None
    stamp_ns: int

    @property
    def site(self) -> Site:
        return Site.of(self.own, self.other)


@dataclass(slots=True)
class Rules:
    """The rules that apply to one encounter, one after the other, as long as plugins of them fail."""

    table: DecisionTable
    workshop: Workshop
    met: Encounter
    reversal: Literal["ledger", "single_map", "multi_map"]
    ruling: Ruling = field(init=False)
    _passed: dict[int, str] = field(init=False)

    def __post_init__(self) -> None:
        own, other = self.met.own.type, self.met.other.type
        rules = [record.rule for record in self.table.records]
        self._passed = {id(rule): why for rule in rules if (why := self.workshop.out_of_order(rule, own, other))}

    def next(self) -> Rule | None:
        """The first rule that applies; None for a rejection, of which ``ruling`` tells the reasons."""
        facts = facts_of(self.met.own, self.met.other, sigma_m(self.met.prior), self.reversal)
        self.ruling = self.table.choose(facts, self._passed)
        return None if self.ruling.rejected else self.ruling.rule

    def pass_over(self, rule: Rule, why: str) -> None:
        """Leave out a rule of which a plugin has failed."""
        self._passed[id(rule)] = why
