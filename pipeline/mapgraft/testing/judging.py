"""The laws of acceptors, verifiers and policies: they judge numbers, and need no map."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import ClassVar, Final, Literal

from hypothesis import strategies as st

from mapgraft.contracts import (
    Acceptor,
    Candidate,
    Decision,
    Match,
    Measurement,
    Measurements,
    Policy,
    Sample,
    Situation,
    Transform,
    Verdict,
    Verifier,
)
from mapgraft.testing.content import content_of
from mapgraft.testing.laws import Drawing, Laws, law, require

REVERSALS: Final = ("ledger", "multi_map", "single_map")
_SECOND_NS: Final = 1_000_000_000
_VALUE = st.floats(0.0, 1.0) | st.just(math.nan)
Better = Literal["higher", "lower"]
State = Literal["provisional", "confirmed"]


class _Measured(Laws):
    """``measured`` names the metrics that are judged, with their details; all values lie in [0, 1] or are NaN."""

    measured: ClassVar[Mapping[str, Sequence[str]]] = {}
    better: ClassVar[Better] = "lower"

    def measurements(self) -> st.SearchStrategy[Measurements]:
        """What is measured of one merge at one time."""
        return st.fixed_dictionaries(
            {name: self._measurement(name, details) for name, details in self.measured.items()}
        )

    def unmeasurable(self) -> Measurements:
        """What it looks like when there is too little to measure."""
        return {
            name: Measurement(name, math.nan, "1", 0, self.better, dict.fromkeys(details, math.nan))
            for name, details in self.measured.items()
        }

    def _measurement(self, name: str, details: Sequence[str]) -> st.SearchStrategy[Measurement]:
        return st.builds(
            lambda value, support, numbers: Measurement(
                name,
                value,
                "1",
                0 if math.isnan(value) else support,
                self.better,
                dict(zip(details, numbers, strict=True)),
            ),
            _VALUE,
            st.integers(1, 500),
            st.tuples(*[st.floats(0.0, 20.0)] * len(details)),
        )


class AcceptorLaws(_Measured):
    """What an acceptor promises; ``make_acceptor`` must be written. ``evidence`` names matchers' numbers it wants."""

    evidence: ClassVar[Sequence[str]] = ()

    def make_acceptor(self) -> Acceptor:
        """A new acceptor with the parameters to try."""
        raise NotImplementedError(f"{type(self).__name__} needs make_acceptor()")

    def candidates(self) -> st.SearchStrategy[list[Candidate]]:
        """Candidates, best first."""
        told = st.fixed_dictionaries({name: st.floats(0.0, 100.0) for name in self.evidence})
        return st.lists(st.tuples(st.floats(0.0, 100.0), self.measurements(), told), max_size=4).map(_ranked)

    @law("without a candidate the verdict is unmatched")
    def test_nothing_is_unmatched(self, drawing: Drawing) -> None:
        said = self.make_acceptor().accept([])
        require(said.verdict == "unmatched" and said.chosen is None, f"it says {said.verdict}, chosen {said.chosen}")
        require(_is_sentence(said.reason), f"its reason is {said.reason!r}")

    @law("a decision names one candidate if it is provisional and none otherwise, and says why")
    def test_decisions_are_well_formed(self, drawing: Drawing) -> None:
        candidates = drawing.draw(self.candidates())
        said = self.make_acceptor().accept(candidates)
        require(isinstance(said, Decision), f"it gives a {type(said).__name__}")
        require(said.verdict in ("provisional", "ambiguous", "unmatched"), f"its verdict is {said.verdict!r}")
        if said.verdict == "provisional":
            there = said.chosen is not None and 0 <= said.chosen < len(candidates)
            require(there, f"of {len(candidates)} candidates it chose {said.chosen}")
        else:
            require(said.chosen is None, f"it says {said.verdict} and chose candidate {said.chosen}")
        require(_is_sentence(said.reason), f"its reason is {said.reason!r}")

    @law("accepting writes nothing, and equal candidates give equal decisions")
    def test_accepting_is_pure(self, drawing: Drawing) -> None:
        candidates, others = drawing.draw(self.candidates()), drawing.draw(self.candidates())
        before = content_of(candidates)
        acceptor = self.make_acceptor()
        first = acceptor.accept(candidates)
        acceptor.accept(others)
        require(acceptor.accept(candidates) == first, "asked again, it decides otherwise")
        require(self.make_acceptor().accept(candidates) == first, "another instance decides otherwise")
        require(content_of(candidates) == before, "the candidates were written")


