"""Regions that come one by one and are wanted as one, now and then."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Final

from mapgraft.contracts import Region

MOST_APART: Final = 64  # regions that wait: uniting many at once costs little more than uniting two


def united(regions: Sequence[Region]) -> Region:
    """The union of at least one region."""
    return reduce(lambda a, b: a.union(b), regions)


class Gathering:
    """A union of regions that is made when somebody asks for it, or when many have come together."""

    __slots__ = ("_apart", "_nothing")

    def __init__(self, nothing: Region) -> None:
        self._nothing = nothing
        self._apart: list[Region] = []

    def add(self, region: Region) -> None:
        self._apart.append(region)
        if len(self._apart) > MOST_APART:
            self.united()

    def united(self) -> Region:
        """The union of all that was added."""
        if len(self._apart) > 1:
            self._apart = [united(self._apart)]
        return self._apart[0] if self._apart else self._nothing

    def clear(self) -> None:
        self._apart.clear()

    def __bool__(self) -> bool:
        """Whether anything was added."""
        return bool(self._apart)
