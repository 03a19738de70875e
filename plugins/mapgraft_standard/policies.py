"""When robots exchange their maps."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from itertools import permutations

from mapgraft.contracts import ConfigError, Meeting, Signal, Situation, Transform

NS_PER_S = 1_000_000_000
MOST_AT_ONCE = 100
"""Meetings between two observations; in a hole of years nobody has anything new to say but at the first of them."""


class Every:
    """Everybody meets every ``seconds`` of data time, and once more at the end, when the maps are complete.

    Where nobody observes anything for more than a hundred such periods, only at the first and the last of them.
    """

    def __init__(self, *, seconds: float = 30.0, at_end: bool = True) -> None:
        if not (math.isfinite(seconds) and seconds > 0):
            raise ConfigError(f"the exchange policy 'every' needs seconds above 0, found {seconds}")
        self._period_ns = max(1, round(seconds * NS_PER_S))
        self._at_end = at_end

    def due(self, situation: Situation) -> Sequence[Meeting]:
        since = situation.previous_ns - situation.start_ns
        until = situation.now_ns - situation.start_ns
        first, last = since // self._period_ns + 1, until // self._period_ns
        numbers: Sequence[int] = range(first, last + 1)
        if len(numbers) > MOST_AT_ONCE:
            numbers = (first, last)
        meetings = [Meeting(situation.start_ns + n * self._period_ns) for n in numbers]
        return meetings + _last(situation, meetings, self._at_end)


class At:
    """Everybody meets at the given ``seconds`` after the mission's first stamp, and at the end if wanted."""

    def __init__(self, *, seconds: Sequence[float] = (), at_end: bool = False) -> None:
        if not all(isinstance(s, int | float) and math.isfinite(s) and s >= 0 for s in seconds):
            raise ConfigError(f"the exchange policy 'at' needs a list of seconds from 0 on, found {seconds}")
        if not seconds and not at_end:
            raise ConfigError("the exchange policy 'at' needs seconds, a list; without any nobody ever meets")
        self._offsets_ns = sorted(round(s * NS_PER_S) for s in seconds)
        self._at_end = at_end

    def due(self, situation: Situation) -> Sequence[Meeting]:
        stamps = [situation.start_ns + offset for offset in self._offsets_ns]
        meetings = [Meeting(ns) for ns in stamps if situation.previous_ns < ns <= situation.now_ns]
        return meetings + _last(situation, meetings, self._at_end)


class Range:
    """Robots meet when they come within ``radius_m`` of each other, every ``seconds`` as long as they are, and at the
    end if they still are.

    ``positions`` says where robots are taken to be: as the recording places them in one world (``recorded``), or as
    their standing merges do (``estimated``), and as recorded where no merges lead from one to the other. Two robots of
    which neither tells are ``apart`` or ``together``, as ``unplaced`` says. Looked at each ``check_s`` of data time.
    """

    def __init__(
        self,
        *,
        radius_m: float = 10.0,
        seconds: float = 30.0,
        positions: str = "recorded",
        unplaced: str = "apart",
        check_s: float = 1.0,
    ) -> None:
        for name, value in (("radius_m", radius_m), ("seconds", seconds), ("check_s", check_s)):
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"the exchange policy 'range' needs {name} above 0, found {value}")
        if positions not in ("recorded", "estimated") or unplaced not in ("apart", "together"):
            raise ConfigError(
                "the exchange policy 'range' needs positions: recorded or estimated, and unplaced: apart or together, "
                f"found {positions!r} and {unplaced!r}"
            )
        self._radius_m, self._estimated, self._together = radius_m, positions == "estimated", unplaced == "together"
        self._period_ns, self._check_ns = round(seconds * NS_PER_S), max(1, round(check_s * NS_PER_S))
        self._met_ns: dict[tuple[str, str], int] = {}  # two robots in range → when they met last

    def due(self, situation: Situation) -> Sequence[Meeting]:
        since, now = situation.previous_ns - situation.start_ns, situation.now_ns - situation.start_ns
        checked = now // self._check_ns * self._check_ns
        if checked <= since and not situation.ending:
            return []
        stamp_ns = situation.now_ns if situation.ending else situation.start_ns + checked
        near = self._near(situation)
        self._met_ns = {pair: at_ns for pair, at_ns in self._met_ns.items() if pair in near}
        due = [
            pair
            for pair in near
            if situation.ending or stamp_ns - self._met_ns.get(pair, -(1 << 62)) >= self._period_ns
        ]
        self._met_ns |= dict.fromkeys(due, stamp_ns)
        pairs = tuple(pair for one, other in due for pair in ((one, other), (other, one)))
        return [Meeting(stamp_ns, pairs)] if pairs else []

    def _near(self, situation: Situation) -> list[tuple[str, str]]:
        """Which robots are in range of each other, each pair once, by name."""
        names = sorted(situation.T_map_base)
        merged = _neighbours(situation.T_receiver_donor) if self._estimated else {}
        near = []
        for one in names:
            frames = _frames_from(one, merged)
            for other in names:
                if other <= one:
                    continue
                T = frames.get(other) or _recorded(situation, one, other)
                if T is None:
                    inside = self._together
                else:
                    apart = (T @ situation.T_map_base[other]).matrix[:3, 3] - situation.T_map_base[one].matrix[:3, 3]
                    inside = math.hypot(*apart[:2]) <= self._radius_m
                if inside:
                    near.append((one, other))
        return near