class VerifierLaws(_Measured):
    """What a verifier promises; ``make_verifier`` must be written."""

    def make_verifier(self) -> Verifier:
        """A new verifier with the parameters to try."""
        raise NotImplementedError(f"{type(self).__name__} needs make_verifier()")

    def histories(self) -> st.SearchStrategy[list[Sample]]:
        """What was measured of one merge, oldest first."""
        states: st.SearchStrategy[State] = st.sampled_from(("provisional", "confirmed"))
        return st.tuples(st.lists(self.measurements(), min_size=1, max_size=12), states).map(_history)

    @law("a verdict is keep, confirm or revert, and says why, whatever the reversal")
    def test_verdicts_are_well_formed(self, drawing: Drawing) -> None:
        history, verifier = drawing.draw(self.histories()), self.make_verifier()
        for reversal in REVERSALS:
            said = verifier.verify(history, reversal)
            require(isinstance(said, Verdict), f"it gives a {type(said).__name__}")
            require(said.action in ("keep", "confirm", "revert"), f"with {reversal} it says {said.action!r}")
            require(_is_sentence(said.reason), f"its reason is {said.reason!r}")

    @law("verifying writes nothing, and equal histories give equal verdicts: nothing is remembered between merges")
    def test_verifying_is_pure(self, drawing: Drawing) -> None:
        history, other = drawing.draw(self.histories()), drawing.draw(self.histories())
        reversal, verifier = drawing.draw(st.sampled_from(REVERSALS)), self.make_verifier()
        before = content_of(history)
        first = verifier.verify(history, reversal)
        verifier.verify(other, reversal)
        require(verifier.verify(history, reversal) == first, "asked again, it says something else")
        require(self.make_verifier().verify(history, reversal) == first, "another instance says something else")
        require(content_of(history) == before, "the history was written")

    @law("the sample taken at the merge itself confirms nothing: the transform was chosen on it")
    def test_the_merge_itself_confirms_nothing(self, drawing: Drawing) -> None:
        history, reversal = _history(([drawing.draw(self.measurements())], "provisional")), drawing.draw(_REVERSAL)
        said = self.make_verifier().verify(history, reversal)
        require(said.action != "confirm", f"it confirms at once: {said.reason}")

    @law("what could never be measured neither confirms nor reverts")
    def test_what_cannot_be_measured_tells_nothing(self, drawing: Drawing) -> None:
        samples = [self.unmeasurable()] * drawing.draw(st.integers(1, 100), "samples:")
        said = self.make_verifier().verify(_history((samples, "provisional")), drawing.draw(_REVERSAL))
        require(said.action == "keep", f"it says {said.action}: {said.reason}")


class PolicyLaws(Laws):
    """What a policy promises that looks at the time; ``make_policy`` must be written."""

    def make_policy(self) -> Policy:
        """A new policy with the parameters to try."""
        raise NotImplementedError(f"{type(self).__name__} needs make_policy()")

    @law("meetings fall into the time that was asked for, in order, and no other time is met twice or missed")
    def test_meetings_fall_into_their_time(self, drawing: Drawing) -> None:
        ends = sorted(drawing.draw(st.lists(st.integers(0, 900), min_size=2, max_size=6, unique=True), "asked at (s)"))
        policy, stamps = self.make_policy(), []
        for previous, now in pairwise(ends):
            met = policy.due(Situation(ends[0] * _SECOND_NS, previous * _SECOND_NS, now * _SECOND_NS))
            here = [meeting.stamp_ns for meeting in met]
            inside = all(previous * _SECOND_NS < ns <= now * _SECOND_NS for ns in here)
            require(inside and here == sorted(here), f"asked for ({previous}, {now}] s it meets at {here} ns")
            stamps += here
        whole = self.make_policy().due(Situation(ends[0] * _SECOND_NS, ends[0] * _SECOND_NS, ends[-1] * _SECOND_NS))
        at_once = [meeting.stamp_ns for meeting in whole]
        require(at_once == stamps, f"asked piece by piece it meets at {stamps} ns, asked at once at {at_once} ns")


_REVERSAL = st.sampled_from(REVERSALS)


def _ranked(given: list[tuple[float, Measurements, dict[str, float]]]) -> list[Candidate]:
    ranked = sorted(given, key=lambda pair: -pair[0])
    scores = [score for score, *_ in ranked]
    made = []
    for n, (score, measurements, evidence) in enumerate(ranked):
        rivals = scores[:n] + scores[n + 1 :]
        margin = score - max(rivals) if rivals else math.inf
        T = Transform.planar(float(n), -1.0, 0.3 * n)
        made.append(Candidate(Match(T, score, margin, evidence=evidence), measurements))
    return made


def _history(given: tuple[Sequence[Measurements], State]) -> list[Sample]:
    samples, state = given
    return [Sample(n * _SECOND_NS, 10 * n, measured, state) for n, measured in enumerate(samples)]


def _is_sentence(text: str) -> bool:
    return bool(text.strip()) and "\n" not in text
