"""One merge: the edge receiver←donor from the moment the donor's data is in until it is taken out."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import reduce
from typing import Literal

from mapgraft.comparison import Compared
from mapgraft.contracts import (
    Match,
    Measurement,
    Observation,
    Provenance,
    Region,
    Sample,
    Step,
    Tracker,
    Verdict,
)
from mapgraft.procedures import Tools, blaming

State = Literal["provisional", "confirmed", "reverted"]


@dataclass(slots=True)
class _Watch:
    """One metric of one merge: its tracker, and what has happened since it was last asked."""

    tracker: Tracker
    every: int
    touched: list[Region] = field(default_factory=list)
    observations: list[Observation] = field(default_factory=list)
    everything: bool = True
    donor_changed: bool = False

    def measure(self, converted: bool) -> Measurement:
        """Ask the tracker; where maps are ``converted`` to meet, the receiver's regions say nothing there."""
        unknown = converted or self.everything or not self.touched
        region = None if unknown else reduce(lambda a, b: a.union(b), self.touched)
        step = Step(region, tuple(self.observations), self.donor_changed)
        self.touched, self.observations, self.everything, self.donor_changed = [], [], False, False
        return self.tracker.update(step)


@dataclass(slots=True)
class Merge:
    """A standing merge with its metrics. ``merge_id`` is ``<receiver>.<donor>.<n>``."""

    merge_id: str
    tools: Tools
    match: Match
    provenance: Provenance
    comparison: Compared
    reversal: str
    state: State = "provisional"
    history: list[Sample] = field(default_factory=list)  # the samples that hold all the verifier looks at
    observations: int = 0
    decided_by_person: bool = False
    _watches: dict[str, _Watch] = field(default_factory=dict)

    @property
    def donor(self) -> str:
        return self.provenance.source

    def start(self, stamp_ns: int) -> Sample:
        """Begin to track every metric of the procedure; the first sample is of the moment of the merge."""
        verify = self.tools.procedure.verify
        judged = verify.metric_names
        logged = tuple(name for name in (verify.log.metrics if verify.log else ()) if name not in judged)
        rhythms = dict.fromkeys(judged, verify.every) | dict.fromkeys(logged, verify.log.every if verify.log else 1)
        with blaming(self.tools):
            trackers = {name: self.tools.metrics[name].track(self.comparison) for name in rhythms}
        self._watches = {name: _Watch(tracker, rhythms[name]) for name, tracker in trackers.items()}
        return self.measure(stamp_ns, everything=True)

    def observed(self, observation: Observation, touched: Region) -> bool:
        """Note that the receiver has observed; True when it is time to measure."""
        self.observations += 1
        for watch in self._watches.values():
            watch.observations.append(observation)
            watch.touched.append(touched)
        return any(self.observations % watch.every == 0 for watch in self._watches.values())

    def replace(self, provenance: Provenance, comparison: Compared) -> None:
        """The donor's layer or the transform is another one now: the metrics must look at everything again.

        The history goes on: what the donor has newly mapped tests the transform as much as what the receiver has.
        """
        self.provenance = provenance
        self.comparison.put_donor(comparison.donor_layer, comparison.T_receiver_donor, comparison.match)
        for watch in self._watches.values():
            watch.everything = watch.donor_changed = True

    def target_changed(self) -> None:
        """The receiver's map has changed otherwise than by an observation."""
        for watch in self._watches.values():
            watch.everything = True

    def measure(self, stamp_ns: int, everything: bool = False) -> Sample:
        """Measure what is due, or ``everything``.

        The history has one sample per number of observations, the latest: looking twice is not seeing twice.
        """
        due = {n: w for n, w in self._watches.items() if everything or self.observations % w.every == 0}
        converted = self.comparison.converted
        with blaming(self.tools):
            measured = {name: watch.measure(converted) for name, watch in due.items()}
        sample = Sample(stamp_ns, self.observations, measured)
        if all(name in due for name in self.tools.procedure.verify.metric_names):
            if len(self.history) > 1 and self.history[-1].observations == self.observations:
                self.history.pop()
            self.history.append(sample)
        return sample

    def judge(self) -> Verdict:
        """The verifier's word on the history so far."""
        with blaming(self.tools):
            return self.tools.verifier.verify(self.history, self.reversal)

    @property
    def news(self) -> bool:
        """Whether anything has happened since the metrics were last asked."""
        return any(watch.everything or watch.touched for watch in self._watches.values())
