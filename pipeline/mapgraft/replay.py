"""The core loop: robots observe in time order, meet, merge what the others offer, verify, and revert."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, permutations

from mapgraft.contracts import MapError, Meeting, Observation, Policy, Situation, Transform
from mapgraft.correction import Correction
from mapgraft.errors import FailedPluginError, PluginError, ReversalError
from mapgraft.events import Sink
from mapgraft.guard import Guard
from mapgraft.history import History
from mapgraft.network.medium import Medium
from mapgraft.network.radio import NS_PER_S, Conditions, Radio, Traffic
from mapgraft.network.robots import node_of
from mapgraft.rendezvous import Sighted
from mapgraft.robot import Robot
from mapgraft.soundness import sound_meetings
from mapgraft.stopwatch import Stopwatch

Entry = Observation | Correction | Sighted


@dataclass(frozen=True, slots=True)
class Network:
    """How robots reach each other: what the radio does to messages, how long a contact lasts that a policy begins, how
    long a robot waits for an answer, and whether it looks at previews first."""

    conditions: Conditions = field(default_factory=Conditions)
    window_ns: int = 10 * NS_PER_S
    patience_ns: int = NS_PER_S
    previews: bool = False


@dataclass(slots=True)
class Exchange:
    """The meetings of one mission: asks the policy when they are due, and lets the robots meet on the radio.

    ``follows`` names, by robots that are a later life of another, the life before: they take no part before they begin,
    and from then on the other one takes none any more.
    """

    policy: Policy
    robots: Mapping[str, Robot]
    T_world_map: Mapping[str, Transform] = field(default_factory=dict)
    network: Network = field(default_factory=Network)
    watch: Stopwatch = field(default_factory=Stopwatch)
    guard: Guard = field(default_factory=Guard)
    history: History | None = None
    policy_name: str = ""
    follows: Mapping[str, str] = field(default_factory=dict)
    T_map_base: dict[str, Transform] = field(default_factory=dict)
    medium: Medium = field(init=False)
    _start_ns: int | None = None
    _asked_ns: int = 0
    _begun: set[str] = field(default_factory=set)  # of those that follow others

    def __post_init__(self) -> None:
        how = self.network
        nodes = {name: node_of(robot, how.patience_ns, how.previews) for name, robot in sorted(self.robots.items())}
        radio = Radio(how.conditions)
        self.medium = Medium(nodes, self._is_out, self._failed, radio, how.window_ns)

    @property
    def traffic(self) -> Traffic:
        """The bytes that were sent."""
        return self.medium.traffic

    def until(self, now_ns: int, ending: bool = False) -> int:
        """Hold every meeting that is due up to now, and deliver what is due.

        At the end the radio goes on as long as a contact that begins now would last. Returns when it all ended.
        """
        if self._start_ns is None:
            self._start_ns = self._asked_ns = now_ns
            self.medium.radio.begin(now_ns)
        placed = Placements(self.robots)
        situation = Situation(self._start_ns, self._asked_ns, now_ns, self.T_map_base, self.T_world_map, ending, placed)
        for meeting in self._due(situation):
            with self.watch.stage("exchanging"):
                self.medium.until(meeting.stamp_ns)
                self.hold(meeting)
        self._asked_ns = now_ns
        until_ns = now_ns + self.network.window_ns if ending else now_ns
        while (at_ns := self.medium.next_ns()) is not None and at_ns <= until_ns:
            now_ns = max(now_ns, at_ns)
            with self.watch.stage("exchanging", 0):
                self.medium.until(at_ns)
        return now_ns

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
        """Let robots meet; on a perfect radio everything that follows from it follows at once."""
        everybody = tuple(permutations(sorted(self.robots), 2))
        self.medium.hold(everybody if meeting.pairs is None else meeting.pairs, meeting.stamp_ns)

    def began(self, robot: str, stamp_ns: int) -> None:
        """A robot is about to observe: if that begins another life of it, the one before ends."""
        before = self.follows.get(robot)
        if before is None or robot in self._begun:
            return
        self._begun.add(robot)
        self.T_map_base.pop(before, None)
        if not self.robots[before].retired:
            self.robots[before].retire(self.robots[robot].graph.me, stamp_ns)

    def _is_out(self, robot: str) -> bool:
        one = self.robots[robot]
        return bool(one.failed) or one.retired or (robot in self.follows and robot not in self._begun)

    def _failed(self, robot: str, error: PluginError | MapError | ReversalError, stamp_ns: int) -> None:
        self.robots[robot].fail(error, stamp_ns)


class Placements(Mapping[tuple[str, str], Transform]):
    """Where robots have merged others, (receiver, donor) → transform, as of now; looked up when somebody asks."""

    def __init__(self, robots: Mapping[str, Robot]) -> None:
        self._robots = robots

    def __getitem__(self, pair: tuple[str, str]) -> Transform:
        receiver, donor = pair
        return self._robots[receiver].merges[donor].comparison.T_receiver_donor

    def __iter__(self) -> Iterator[tuple[str, str]]:
        return iter([(name, donor) for name, robot in sorted(self._robots.items()) for donor in sorted(robot.merges)])

    def __len__(self) -> int:
        return sum(len(robot.merges) for robot in self._robots.values())


def begun(timeline: Iterable[Entry]) -> Iterator[Entry] | None:
    """The same entries, those up to the first observation read already; None where there is no observation."""
    entries, before = iter(timeline), list[Entry]()
    for entry in entries:
        before.append(entry)
        if isinstance(entry, Observation):
            return chain(before, entries)
    return None


def replay(timeline: Iterable[Entry], robots: Mapping[str, Robot], exchange: Exchange, sink: Sink) -> int:
    """Replay one mission; returns how many observations there were.

    Exchanges fall between observations: whatever is due at a stamp happens before the observation of that stamp.
    """
    count, now_ns = 0, 0
    for observation in timeline:
        now_ns = observation.stamp_ns
        exchange.until(now_ns)
        if isinstance(observation, Sighted):
            if (book := robots[observation.robot].rendezvous) is not None:
                book.sighted(observation.other, observation.seen_ns, observation.seen)
            continue
        if isinstance(observation, Correction):
            robots[observation.robot].correct(observation)
            if (T_map_base := robots[observation.robot].T_map_base) is not None:
                exchange.T_map_base[observation.robot] = T_map_base
            continue
        exchange.began(observation.robot, now_ns)
        robots[observation.robot].observe(observation)
        exchange.T_map_base[observation.robot] = observation.T_map_base
        sink.observed(observation)
        count += 1
    now_ns = exchange.until(now_ns, ending=True)
    for name in sorted(robots):
        if not robots[name].retired:
            robots[name].finish(now_ns)
    return count
