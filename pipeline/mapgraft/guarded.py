"""The plugins of a rule as the engine calls them: each by its name, in its time, and what it gives is looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mapgraft.contracts import (
    Acceptor,
    Candidate,
    Comparison,
    Contribution,
    Conversion,
    Decision,
    Donation,
    Fuser,
    Layer,
    LocalTracker,
    Map,
    MapType,
    Match,
    Matcher,
    Measurement,
    Metric,
    Prior,
    Region,
    Sample,
    Step,
    Tracker,
    Verdict,
    Verifier,
)
from mapgraft.errors import PluginError
from mapgraft.guard import Guard
from mapgraft.sound_maps import sound_layer, sound_region
from mapgraft.soundness import (
    sound_contribution,
    sound_decision,
    sound_matches,
    sound_measurement,
    sound_verdict,
)


@dataclass(frozen=True, slots=True)
class GuardedMatcher:
    name: str
    matcher: Matcher
    guard: Guard

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        with self.guard.calling("matcher", self.name):
            return sound_matches(self.matcher.match(target, source, prior))


@dataclass(frozen=True, slots=True)
class GuardedAcceptor:
    name: str
    acceptor: Acceptor
    guard: Guard

    def accept(self, candidates: Sequence[Candidate]) -> Decision:
        with self.guard.calling("acceptor", self.name):
            return sound_decision(self.acceptor.accept(candidates), candidates)


@dataclass(frozen=True, slots=True)
class GuardedFuser:
    name: str
    fuser: Fuser
    guard: Guard

    def fuse(self, map_type: MapType, target: Map, source: Donation, match: Match) -> Contribution:
        with self.guard.calling("fuser", self.name):
            return sound_contribution(self.fuser.fuse(map_type, target, source, match), map_type, source)


@dataclass(frozen=True, slots=True)
class GuardedVerifier:
    name: str
    verifier: Verifier
    guard: Guard

    def verify(self, history: Sequence[Sample], reversal: str) -> Verdict:
        with self.guard.calling("verifier", self.name):
            return sound_verdict(self.verifier.verify(history, reversal))


@dataclass(frozen=True, slots=True)
class GuardedConversion:
    name: str
    conversion: Conversion
    guard: Guard

    def convert(self, layer: Layer, source: MapType, target: MapType) -> Layer:
        if (refused := self.guard.refused("conversion", self.name)) is not None:  # merges that stand go on without it
            raise refused
        with self.guard.calling("conversion", self.name):
            return sound_layer(self.conversion.convert(layer, source, target), target.name)


@dataclass(frozen=True, slots=True)
class GuardedMetric:
    name: str
    metric: Metric
    guard: Guard

    def track(self, comparison: Comparison) -> Tracker:
        with self.guard.calling("metric", self.name):
            tracker = self.metric.track(comparison)
            if not callable(getattr(tracker, "update", None)):
                raise PluginError(f"gave a {type(tracker).__name__} where a tracker was wanted")
        if isinstance(tracker, LocalTracker):
            return GuardedLocalTracker(self.name, tracker, self.guard)
        return GuardedTracker(self.name, tracker, self.guard)


@dataclass(frozen=True, slots=True)
class GuardedTracker:
    name: str
    tracker: Tracker
    guard: Guard

    def update(self, step: Step) -> Measurement:
        with self.guard.calling("metric", self.name):
            return sound_measurement(self.tracker.update(step))


@dataclass(frozen=True, slots=True)
class GuardedLocalTracker:
    name: str
    tracker: LocalTracker
    guard: Guard

    def update(self, step: Step) -> Measurement:
        with self.guard.calling("metric", self.name):
            return sound_measurement(self.tracker.update(step))

    @property
    def concerns(self) -> Region | None:
        with self.guard.calling("metric", self.name):
            concerns = self.tracker.concerns
            return None if concerns is None else sound_region(concerns)
