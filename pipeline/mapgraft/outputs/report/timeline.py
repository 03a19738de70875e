"""The timeline: every decision on data time, one row per ordered pair of robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from mapgraft.events import Event
from mapgraft.outputs.report.axes import Axis
from mapgraft.outputs.report.pairs import ATTEMPTS
from mapgraft.outputs.report.words import TONES, Clock, happened, short

_LEFT, _RIGHT, _TOP, _ROW, _FOOT = 190.0, 990.0, 8.0, 26.0, 34.0  # drawing units
_MOST_ROWS: Final = 60
_NEAR: Final = 5.0  # drawing units: marks of a kind that lie closer are one mark
_LABEL: Final = 11  # characters of a robot's name


@dataclass(frozen=True, slots=True)
class Bar:
    """The time for which a merge stood in one state."""

    x: float
    width: float
    tone: str
    title: str
    href: str


@dataclass(frozen=True, slots=True)
class Mark:
    """One event, or several of a kind that lie too close to tell apart."""

    x: float
    kind: str
    tone: str
    title: str
    href: str


@dataclass(slots=True)
class Row:
    y: float
    label: str
    title: str
    bars: list[Bar] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Timeline:
    """What the template draws. ``left_out`` pairs have no row."""

    rows: Sequence[Row]
    ticks: Sequence[tuple[float, str]]
    left: float
    right: float
    bottom: float
    height: float
    unit: str
    left_out: int


def timeline(decisions: Sequence[Event], clock: Clock, anchors: Mapping[str, str]) -> Timeline:
    """``anchors`` is where on the page a merge is told, by its id."""
    by_pair: dict[tuple[str, str], list[Event]] = {}
    for event in decisions:
        if event.donor:
            by_pair.setdefault((event.receiver, event.donor), []).append(event)
    merged = {pair for pair, events in by_pair.items() if any(event.kind == "merged" for event in events)}
    pairs = sorted(by_pair, key=lambda pair: (pair not in merged, pair))
    shown = sorted(pairs[:_MOST_ROWS])
    axis = Axis(0.0, max(clock.units(clock.end_ns), 1e-3), _LEFT, _RIGHT)
    draw = _Drawing(clock, axis, anchors)
    rows = [draw.row(n, pair, by_pair[pair]) for n, pair in enumerate(shown)]
    bottom = _TOP + _ROW * max(len(rows), 1)
    left_out = len(pairs) - len(shown)
    return Timeline(rows, axis.ticks(8), _LEFT, _RIGHT, bottom, bottom + _FOOT, clock.unit, left_out)


@dataclass(frozen=True, slots=True)
class _Drawing:
    clock: Clock
    axis: Axis
    anchors: Mapping[str, str]

    def row(self, n: int, pair: tuple[str, str], events: Sequence[Event]) -> Row:
        label = f"{short(pair[0], _LABEL)} ← {short(pair[1], _LABEL)}"
        row = Row(_TOP + _ROW * (n + 0.5), label, f"{pair[0]} receives from {pair[1]}")
        row.bars += self._bars(events)
        through = ("reattached", "attached", "detached", "unattached", "disputed", "disbelieved")
        for kind in ("updated", *ATTEMPTS, *through, "merged", "confirmed", "reverted"):
            row.marks += self._marks(kind, [event for event in events if event.kind == kind])
        return row

    def _bars(self, events: Sequence[Event]) -> list[Bar]:
        """Amber while a merge is provisional, green from its confirmation on."""
        bars: list[Bar] = []
        since: dict[str, Event] = {}
        for event in events:
            before = since.pop(event.merge_id, None)
            if before is not None and (event.kind in ("confirmed", "reverted")):
                bars.append(self._bar(before, event.stamp_ns))
            if event.kind in ("merged", "confirmed"):
                since[event.merge_id] = event
            elif before is not None and event.kind != "reverted":
                since[event.merge_id] = before
        return bars + [self._bar(event, self.clock.end_ns) for event in since.values()]

    def _bar(self, event: Event, until_ns: int) -> Bar:
        x0, x1 = self._x(event.stamp_ns), self._x(until_ns)
        said = f"{event.merge_id}: {event.state} from {self.clock.at(event.stamp_ns)} to {self.clock.at(until_ns)}"
        return Bar(x0, round(max(x1 - x0, 1.0), 1), TONES[event.state], said, self.anchors.get(event.merge_id, ""))

    def _marks(self, kind: str, events: Sequence[Event]) -> list[Mark]:
        marks: list[Mark] = []
        together: list[Event] = []
        for event in events:
            if together and self._x(event.stamp_ns) - self._x(together[0].stamp_ns) >= _NEAR:
                marks.append(self._mark(kind, together))
                together = []
            together.append(event)
        return [*marks, self._mark(kind, together)] if together else marks

    def _mark(self, kind: str, events: Sequence[Event]) -> Mark:
        first = events[0]
        name = first.merge_id or f"{first.receiver} ← {first.donor}"
        said = f"{happened(first.kind)} at {self.clock.at(first.stamp_ns)}, {name}: {first.reason}"
        if len(events) > 1:
            said = f"{len(events)} events up to {self.clock.at(events[-1].stamp_ns)}, the first: {said}"
        href = self.anchors.get(first.merge_id, "")
        if not href and kind in ATTEMPTS:
            href = "#not-merged"
        return Mark(self._x(first.stamp_ns), kind, TONES[kind], short(said, 300), href)

    def _x(self, stamp_ns: int) -> float:
        return self.axis.at(self.clock.units(stamp_ns))
