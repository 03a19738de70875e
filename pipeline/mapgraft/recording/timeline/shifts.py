"""How robots that recorded one after another come to a common start."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

_TOGETHER_NS = 1_000_000_000  # ranges that share less than this only touch, as two windows of one log do


class Range(NamedTuple):
    """From the first to the last stamp, both included."""

    first_ns: int
    last_ns: int

    def joins(self, earlier: Range) -> bool:
        """Whether this range, which begins no earlier, shares its time with another."""
        return self.first_ns + min(_TOGETHER_NS, self.last_ns - self.first_ns) <= earlier.last_ns


def shifts(ranges: Mapping[str, Range], start: Literal["aligned", "recorded"]) -> dict[str, int]:
    """What to add to each robot's stamps, in nanoseconds.

    Robots whose ranges overlap, directly or through others, recorded together and keep their distance. ``aligned``
    shifts each such group to the start of the earliest; ``recorded`` shifts nothing.
    """
    groups: list[tuple[Range, list[str]]] = []
    for name, range_ in sorted(ranges.items(), key=lambda item: (item[1], item[0])):
        if groups and range_.joins(groups[-1][0]):
            known, names = groups.pop()
            groups.append((Range(known.first_ns, max(known.last_ns, range_.last_ns)), [*names, name]))
        else:
            groups.append((range_, [name]))
    if start == "recorded" or not groups:
        return dict.fromkeys(ranges, 0)
    common_ns = groups[0][0].first_ns
    return {name: common_ns - range_.first_ns for range_, names in groups for name in names}
