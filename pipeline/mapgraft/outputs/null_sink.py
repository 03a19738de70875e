"""A sink that keeps nothing, for replays whose result is wanted in memory only."""

from __future__ import annotations

from mapgraft.contracts import Observation
from mapgraft.events import Event, Snapshot


class NullSink:
    def observed(self, observation: Observation) -> None:
        pass

    def happened(self, event: Event) -> None:
        pass

    def mapped(self, snapshot: Snapshot) -> None:
        pass
