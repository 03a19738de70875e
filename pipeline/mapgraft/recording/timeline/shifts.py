"""How robots that recorded one after another come to a common start."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from mapgraft.lives import base_name
from mapgraft.recording.robots.clocks import Range


def shifts(ranges: Mapping[str, Range], start: Literal["aligned", "recorded"]) -> dict[str, int]:
    """What to add to each robot's stamps, in nanoseconds; to those of all lives of one robot the same.

    Robots whose ranges overlap, directly or through others, recorded together and keep their distance. ``aligned``
    shifts each such group to the start of the earliest; ``recorded`` shifts nothing.
    """
    if start == "recorded" or not ranges:
        return dict.fromkeys(ranges, 0)
    whole = _of_all_lives(ranges)
    groups: list[list[str]] = []
    for name in sorted(whole, key=lambda name: (whole[name], name)):
        joined = [group for group in groups if any(whole[name].joins(whole[other]) for other in group)]
        groups = [group for group in groups if group not in joined] + [[*(n for group in joined for n in group), name]]
    first_ns = {name: min(whole[other].first_ns for other in group) for group in groups for name in group}
    common_ns = min(first_ns.values())
    return {name: common_ns - first_ns[base_name(name)] for name in ranges}


def _of_all_lives(ranges: Mapping[str, Range]) -> dict[str, Range]:
    """From the first stamp of a robot's first life to the last one of its last."""
    whole: dict[str, Range] = {}
    for life, (first, last) in ranges.items():
        known = whole.get(base_name(life), Range(first, last))
        whole[base_name(life)] = Range(min(known.first_ns, first), max(known.last_ns, last))
    return whole
