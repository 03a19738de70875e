"""How robots that recorded one after another come to a common start."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from mapgraft.recording.robots.clocks import Range


def shifts(ranges: Mapping[str, Range], start: Literal["aligned", "recorded"]) -> dict[str, int]:
    """What to add to each robot's stamps, in nanoseconds.

    Robots whose ranges overlap, directly or through others, recorded together and keep their distance. ``aligned``
    shifts each such group to the start of the earliest; ``recorded`` shifts nothing.
    """
    if start == "recorded" or not ranges:
        return dict.fromkeys(ranges, 0)
    groups: list[list[str]] = []
    for name in sorted(ranges, key=lambda name: (ranges[name], name)):
        joined = [group for group in groups if any(ranges[name].joins(ranges[other]) for other in group)]
        groups = [group for group in groups if group not in joined] + [[*(n for group in joined for n in group), name]]
    first_ns = {name: min(ranges[other].first_ns for other in group) for group in groups for name in group}
    common_ns = min(first_ns.values())
    return {name: common_ns - first_ns[name] for name in ranges}
