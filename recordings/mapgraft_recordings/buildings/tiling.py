"""A floor as rectangles that touch: which of them are one space, and where walls between them must stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Role = Literal["corridor", "room", "hall", "wet", "shaft"]
Side = Literal["south", "north", "west", "east"]

_TOUCH_M = 1e-6


@dataclass(frozen=True, slots=True)
class Cell:
    """A rectangle of floor in the drawn frame; cells of equal ``space`` have no walls between them.

    A ``shaft`` is a solid core nobody can enter. ``model`` names rooms that are drawn from one model.
    """

    x0_m: float
    y0_m: float
    x1_m: float
    y1_m: float
    space: int
    role: Role = "room"
    model: int = 0

    @property
    def width_m(self) -> float:
        return self.x1_m - self.x0_m

    @property
    def depth_m(self) -> float:
        return self.y1_m - self.y0_m

    @property
    def middle(self) -> tuple[float, float]:
        return (self.x0_m + self.x1_m) / 2, (self.y0_m + self.y1_m) / 2

    def overlaps(self, other: Cell) -> bool:
        return (
            self.x0_m < other.x1_m - _TOUCH_M
            and other.x0_m < self.x1_m - _TOUCH_M
            and self.y0_m < other.y1_m - _TOUCH_M
            and other.y0_m < self.y1_m - _TOUCH_M
        )


@dataclass(frozen=True, slots=True)
class Border:
    """A straight piece of wall line: from ``low_m`` to ``high_m`` along x (or along y where ``upright``), at ``at_m``.

    ``before`` and ``after`` are indices of the cells at smaller and larger coordinate across, -1 outside.
    """

    upright: bool
    at_m: float
    low_m: float
    high_m: float
    before: int
    after: int

    @property
    def length_m(self) -> float:
        return self.high_m - self.low_m

    def point(self, along_m: float) -> tuple[float, float]:
        return (self.at_m, along_m) if self.upright else (along_m, self.at_m)


def borders(cells: Sequence[Cell]) -> list[Border]:
    """All pieces of wall line between cells of different space and around the floor, in a fixed order."""
    found = []
    for i, cell in enumerate(cells):
        for upright in (False, True):
            found += _after(cells, i, cell, upright)
            found += _outside_before(cells, i, cell, upright)
    return [border for border in found if border.length_m > _TOUCH_M]


def _sides(cell: Cell, upright: bool) -> tuple[float, float, float, float]:
    """(near, far) across and (low, high) along."""
    if upright:
        return cell.x0_m, cell.x1_m, cell.y0_m, cell.y1_m
    return cell.y0_m, cell.y1_m, cell.x0_m, cell.x1_m


def _after(cells: Sequence[Cell], i: int, cell: Cell, upright: bool) -> list[Border]:
    """The borders at a cell's far side: with every cell beyond it, and with the outside."""
    _, far, low, high = _sides(cell, upright)
    found, covered = [], []
    for j, other in enumerate(cells):
        near, _, other_low, other_high = _sides(other, upright)
        start, end = max(low, other_low), min(high, other_high)
        if abs(near - far) > _TOUCH_M or end - start <= _TOUCH_M:
            continue
        covered.append((start, end))
        if other.space != cell.space:
            found.append(Border(upright, far, start, end, i, j))
    return found + [Border(upright, far, start, end, i, -1) for start, end in _gaps(low, high, covered)]


def _outside_before(cells: Sequence[Cell], i: int, cell: Cell, upright: bool) -> list[Border]:
    near, _, low, high = _sides(cell, upright)
    covered = []
    for other in cells:
        _, far, other_low, other_high = _sides(other, upright)
        start, end = max(low, other_low), min(high, other_high)
        if abs(near - far) <= _TOUCH_M and end - start > _TOUCH_M:
            covered.append((start, end))
    return [Border(upright, near, start, end, -1, i) for start, end in _gaps(low, high, covered)]


def _gaps(low: float, high: float, covered: list[tuple[float, float]]) -> list[tuple[float, float]]:
    gaps, at = [], low
    for start, end in sorted(covered):
        if start > at + _TOUCH_M:
            gaps.append((at, start))
        at = max(at, end)
    if high > at + _TOUCH_M:
        gaps.append((at, high))
    return gaps
