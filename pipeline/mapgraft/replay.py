"""The core loop: robots observe in time order, meet, merge what the others offer, verify, and revert."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import permutations

from mapgraft.contracts import Meeting, Observation, Policy, Situation, Transform
from mapgraft.errors import FailedPluginError, MapError, PluginError, ReversalError
from mapgraft.events import Sink
from mapgraft.exchange import Traffic
from mapgraft.guard import Guard
from mapgraft.history import History
from mapgraft.robot import Robot
from mapgraft.soundness import sound_meetings
from mapgraft.stopwatch import Stopwatch


@dataclass(slots=True)
class Exchange:
    """The meetings of one mission: asks the policy when they are due, and carries bytes between the robots."""

    policy: Policy
    robots: Mapping[str, Robot]
    T_world_map: Mapping[str, Transform] = field(default_factory=dict)
    traffic: Traffic = field(default_factory=Traffic)
    watch: Stopwatch = field(default_factory=Stopwatch)
    guard: Guard = field(default_factory=Guard)
    history: History | None = None
    policy_name: str = ""
    T_map_base: dict[str, Transform] = field(default_factory=dict)
    _start_ns: int | None = None
    _asked_ns: int = 0

    def until(self, now_ns: int, ending: bool = False) -> None:
        """Hold every meeting that is due up to now."""
        if self._start_ns is None:
            self._start_ns = self._asked_ns = now_ns
        situation = Situation(self._start_ns, self._asked_ns, now_ns, self.T_map_base, self.T_world_map, ending)
        for meeting in self._due(situation):
            with self.watch.stage("exchanging"):
                self.hold(meeting)
        self._asked_ns = now_ns

    def _due(self, situation: Situation) -> Sequence[Meeting]:
        """What the policy says; a policy that fails too often is not asked again, and nobody meets any more."""
        if ("policy", self.policy_name) in self.guard.set_aside:
            return ()
        try:
            with self.guard.calling("policy", self.policy_name):
                return sound_meetings(self.policy.due(situation), self.robots)
        except FailedPluginError as error:
            if self.history is None:
                raise
            self.guard.note(error)
            self.history.record("failed", situation.now_ns, "", "", by=f"policy {self.policy_name}", reason=str(error))
            return ()

    def hold(self, meeting: Meeting) -> None:
        """Every receiver considers every donor's offer; layers travel only where they are fetched."""
        pairs = meeting.pairs if meeting.pairs is not None else tuple(permutations(sorted(self.robots), 2))
        offers: dict[str, bytes] = {}
        for donor in dict.fromkeys(donor for _, donor in pairs if not self.robots[donor].failed):
            with self._ending(donor, meeting.stamp_ns):
                offers[donor] = self.robots[donor].offer()
        for receiver, donor in pairs:
            if donor in offers and not (self.robots[donor].failed or self.robots[receiver].failed):
                offer = self.traffic.carry(donor, receiver, offers[donor])
                with self._ending(receiver, meeting.stamp_ns):
                    self.robots[receiver].consider(
                        offer, self._fetch(donor, receiver, meeting.stamp_ns), meeting.stamp_ns
                    )

    @contextmanager
    def _ending(self, robot: str, stamp_ns: int) -> Iterator[None]:
        """What comes through is the fault of the robot's own map type: its part in the run ends, the others go on."""
        try:
            yield
        except (PluginError, MapError, ReversalError) as error:
            self.robots[robot].fail(error, stamp_ns)

    def _fetch(self, donor: str, receiver: str, stamp_ns: int) -> Callable[[], bytes]:
        fetched: list[bytes] = []

        def fetch() -> bytes:
            if not fetched:
                try:
                    layer = self.robots[donor].layer()
                except (PluginError, MapError) as error:
                    self.robots[donor].fail(error, stamp_ns)
                    raise MapError(f"{donor} cannot send its map: {error}") from error
                fetched.append(self.traffic.carry(donor, receiver, layer))
            return fetched[0]

        return fetch


def replay(observations: Iterable[Observation], robots: Mapping[str, Robot], exchange: Exchange, sink: Sink) -> int:
    """Replay one mission; returns how many observations there were.

    Exchanges fall between observations: whatever is due at a stamp happens before the observation of that stamp.
    """
    count, now_ns = 0, 0
    for observation in observations:
        now_ns = observation.stamp_ns
        exchange.until(now_ns)
        robots[observation.robot].observe(observation)
        exchange.T_map_base[observation.robot] = observation.T_map_base
        sink.observed(observation)
        count += 1
    exchange.until(now_ns, ending=True)
    for name in sorted(robots):
        robots[name].finish(now_ns)
    return count