class Topic:
    """Robots meet whenever there is a message on a ``topic`` of the recording, and at the end if wanted.

    A message with a text (``std_msgs/String``) names those who meet, with blanks or commas between; others who are
    named in it are left out. Any other message lets everybody meet.
    """

    def __init__(self, *, topic: str = "", at_end: bool = False) -> None:
        if not isinstance(topic, str) or not topic:
            raise ConfigError("the exchange policy 'topic' needs topic, the name of one in the recording")
        self._topic, self._at_end = topic, at_end
        self._heard: list[Signal] = []
        self._next = 0

    @property
    def topics(self) -> Sequence[str]:
        return (self._topic,)

    def hear(self, signals: Sequence[Signal]) -> None:
        """Take what is on the topic, once, before anything is due."""
        if not signals:
            raise ConfigError(
                f"the exchange policy 'topic' found no message on {self._topic!r}: nobody would ever meet"
            )
        self._heard, self._next = sorted(signals, key=lambda signal: signal.stamp_ns), 0

    def due(self, situation: Situation) -> Sequence[Meeting]:
        meetings = []
        while self._next < len(self._heard) and self._heard[self._next].stamp_ns <= situation.now_ns:
            signal = self._heard[self._next]
            self._next += 1
            if signal.stamp_ns > situation.previous_ns or situation.previous_ns == situation.start_ns:
                meetings.append(Meeting(max(signal.stamp_ns, situation.start_ns), _named(signal.text, situation)))
        return meetings + _last(situation, meetings, self._at_end)


def _named(text: str, situation: Situation) -> tuple[tuple[str, str], ...] | None:
    """Everybody with everybody among those who are named; None where nobody is."""
    named = sorted(set(text.replace(",", " ").split()))
    if not named:
        return None
    known = [name for name in named if name in situation.T_map_base]
    return tuple(permutations(known, 2))


def _recorded(situation: Situation, one: str, other: str) -> Transform | None:
    """Where the recording says that another robot's map lies in the one's."""
    world = situation.T_world_map
    return world[one].inverse() @ world[other] if one in world and other in world else None


def _neighbours(merged: Mapping[tuple[str, str], Transform]) -> dict[str, dict[str, Transform]]:
    """Robot → by merge in either direction, how the next one's map lies in its own."""
    out: dict[str, dict[str, Transform]] = {}
    for receiver, donor in sorted(merged):
        T = merged[receiver, donor]
        out.setdefault(receiver, {})[donor] = T
        out.setdefault(donor, {}).setdefault(receiver, T.inverse())
    return out


def _frames_from(robot: str, merged: Mapping[str, Mapping[str, Transform]]) -> dict[str, Transform]:
    """How the maps of all that merges lead to lie in a robot's own, by as few merges as possible."""
    found = {robot: Transform.identity()}
    waiting = deque([robot])
    while waiting:
        here = waiting.popleft()
        for there, T in sorted(merged.get(here, {}).items(), key=lambda item: item[0]):
            if there not in found:
                found[there] = found[here] @ T
                waiting.append(there)
    return found


def _last(situation: Situation, due: Sequence[Meeting], wanted: bool) -> list[Meeting]:
    """The meeting at the end, unless one falls on that very stamp anyway."""
    if not (situation.ending and wanted) or any(meeting.stamp_ns == situation.now_ns for meeting in due):
        return []
    return [Meeting(situation.now_ns)]
