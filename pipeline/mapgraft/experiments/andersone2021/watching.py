"""What our own rules would have made of a merge that the paper's rules accepted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from mapgraft.contracts import Sample, Step, Tracker, Verdict
from mapgraft.decision import DecisionTable, facts_of
from mapgraft.evaluation.scored import better_of, measured
from mapgraft.evaluation.statistics import Better
from mapgraft.experiments.andersone2021.keeping import Graft
from mapgraft.experiments.andersone2021.outcome import Watched
from mapgraft.procedures import Tools, Workshop

State = Literal["provisional", "confirmed"]


@dataclass(slots=True)
class Watcher:
    """The installed rules, asked about merges that others have made; the receiver keeps them in the ledger.

    ``better`` grows with every metric that is seen: which way its numbers should go.
    """

    table: DecisionTable
    workshop: Workshop
    better: dict[str, Better] = field(default_factory=dict)

    def watch(self, graft: Graft) -> Watched:
        """Verify a merge while the receiver maps on, by the rule that the two maps' metadata call for."""
        own, other = (side.map_type.metadata(side.layer) for side in (graft.pair.receiver, graft.pair.donor))
        ruling = self.table.choose(facts_of(own, other))
        if ruling.rule is None or ruling.rejected:
            return Watched("", "", ruling.reason, {}, {})
        return self._watched(graft, self.workshop.tools(ruling.rule))

    def _watched(self, graft: Graft, tools: Tools) -> Watched:
        reversal = graft.merged("ledger")
        comparison = graft.comparison(reversal)
        trackers = {name: metric.track(comparison) for name, metric in tools.metrics.items()}
        history = [_sample(trackers, 0, 0, Step(), "provisional")]
        self.better |= better_of(history[0].measurements)
        state: State = "provisional"
        verdict = Verdict("keep", "nothing further was observed")
        for number, observation in enumerate(graft.pair.further, 1):
            step = Step(reversal.observe(observation), (observation,))
            sample = _sample(trackers, observation.stamp_ns, number, step, state)
            if number % tools.procedure.verify.every and number < len(graft.pair.further):
                continue
            history.append(sample)
            verdict = tools.verifier.verify(history, reversal.name)
            if verdict.action == "revert":
                break
            state = "confirmed" if verdict.action == "confirm" else state
        action = "confirm" if verdict.action == "keep" and state == "confirmed" else verdict.action
        initial, end = (measured(history[k].measurements) for k in (0, -1))
        return Watched(tools.rule.name, action, verdict.reason, initial, end | _told(verdict))


def _sample(trackers: Mapping[str, Tracker], stamp_ns: int, observations: int, step: Step, state: State) -> Sample:
    return Sample(stamp_ns, observations, {name: tracker.update(step) for name, tracker in trackers.items()}, state)


def _told(verdict: Verdict) -> dict[str, float]:
    """The numbers by which the verifier judged, as evidence of its own; its limits are none."""
    return {f"verifier.{name}": value for name, value in verdict.evidence.items() if "." not in name}
