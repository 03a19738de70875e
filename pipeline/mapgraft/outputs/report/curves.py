"""The numbers of one merge over time, with the limits at which it is confirmed or reverted."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from mapgraft.events import Event
from mapgraft.outputs.report.axes import Axis
from mapgraft.outputs.report.words import TONES, Clock, number

WIDTH, HEIGHT = 320.0, 132.0  # drawing units
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 310.0, 10.0, 110.0
_MOST_POINTS: Final = 160  # of a line: of more, the lowest and highest of each stretch are drawn
_SIDES: Final[Mapping[str, str]] = {"revert_at": "bad", "confirm_at": "good"}
_MARKED = ("merged", "confirmed", "reverted")


@dataclass(frozen=True, slots=True)
class Limit:
    value: float
    tone: str
    text: str
    y: float = 0.0


@dataclass(frozen=True, slots=True)
class Curve:
    """What the template draws: a line through ``points``, limits, marks at decisions, and axes."""

    name: str
    unit: str
    last: str
    missing: int
    points: str
    dots: Sequence[tuple[float, float]]
    limits: Sequence[Limit]
    marks: Sequence[tuple[float, str, str]]  # x, tone, title
    x_ticks: Sequence[tuple[float, str]]
    y_ticks: Sequence[tuple[float, str]]

    @property
    def decides(self) -> bool:
        """Whether the verifier told a limit of it."""
        return bool(self.limits)


@dataclass(slots=True)
class _Series:
    unit: str
    seen: list[tuple[float, float]] = field(default_factory=list)  # time, value (may be NaN or infinite)


def curves(events: Sequence[Event], clock: Clock) -> list[Curve]:
    """The curves of one merge's events: first the numbers that have a limit, then the other metrics, by name."""
    series = dict(_series(events, clock))
    limits = _limits(events)
    order = sorted(series, key=lambda name: (name not in limits, name))
    marks = [(clock.units(e.stamp_ns), TONES[e.kind], f"{e.kind} at {clock.at(e.stamp_ns)}") for e in events]
    marks = [mark for mark, event in zip(marks, events, strict=True) if event.kind in _MARKED]
    drawn = (_drawn(name, series[name], limits.get(name, ()), marks) for name in order)
    return [curve for curve in drawn if curve is not None]


def _series(events: Sequence[Event], clock: Clock) -> Iterator[tuple[str, _Series]]:
    """Metrics, details of metrics and entries of the evidence that have limits, over time."""
    limited = {
        name.split(f".{side}")[0]
        for event in events
        for name in event.evidence
        for side in _SIDES
        if f".{side}" in name
    }
    found: dict[str, _Series] = {}
    for event in events:
        at = clock.units(event.stamp_ns)
        values = {m.name: (m.value, m.unit) for m in event.measurements}
        for m in event.measurements:
            values |= {f"{m.name}.{name}": (v, "") for name, v in m.details.items() if f"{m.name}.{name}" in limited}
        values |= {name: (v, "") for name, v in event.evidence.items() if name in limited}
        for name, (value, unit) in values.items():
            found.setdefault(name, _Series(unit)).seen.append((at, value))
    yield from found.items()


def _limits(events: Sequence[Event]) -> dict[str, list[Limit]]:
    """The limits that the verifier told last, by the name of what they bound."""
    told: dict[str, dict[str, float]] = {}
    for event in events:
        for entry, value in event.evidence.items():
            for side in _SIDES:
                name, found, _ = entry.partition(f".{side}")
                if found and math.isfinite(value):
                    told.setdefault(name, {})[entry.removeprefix(f"{name}.")] = value
    return {name: [_limit(kind, value) for kind, value in sides.items()] for name, sides in told.items()}


def _limit(kind: str, value: float) -> Limit:
    side = kind.split(".")[0]
    said = "reverted" if side == "revert_at" else "confirmed"
    return Limit(value, _SIDES[side], f"{said} at {number(value)}")


def _drawn(
    name: str, series: _Series, limits: Sequence[Limit], marks: Sequence[tuple[float, str, str]]
) -> Curve | None:
    finite = [(x, y) for x, y in series.seen if math.isfinite(y)]
    if not finite:
        return None
    xs = [x for x, _ in series.seen] + [x for x, _, _ in marks]
    across = Axis.over(xs, _LEFT, _RIGHT)
    up = Axis.over([y for _, y in finite] + [limit.value for limit in limits], _BOTTOM, _TOP)
    line = [(across.at(x), up.at(y)) for x, y in thinned(finite)]
    return Curve(
        name,
        "" if series.unit in ("", "1") else series.unit,
        number(finite[-1][1]),
        len(series.seen) - len(finite),
        " ".join(f"{x:g},{y:g}" for x, y in line),
        line if len(line) <= 40 else (),
        [Limit(limit.value, limit.tone, limit.text, up.at(limit.value)) for limit in limits],
        [(across.at(x), tone, title) for x, tone, title in marks],
        across.ticks(4),
        up.ticks(4),
    )


def thinned(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """At most ``_MOST_POINTS`` of them, so that nothing that stood out is lost."""
    if len(points) <= _MOST_POINTS:
        return list(points)
    step = math.ceil(len(points) / (_MOST_POINTS / 2))
    out: list[tuple[float, float]] = []
    for start in range(0, len(points), step):
        part = points[start : start + step]
        out += sorted({min(part, key=lambda p: p[1]), max(part, key=lambda p: p[1])})
    return out
