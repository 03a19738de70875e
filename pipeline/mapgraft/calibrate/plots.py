"""Small drawings for a page: lines, points with intervals and bars between two axes, in drawing units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mapgraft.outputs.report.axes import Axis
from mapgraft.outputs.report.words import number

WIDTH, HEIGHT = 380.0, 264.0
LEFT, RIGHT, TOP, BOTTOM = 50.0, 368.0, 12.0, 218.0

_ROOM = 0.08  # of what is drawn, below and above

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Line:
    """A line through points, or steps; ``tone`` is its class in the style sheet."""

    points: Points
    tone: str
    label: str = ""
    dashed: bool = False


@dataclass(frozen=True, slots=True)
class Dot:
    """A point, with an interval up and down where ``low`` and ``high`` tell one."""

    x: float
    y: float
    tone: str
    title: str
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True)
class Mark:
    """A limit across the drawing, from top to bottom or, where ``level``, from left to right."""

    at: float
    tone: str
    label: str
    level: bool = False


@dataclass(frozen=True, slots=True)
class Box:
    """A bar of a histogram from ``x0`` to ``x1``."""

    x0: float
    x1: float
    y: float
    tone: str


@dataclass(frozen=True, slots=True, eq=False)
class Plot:
    """A drawing with everything in drawing units, as the template puts it down."""

    title: str
    caption: str
    alt: str
    x_title: str
    y_title: str
    lines: Sequence[tuple[str, str, bool]]
    dots: Sequence[tuple[float, float, str, str, float | None, float | None]]
    marks: Sequence[tuple[float, str, str, bool]]
    boxes: Sequence[tuple[float, float, float, float, str]]
    x_ticks: Sequence[tuple[float, str]]
    y_ticks: Sequence[tuple[float, str]]
    legend: Sequence[tuple[str, str, bool]]


@dataclass(frozen=True, slots=True)
class Frame:
    """What a drawing is called and what its axes show; a range that is None is taken from what is drawn.

    ``x_names`` puts names instead of numbers under the positions 0, 1, ….
    """

    title: str
    caption: str
    x_title: str
    y_title: str
    x: tuple[float, float] | None = None
    y: tuple[float, float] | None = None
    x_names: Sequence[str] = ()
    percent: bool = False


def plot(
    frame: Frame,
    *,
    lines: Sequence[Line] = (),
    dots: Sequence[Dot] = (),
    marks: Sequence[Mark] = (),
    boxes: Sequence[Box] = (),
) -> Plot | None:
    """The drawing; None where there is nothing to draw."""
    xs = [x for line in lines for x, _ in line.points] + [dot.x for dot in dots]
    xs += [x for box in boxes for x in (box.x0, box.x1)] + [mark.at for mark in marks if not mark.level]
    ys = [y for line in lines for _, y in line.points] + [dot.y for dot in dots] + [box.y for box in boxes]
    ys += [y for dot in dots for y in (dot.low, dot.high) if y is not None] + [m.at for m in marks if m.level]
    xs, ys = ([value for value in values if math.isfinite(value)] for values in (xs, ys))
    if frame.x_names:
        xs = [-0.5, len(frame.x_names) - 0.5]
    if not xs or not ys:
        return None
    room = 0.0 if boxes else _ROOM * (max(ys) - min(ys))  # so that no point lies on the frame; bars stand on it
    across = Axis.over(list(frame.x) if frame.x else xs, LEFT, RIGHT)
    up = Axis.over(list(frame.y) if frame.y else [min(ys) - room, max(ys) + room], BOTTOM, TOP)
    names = [(across.at(float(n)), name) for n, name in enumerate(frame.x_names)]
    y_ticks = [(at, f"{float(text.replace(' ', '')) * 100:g} %" if frame.percent else text) for at, text in up.ticks(5)]
    return Plot(
        frame.title,
        frame.caption,
        f"{frame.title}: {frame.y_title} over {frame.x_title}. {frame.caption}",
        frame.x_title,
        frame.y_title,
        [(_path(line.points, across, up), line.tone, line.dashed) for line in lines if line.points],
        [_placed(dot, across, up) for dot in dots if math.isfinite(dot.x) and math.isfinite(dot.y)],
        [(up.at(m.at) if m.level else across.at(m.at), m.tone, m.label, m.level) for m in marks if math.isfinite(m.at)],
        [
            (
                across.at(b.x0),
                up.at(b.y),
                round(across.at(b.x1) - across.at(b.x0), 1),
                round(BOTTOM - up.at(b.y), 1),
                b.tone,
            )
            for b in boxes
        ],
        names or across.ticks(5),
        y_ticks,
        [(line.tone, line.label, line.dashed) for line in lines if line.label],
    )


def _placed(dot: Dot, across: Axis, up: Axis) -> tuple[float, float, str, str, float | None, float | None]:
    low, high = (None if value is None else up.at(value) for value in (dot.low, dot.high))
    return across.at(dot.x), up.at(dot.y), dot.tone, dot.title, low, high


def _path(points: Points, across: Axis, up: Axis) -> str:
    placed = [(across.at(x), up.at(y)) for x, y in points if math.isfinite(x) and math.isfinite(y)]
    kept = [p for n, p in enumerate(placed) if n in (0, len(placed) - 1) or p != placed[n - 1]]
    return " ".join(f"{x:g},{y:g}" for x, y in kept)


def said(value: float) -> str:
    """A number for a title."""
    return number(value) if math.isfinite(value) else "–"
