"""When robots exchange their maps."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mapgraft.contracts import ConfigError, Meeting, Situation

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


def _last(situation: Situation, due: Sequence[Meeting], wanted: bool) -> list[Meeting]:
    """The meeting at the end, unless one falls on that very stamp anyway."""
    if not (situation.ending and wanted) or any(meeting.stamp_ns == situation.now_ns for meeting in due):
        return []
    return [Meeting(situation.now_ns)]
