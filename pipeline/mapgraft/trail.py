"""What a robot has observed lately: kept once, for all merges that have not looked at it yet."""

from __future__ import annotations

from functools import cache, reduce
from typing import cast

from mapgraft.contracts import MeetingRegion, Observation, Region


class Stretch:
    """Some observations in a row. What they touched is united when it is first asked for, once for everybody."""

    __slots__ = ("_regions", "_touched", "observations")

    def __init__(self, observations: tuple[Observation, ...], regions: tuple[Region, ...]) -> None:
        self.observations = observations
        self._regions = regions
        self._touched: Region | None = None

    def touched(self) -> Region:
        """The units that any of the observations touched."""
        if self._touched is None:
            self._touched = reduce(lambda a, b: a.union(b), self._regions)
        return self._touched

    def meets(self, region: Region) -> bool:
        """Whether any of the observations touched the region; often the latest one did, and nothing need be united."""
        return _meet(self._regions[-1], region) or _meet(self.touched(), region)

    def __len__(self) -> int:
        return len(self.observations)


def _meet(a: Region, b: Region) -> bool:
    """Whether two regions have a unit in common."""
    if _tells(type(a)) and _tells(type(b)):
        return cast("MeetingRegion", a).meets(cast("MeetingRegion", b))
    return len(a.minus(b)) < len(a)


@cache
def _tells(kind: type[Region]) -> bool:
    """Whether regions of a kind tell themselves whether they meet; asked once a kind, for asking takes microseconds."""
    return issubclass(kind, MeetingRegion)


class Trail:
    """The observations of one robot, counted from 0; those that everybody has looked at are forgotten."""

    __slots__ = ("_first", "_observations", "_regions", "_stretches", "now")

    def __init__(self) -> None:
        self.now = 0  # how many observations there were so far
        self._first = 0
        self._observations: list[Observation] = []
        self._regions: list[Region] = []
        self._stretches: dict[int, Stretch] = {}

    def add(self, observation: Observation, touched: Region) -> None:
        self._observations.append(observation)
        self._regions.append(touched)
        self._stretches.clear()
        self.now += 1

    def since(self, count: int) -> Stretch:
        """The observations after the first ``count`` ones; the same object as long as no other is added."""
        stretch = self._stretches.get(count)
        if stretch is None:
            first = count - self._first
            stretch = Stretch(tuple(self._observations[first:]), tuple(self._regions[first:]))
            self._stretches[count] = stretch
        return stretch

    def forget(self, count: int) -> None:
        """Let go of the first ``count`` observations."""
        if (gone := count - self._first) > 0:
            del self._observations[:gone], self._regions[:gone]
            self._first = count

    def __len__(self) -> int:
        """How many observations are kept."""
        return len(self._observations)
