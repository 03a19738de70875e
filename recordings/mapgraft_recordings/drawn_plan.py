"""The floor plan of a world as somebody drew it: walls only, and not all of them where they stand."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mapgraft.config import Section
from mapgraft_recordings.simulator.world import World

Line = tuple[float, float, float, float]  # x, y of both ends in metres
Box = tuple[float, float, float, float]  # x_min, y_min, x_max, y_max in metres

_MM = 1000.0
_MARGIN_M = 0.5


class Alteration(Section):
    """One thing that is drawn otherwise than it is built; metres in the world's frame.

    ``not drawn``: the walls within a box were built later, or a doorway in them was walled up. ``drawn elsewhere``:
    they are ``by`` (x, y) off in the drawing. ``not built``: a wall along ``line`` that exists in the drawing alone.
    """

    name: str
    what: Literal["not drawn", "drawn elsewhere", "not built"]
    within: Box | None = None
    by: tuple[float, float] = (0.0, 0.0)
    line: Line | None = None

    def model_post_init(self, _context: object) -> None:
        wanted = self.line if self.what == "not built" else self.within
        if wanted is None:
            raise ValueError(f"{self.name!r} needs {'a line' if self.what == 'not built' else 'a box (within)'}")

    @property
    def found_as(self) -> str:
        """What a comparison of the plan with the building should call it."""
        return {"not drawn": "wall added", "drawn elsewhere": "wall displaced", "not built": "wall missing"}[self.what]

    @property
    def bounds_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The lower and upper corner (2,) of where it is: the box, there and where it was drawn, or around the line."""
        ends = np.array(self.line if self.within is None else self.within).reshape(2, 2)
        ends = np.vstack((ends, ends + np.array(self.by)))
        return ends.min(axis=0), ends.max(axis=0)


class DrawnPlan(Section):
    """How the drawing differs from the building: single things, and how much longer than wide it was copied."""

    alterations: list[Alteration] = Field(default_factory=list)
    stretched: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] = (1.0, 1.0)
    thickness_m: Annotated[float, Field(gt=0)] = 0.12


def drawn_lines(world: World, plan: DrawnPlan) -> list[Line]:
    """The middle lines of the walls as drawn, in the world's frame, before the drawing was stretched."""
    lines = [_middle(box) for box in world.walls]
    for change in plan.alterations:
        if change.within is None:
            continue
        kept: list[Line] = []
        for line in lines:
            inside, outside = _cut(line, change.within)
            kept += outside
            if inside is not None and change.what == "drawn elsewhere":
                (dx, dy), (x0, y0, x1, y1) = change.by, inside
                kept.append((x0 + dx, y0 + dy, x1 + dx, y1 + dy))
        lines = kept
    return lines + [change.line for change in plan.alterations if change.line is not None]


def as_svg(world: World, plan: DrawnPlan) -> str:
    """The drawing in millimetres, each wall as an outline; its coordinates are the world's, stretched, y upwards."""
    stretch = np.array(plan.stretched)
    outlines = [_outline(line, plan.thickness_m) * stretch for line in drawn_lines(world, plan)]
    corners = np.vstack(outlines)
    (x0, y0), (x1, y1) = corners.min(axis=0) - _MARGIN_M, corners.max(axis=0) + _MARGIN_M
    left, top, width, height = (round(_MM * value) for value in (x0, -y1, x1 - x0, y1 - y0))
    paths = "\n".join(
        '  <path d="M' + " L".join(f"{round(_MM * x)},{round(-_MM * y)}" for x, y in outline.tolist()) + ' Z"/>'
        for outline in outlines
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="{left} {top} {width} {height}">\n'
        f'<g id="walls" fill="none" stroke="black" stroke-width="20">\n{paths}\n</g>\n</svg>\n'
    )


def _middle(box: NDArray[np.float64]) -> Line:
    """The middle line of a piece of wall."""
    a, b = (box[0] + box[3]) / 2, (box[1] + box[2]) / 2
    return (float(a[0]), float(a[1]), float(b[0]), float(b[1]))


def _outline(line: Line, thickness_m: float) -> NDArray[np.float64]:
    a, b = np.array(line[:2]), np.array(line[2:])
    along = (b - a) / np.linalg.norm(b - a)
    across = np.array([-along[1], along[0]]) * thickness_m / 2
    outline: NDArray[np.float64] = np.array([a - across, b - across, b + across, a + across])
    return outline


def _cut(line: Line, box: Box) -> tuple[Line | None, list[Line]]:
    """The part of a line within a box, or None, and the parts outside (Liang and Barsky, 1984)."""
    a, b = np.array(line[:2]), np.array(line[2:])
    enter, leave = 0.0, 1.0
    for axis in range(2):
        low, high, way = box[axis] - a[axis], box[axis + 2] - a[axis], b[axis] - a[axis]
        if way == 0.0:
            if low > 0.0 or high < 0.0:
                return None, [line]
            continue
        near, far = sorted((low / way, high / way))
        enter, leave = max(enter, near), min(leave, far)
    if enter >= leave:
        return None, [line]

    def part(start: float, end: float) -> Line:
        p, q = a + (b - a) * start, a + (b - a) * end
        return (float(p[0]), float(p[1]), float(q[0]), float(q[1]))

    return part(enter, leave), [part(s, e) for s, e in ((0.0, enter), (leave, 1.0)) if e - s > 1e-6]
