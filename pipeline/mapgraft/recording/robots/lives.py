"""Robots whose map frame begins anew within a mission: each life of the frame is planned as a robot of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import islice, pairwise
from typing import Final

from mapgraft.config import RobotConfig
from mapgraft.contracts import ConfigError
from mapgraft.lives import life_name
from mapgraft.recording.robots.discovery import FoundRobot
from mapgraft.recording.robots.payloads import Payloads
from mapgraft.recording.robots.plan import RobotPlan, S, Unmappable, Window, range_within

FILES: Final = "files"  # the word of the configuration for a frame that begins anew with every file
MOST: Final = 100

Planner = Callable[[Sequence[FoundRobot]], RobotPlan | Unmappable]


def lives_of(
    name: str, found: Sequence[FoundRobot], config: RobotConfig, plan: Planner, payloads: Payloads
) -> list[RobotPlan] | Unmappable:
    """The plans of a robot, one for each life of its map frame, in their order; mostly there is one.

    ``plan`` plans what was found in some of its files. Raises ConfigError for what ``robots.*.restarts`` cannot mean.
    """
    restarts = config.restarts
    if restarts is not None and restarts != FILES:
        whole = plan(found)
        return (
            whole if isinstance(whole, Unmappable) else _named(_cut(whole, _times_of(whole, restarts), payloads), name)
        )
    groups = _by_file(name, found, plan) if restarts == FILES else _by_frame(found, plan)
    lives: list[RobotPlan] = []
    for group in groups:
        life = plan(group)
        if isinstance(life, Unmappable):
            return life
        lives.append(life)
    return _named(lives, name)


def _by_file(name: str, found: Sequence[FoundRobot], plan: Planner) -> list[Sequence[FoundRobot]]:
    """Every file by itself, in the order of time."""
    where = f"robots.{name}.restarts"
    if len(found) < 2:
        raise ConfigError(f"{where}: {FILES} says that its frame begins anew with each, but it has only one")
    ordered, unmappable = _in_order(found, plan)
    if unmappable:
        raise ConfigError(f"{where}: {FILES} needs files that can be mapped one by one: {unmappable[0].reason}")
    if both := _at_once([one for _, one in ordered]):
        raise ConfigError(f"{where}: {both} were recorded at the same time, not one after the other")
    return [[one] for one, _ in ordered]


def _by_frame(found: Sequence[FoundRobot], plan: Planner) -> list[Sequence[FoundRobot]]:
    """Files one after the other whose map frames have other names, and nothing tells how they lie to each other."""
    if len(found) < 2:
        return [found]
    ordered, unmappable = _in_order(found, plan)
    if unmappable or _at_once([one for _, one in ordered]):
        return [found]
    groups: list[list[FoundRobot]] = []
    before: RobotPlan | None = None
    for one, alone in ordered:
        if before is None or _is_another_frame(before, alone, plan(found)):
            groups.append([])
        groups[-1].append(one)
        before = alone
    return list(groups)


def _is_another_frame(one: RobotPlan, other: RobotPlan, both: RobotPlan | Unmappable) -> bool:
    """Whether the map frames of two files are two, also when everything is known that all files tell."""
    a, b = one.poses.map_frame, other.poses.map_frame
    if a == b or "none" in (one.poses.method, other.poses.method):
        return False
    if isinstance(both, Unmappable):
        return True
    frames = both.poses.tree.frames
    return not (a in frames and b in frames and b in frames.linked(a))


def _in_order(
    found: Sequence[FoundRobot], plan: Planner
) -> tuple[list[tuple[FoundRobot, RobotPlan]], list[Unmappable]]:
    """What was found in each file, planned alone, in the order of time; and what cannot be."""
    plans = [(one, plan([one])) for one in found]
    mappable = [(one, alone) for one, alone in plans if isinstance(alone, RobotPlan)]
    mappable.sort(key=lambda pair: (pair[1].range, pair[1].glimpses[0].source.path.name))
    return mappable, [alone for _, alone in plans if isinstance(alone, Unmappable)]


def _at_once(plans: Sequence[RobotPlan]) -> str:
    """The names of two files that were recorded at the same time; empty where they came one after the other."""
    for one, other in pairwise(plans):
        if other.range.joins(one.range):
            return " and ".join(p.glimpses[0].source.path.name for p in (one, other))
    return ""


def _times_of(plan: RobotPlan, restarts: str | Sequence[float]) -> list[int]:
    """When the frame begins anew, by the time of recording, rising."""
    if not isinstance(restarts, str):
        starts = [g.source.start_ns for g in plan.glimpses if g.source.start_ns is not None]
        start_ns = 0 if plan.times.clock == "index" else min(starts, default=plan.payloads[0].first[0].log_ns)
        return sorted({start_ns + round(seconds * S) for seconds in restarts})
    where = f"robots.{plan.name}.restarts"
    if plan.times.clock == "index":
        raise ConfigError(f"{where}: its scans have no times, so {restarts!r} cannot tell when: give seconds (scans)")
    told = sorted({raw.log_ns for g in plan.glimpses for raw in islice(g.source.messages([restarts]), MOST + 1)})
    if not told:
        raise ConfigError(f"{where}: there is no message on {restarts!r}: name a topic, seconds, or {FILES}")
    return told


def _cut(plan: RobotPlan, times_ns: Sequence[int], payloads: Payloads) -> list[RobotPlan]:
    """The plan in pieces; one in which nothing was observed is none."""
    if len(times_ns) >= MOST:
        raise ConfigError(
            f"robots.{plan.name}.restarts: it begins anew {len(times_ns)} times or more: {MOST - 1} are allowed"
        )
    whole = plan.window or Window(min(0, *times_ns), None)
    inner = [ns for ns in times_ns if whole.from_ns < ns and (whole.until_ns is None or ns < whole.until_ns)]
    edges = [whole.from_ns, *inner, whole.until_ns]
    lives: list[RobotPlan] = []
    for from_ns, until_ns in pairwise(edges):
        window = Window(from_ns or 0, until_ns)
        if (range_ := range_within(plan, window, payloads)) is not None:
            lives.append(replace(plan, window=window, range=range_))
    return lives


def _named(plans: Sequence[RobotPlan], name: str) -> list[RobotPlan]:
    """The lives with their names and numbers."""
    if len(plans) < 2:
        return list(plans)
    names = [life_name(name, life) for life in range(1, len(plans) + 1)]
    return [
        replace(plan, name=own, life=life, follows=before, has_lives=True)
        for life, (plan, own, before) in enumerate(zip(plans, names, ["", *names], strict=False), 1)
    ]
