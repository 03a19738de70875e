"""A policy by which only neighbours meet: the robots of a list, each with the one before and the one behind it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from mapgraft.contracts import Descriptor, Meeting, Situation, hookimpl

MAPGRAFT_CONTRACT = (1, 0)
SECOND = 1_000_000_000


class Neighbours:
    """They meet every so many seconds, and at the end."""

    def __init__(self, *, row: Sequence[str], seconds: float = 30.0) -> None:
        self.pairs = tuple(pair for one in pairwise(row) for pair in (one, one[::-1]))
        self.every_ns = round(seconds * SECOND)

    def due(self, situation: Situation) -> Sequence[Meeting]:
        first = (situation.previous_ns - situation.start_ns) // self.every_ns + 1
        last = (situation.now_ns - situation.start_ns) // self.every_ns
        met = [Meeting(situation.start_ns + n * self.every_ns, self.pairs) for n in range(first, last + 1)]
        return [*met, Meeting(situation.now_ns, self.pairs)] if situation.ending else met


@hookimpl
def register_policies(register):
    register(Descriptor("neighbours", "around:Neighbours", "only neighbours in a row meet"))
