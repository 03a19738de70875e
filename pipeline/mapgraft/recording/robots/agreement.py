"""Clocks of several robots brought together by what they have in common: one recorder, or an event that all heard."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from statistics import median_low
from typing import Final, NamedTuple

from mapgraft.config import Config
from mapgraft.contracts import ConfigError
from mapgraft.contracts.sources import Source
from mapgraft.lives import base_name
from mapgraft.recording.robots.clocks import Range, offset_of
from mapgraft.recording.robots.plan import RobotPlan

S: Final = 1_000_000_000

ANOTHER_CLOCK_NS: Final = 2 * S
"""Stamps of two robots that lie further apart, against one recorder, are of two clocks; less may be the network."""

_EVENTS: Final = 20_000  # of one file that are looked at
_FEWEST: Final = 3  # events heard by both that make an offset


def brought_together(plans: Sequence[RobotPlan], config: Config) -> tuple[RobotPlan, ...]:
    """The plans with clocks brought together, and remarks that say by how much; configured offsets stay as they are.

    Robots in the same files were heard by one recorder: where their stamps, measured against it, lie further apart than
    a network explains, they come to the one whose clock is nearest to the recorder's. With ``mission.common_event`` the
    recorders themselves come to that of the first file; a remark says where too little was heard by both. Raises
    ConfigError when no file has that topic.
    """
    topic = config.mission.common_event
    recorders = _recorders(plans, topic)
    free = [plan for plan in plans if _is_free(plan, config)]
    moved: dict[str, tuple[int, str]] = {}
    for group in _by_recorder(free):
        reference = min(group, key=lambda plan: (abs(plan.times.offset_ns), plan.name))
        for plan in group:
            ahead_ns = plan.times.offset_ns - reference.times.offset_ns
            if abs(ahead_ns) > max(ANOTHER_CLOCK_NS, _spread(plan) + _spread(reference)):
                moved[plan.name] = (-ahead_ns, f"to that of {reference.name}, by the recorder that heard both")
    alone: dict[str, str] = {}
    for plan in free:
        recorder = recorders.get(plan.glimpses[0].source.path)
        if recorder is not None and recorder.alike < _FEWEST:
            alone[plan.name] = _too_few(plan, recorder, topic)
        elif recorder is not None and recorder.ahead_ns:
            own_ns, how = moved.get(plan.name, (0, ""))
            text = f"to that of {recorder.first}, by {topic} that both heard"
            moved[plan.name] = (own_ns - recorder.ahead_ns, f"{how}, and {text}" if how else text)
    told = [replace(p, remarks=(*p.remarks, alone[p.name])) if p.name in alone else p for p in plans]
    return tuple(_moved(plan, *moved[plan.name]) if plan.name in moved else plan for plan in told)


class _Recorder(NamedTuple):
    """The recorder of one file against that of the ``first``, by its name: how many events were heard ``alike``."""

    ahead_ns: int
    first: str
    alike: int


def _too_few(plan: RobotPlan, recorder: _Recorder, topic: str | None) -> str:
    file = plan.glimpses[0].source.path.name
    number = {0: "no message", 1: "only 1 message"}.get(recorder.alike, f"only {recorder.alike} messages")
    return (
        f"mission.common_event: {number} on {topic} came to {file} as to {recorder.first}, byte for byte, and "
        f"{_FEWEST} are needed: its clock is not moved by it (clock_offset_s says it instead)"
    )


def _is_free(plan: RobotPlan, config: Config) -> bool:
    """Whether a robot's clock may be moved: it has one, and nobody said how far it is off."""
    configured = config.robots.get(base_name(plan.name))
    told = configured is not None and configured.clock_offset_s is not None
    return plan.times.clock == "header" and not plan.ready_maps and not told


def _by_recorder(plans: Iterable[RobotPlan]) -> list[list[RobotPlan]]:
    groups: dict[tuple[Path, ...], list[RobotPlan]] = {}
    for plan in plans:
        groups.setdefault(tuple(g.source.path for g in plan.glimpses), []).append(plan)
    return list(groups.values())


def _spread(plan: RobotPlan) -> int:
    """How much a robot's offset to the recorder changes: a simulation runs slower, messages are late."""
    offsets = [t.stamp_ns - t.log_ns for t in plan.payloads[0].times]
    usual_ns = offset_of(plan.payloads[0].times)
    away = sorted(abs(offset - usual_ns) for offset in offsets)
    return away[len(away) * 4 // 5] if len(away) > 1 else 0  # a slip or two do not count


def _recorders(plans: Sequence[RobotPlan], topic: str | None) -> Mapping[Path, _Recorder]:
    """By how much each file's recorder is ahead of the first one's."""
    if topic is None:
        return {}
    sources = {g.source.path: g.source for plan in plans for g in plan.glimpses}
    heard = {path: _heard(source, topic) for path, source in sources.items()}
    with_topic = [path for path, events in heard.items() if events]
    if not with_topic:
        names = ", ".join(path.name for path in sources) or "none"
        raise ConfigError(f"mission.common_event: no file has messages on {topic!r}: the mission has {names}")
    first = with_topic[0]
    found: dict[Path, _Recorder] = {}
    for path in heard:
        if path != first:
            ahead = [log_ns - heard[first][event] for event, log_ns in heard[path].items() if event in heard[first]]
            found[path] = _Recorder(median_low(ahead) if ahead else 0, first.name, len(ahead))
    return found


def _heard(source: Source, topic: str) -> dict[bytes, int]:
    """The messages on a topic that came once, by a digest of their bytes, and when each was recorded."""
    found: dict[bytes, int] = {}
    twice: set[bytes] = set()
    for raw in islice(source.messages([topic]), _EVENTS):
        digest = hashlib.blake2b(raw.data, digest_size=16).digest()
        if digest in found:
            twice.add(digest)
        found[digest] = raw.log_ns
    return {digest: log_ns for digest, log_ns in found.items() if digest not in twice}


def _moved(plan: RobotPlan, offset_ns: int, how: str) -> RobotPlan:
    remark = f"its clock is moved by {offset_ns / S:+.3f} s {how} (clock_offset_s: 0 leaves it)"
    first_ns, last_ns = plan.range
    return replace(
        plan,
        range=Range(first_ns + offset_ns, last_ns + offset_ns),
        clock_offset_ns=plan.clock_offset_ns + offset_ns,
        remarks=(*plan.remarks, remark),
    )
