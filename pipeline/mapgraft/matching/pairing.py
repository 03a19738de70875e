"""Two ready maps through the engine: the decision table, the rule's matcher, metrics and acceptor, and the fuser."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from mapgraft.attempt import Attempt, Attempts
from mapgraft.contracts import Donation, Map, Match, Measurement, Provenance
from mapgraft.decision import DecisionTable, Ruling, facts_of
from mapgraft.matching.ready_map import ReadyMap
from mapgraft.procedures import Tools, Workshop
from mapgraft.witness import Witness

Outcome = Literal["provisional", "ambiguous", "unmatched", "rejected"]
MERGE_ID = "a.b.1"
_EPOCH = _VERSION = 1  # a file is one observation in the one life of its map frame
_ANYWHERE_M = (0.0, 0.0)  # only tells which reverted transforms are the same place, and none was reverted


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One of the matcher's; ``measurements`` is None where the rule looks only at better ones."""

    match: Match
    measurements: Sequence[Measurement] | None
    accepted: bool


@dataclass(frozen=True, slots=True, eq=False)
class Pairing:
    """What came of matching b's map to a's. ``hypotheses`` come best first; ``merged`` is there when one was accepted.

    ``match_s`` is what the matcher took and ``elapsed_s`` everything between the two maps and the verdict.
    """

    a: ReadyMap
    b: ReadyMap
    ruling: Ruling
    verdict: Outcome
    reason: str
    hypotheses: tuple[Hypothesis, ...] = ()
    merged: Map | None = None
    match_s: float = 0.0
    elapsed_s: float = 0.0

    @property
    def accepted(self) -> Hypothesis | None:
        """The hypothesis that was accepted."""
        return next((hypothesis for hypothesis in self.hypotheses if hypothesis.accepted), None)

    @property
    def best(self) -> Hypothesis | None:
        """The accepted hypothesis, else the matcher's first."""
        return self.accepted or (self.hypotheses[0] if self.hypotheses else None)


@dataclass(slots=True)
class Pairer:
    """Matches ready maps by a decision table, and remembers for each receiver what can be used again."""

    workshop: Workshop
    table: DecisionTable
    _attempts: dict[int, tuple[ReadyMap, Attempts]] = field(default_factory=dict)

    def pair(self, a: ReadyMap, b: ReadyMap, *, fuse: bool = True) -> Pairing:
        """Match b's map to a's, which receives it; without ``fuse`` no merged map is made.

        Raises PluginError when a plugin fails, ConfigError when a rule and its tools do not fit together.
        """
        began_s = time.perf_counter()
        ruling = self.table.choose(facts_of(a.metadata, b.metadata))
        if ruling.rule is None or ruling.rejected:
            return Pairing(a, b, ruling, "rejected", ruling.reason)
        witness = Witness()
        attempt = self._attempt(witness.watch(self.workshop.tools(ruling.rule)), a, b)
        elapsed_s = time.perf_counter() - began_s
        return Pairing(
            a,
            b,
            ruling,
            attempt.verdict,
            attempt.reason,
            _hypotheses(witness, attempt),
            self._merged(a, attempt) if fuse else None,
            sum(witness.match_s),
            elapsed_s,
        )

    def _attempt(self, tools: Tools, a: ReadyMap, b: ReadyMap) -> Attempt:
        donation = Donation(b.layer, Provenance(b.name, _EPOCH, _VERSION))
        return self._attempts_of(a).make(tools, donation, None, _ANYWHERE_M)

    def _attempts_of(self, a: ReadyMap) -> Attempts:
        known = self._attempts.get(id(a))
        if known is None:
            known = self._attempts[id(a)] = (a, Attempts(self.workshop, a.map_type, a.ledger))
        return known[1]

    def _merged(self, a: ReadyMap, attempt: Attempt) -> Map | None:
        """The receiver's map with the donor's in it; its ledger is as before when this returns."""
        if attempt.grafted is None:
            return None
        with self.workshop.guard.calling("map type", a.map_type.name):
            a.ledger.merge(MERGE_ID, attempt.grafted.contribution)
            fused = a.ledger.fused()
            a.ledger.revert(MERGE_ID)
        return fused


def _hypotheses(witness: Witness, attempt: Attempt) -> tuple[Hypothesis, ...]:
    """All that the matcher found, with what was measured of them."""
    found = witness.found[0] if witness.found else ()
    candidates = witness.candidates[0] if witness.candidates else ()
    measured = {id(candidate.match): candidate.measurements for candidate in candidates}
    taken = witness.decisions[0].chosen if attempt.grafted and witness.decisions else None
    chosen = None if taken is None else candidates[taken].match
    return tuple(
        Hypothesis(match, tuple(measured[id(match)].values()) if id(match) in measured else None, match is chosen)
        for match in found
    )
