"""How robots that recorded one after another come to a common start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from mapgraft.lives import base_name
from mapgraft.recording.robots.clocks import Range
from mapgraft.recording.robots.plan import RobotPlan


def shifts(plans: Sequence[RobotPlan], start: Literal["aligned", "recorded"]) -> dict[str, int]:
    """What to add to each robot's stamps, in nanoseconds; to those of all lives of one robot the same.

    Robots whose ranges overlap, directly or through others, recorded together and keep their distance. ``aligned``
    shifts each such group to the start of the earliest; ``recorded`` shifts nothing.
    """
    if start == "recorded" or not plans:
        return {plan.name: 0 for plan in plans}
    ranges: dict[str, Range] = {}
    for plan in plans:
        name, (first, last) = base_name(plan.name), plan.range
        known = ranges.get(name, plan.range)
        ranges[name] = Range(min(known.first_ns, first), max(known.last_ns, last))
    groups: list[list[str]] = []
    for name in sorted(ranges, key=lambda name: (ranges[name], name)):
        joined = [group for group in groups if any(ranges[name].joins(ranges[other]) for other in group)]
        groups = [group for group in groups if group not in joined] + [[*(n for group in joined for n in group), name]]
    first_ns = {name: min(ranges[other].first_ns for other in group) for group in groups for name in group}
    common_ns = min(first_ns.values())
    return {plan.name: common_ns - first_ns[base_name(plan.name)] for plan in plans}
