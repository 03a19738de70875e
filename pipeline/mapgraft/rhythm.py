"""When a standing merge is looked at: every so many observations, and ever more rarely where each look costs a map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

SPARING: Final = 20  # a look that converts the whole map may wait for a twentieth of all observations so far


@dataclass(frozen=True, slots=True)
class Rhythm:
    """Every ``every`` observations of the receiver.

    A ``sparing`` rhythm is for comparisons whose maps must be converted: each look then costs as much as the whole map.
    It looks every ``every``, twice, four times, … as many observations, at most a twentieth of those made so far, so
    that the looks of a mission cost as many conversions each time that it doubles. All rhythms of one robot with the
    same ``every`` fall on the same observations, whenever they began, so that one conversion does for all of them.
    """

    every: int
    sparing: bool = False

    def is_due(self, now: int) -> bool:
        """Whether a look falls on the ``now``-th observation."""
        return now % self._period(now) == 0

    def next_after(self, now: int) -> int:
        """The first observation after ``now`` on which a look falls."""
        period = self._period(now)
        return (now // period + 1) * period

    def _period(self, now: int) -> int:
        period = self.every
        while self.sparing and 2 * period * SPARING <= now:
            period *= 2
        return period
