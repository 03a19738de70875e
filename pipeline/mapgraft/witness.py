"""Looking over a matcher's and an acceptor's shoulders: what they were asked, what they said, and how long it took."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from time import perf_counter

from mapgraft.contracts import Acceptor, Candidate, Decision, Map, Match, Matcher, Prior
from mapgraft.procedures import Tools


@dataclass(slots=True)
class Witness:
    """What was seen, in the order in which it happened.

    ``found`` holds what the matcher found, each time it was asked, ``match_s`` how long that took, also where it found
    nothing to work with; ``candidates`` what the acceptor was shown, and ``decisions`` what it said. ``around_prior_s``
    is what all searches around a prior have taken together: where nobody knows a pose beforehand, those are the ones
    that register a standing merge anew.
    """

    found: list[Sequence[Match]] = field(default_factory=list)
    match_s: list[float] = field(default_factory=list)
    around_prior_s: float = 0.0
    candidates: list[Sequence[Candidate]] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)

    def watch(self, tools: Tools) -> Tools:
        """The same tools, watched: for ``Workshop.watch``."""
        return dataclasses.replace(
            tools, matcher=_WatchedMatcher(tools.matcher, self), acceptor=_WatchedAcceptor(tools.acceptor, self)
        )


@dataclass(frozen=True, slots=True)
class _WatchedMatcher:
    matcher: Matcher
    witness: Witness

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        began_s = perf_counter()
        try:
            found = self.matcher.match(target, source, prior)
        finally:
            elapsed_s = perf_counter() - began_s
            self.witness.match_s.append(elapsed_s)
            if prior is not None:
                self.witness.around_prior_s += elapsed_s
        self.witness.found.append(found)
        return found


@dataclass(frozen=True, slots=True)
class _WatchedAcceptor:
    acceptor: Acceptor
    witness: Witness

    def accept(self, candidates: Sequence[Candidate]) -> Decision:
        self.witness.candidates.append(candidates)
        decision = self.acceptor.accept(candidates)
        self.witness.decisions.append(decision)
        return decision
