"""A sink that keeps events and snapshots in memory, to look at them when a run is over."""

from __future__ import annotations

from mapgraft.contracts import Observation
from mapgraft.events import Event, Snapshot


class MemorySink:
    """``events`` and ``snapshots``, each in the order in which they came."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.snapshots: list[Snapshot] = []

    def observed(self, observation: Observation) -> None:
        pass

    def happened(self, event: Event) -> None:
        self.events.append(event)

    def mapped(self, snapshot: Snapshot) -> None:
        self.snapshots.append(snapshot)

    def snapshot(self, robot: str, why: str, merge_id: str) -> Snapshot:
        """The first snapshot of a robot for that reason at that merge; raises StopIteration where there is none."""
        return next(s for s in self.snapshots if (s.robot, s.why, s.merge_id) == (robot, why, merge_id))
