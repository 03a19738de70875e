"""The core loop: robots observe in time order, meet, merge what the others offer, verify, and revert."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import permutations

from mapgraft.contracts import Meeting, Observation, Policy, Situation, Transform
from mapgraft.events import Sink
from mapgraft.exchange import Traffic
from mapgraft.robot import Robot
from mapgraft.stopwatch import Stopwatch


@dataclass(slots=True)
class Exchange:
    """The meetings of one mission: asks the policy when they are due, and carries bytes between the robots."""

    policy: Policy
    robots: Mapping[str, Robot]
    T_world_map: Mapping[str, Transform] = field(default_factory=dict)
    traffic: Traffic = field(default_factory=Traffic)
    watch: Stopwatch = field(default_factory=Stopwatch)
    T_map_base: dict[str, Transform] = field(default_factory=dict)
    _start_ns: int | None = None
    _asked_ns: int = 0

    def until(self, now_ns: int, ending: bool = False) -> None:
        """Hold every meeting that is due up to now."""
        if self._start_ns is None:
            self._start_ns = self._asked_ns = now_ns
        situation = Situation(self._start_ns, self._asked_ns, now_ns, self.T_map_base, self.T_world_map, ending)
        for meeting in self.policy.due(situation):
            with self.watch.stage("exchanging"):
                self.hold(meeting)
        self._asked_ns = now_ns

    def hold(self, meeting: Meeting) -> None:
        """Every receiver considers every donor's offer; layers travel only where they are fetched."""
        pairs = meeting.pairs if meeting.pairs is not None else tuple(permutations(sorted(self.robots), 2))
        offers = {donor: self.robots[donor].offer() for donor in dict.fromkeys(donor for _, donor in pairs)}
        for receiver, donor in pairs:
            offer = self.traffic.carry(donor, receiver, offers[donor])
            self.robots[receiver].consider(offer, self._fetch(donor, receiver), meeting.stamp_ns)

    def _fetch(self, donor: str, receiver: str) -> Callable[[], bytes]:
        return lambda: self.traffic.carry(donor, receiver, self.robots[donor].layer())


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
