"""A floor plan as data: walls with doors, furniture and repeated parts, flattened to line segments.

The file is YAML that a person can draw from::

    name: two rooms
    parts:
      room:
        walls:
          - line: [[0, 0], [4, 0], [4, 5], [0, 5], [0, 0]]
            doors: [{at_m: 2.0, width_m: 1.0}]     # measured along the line
        furniture:
          - {name: bed, box: [0.2, 2.5, 2.0, 1.0]}  # x, y of the corner, length, width
    floor:
      parts:
        - {part: room, at: [0, 0, 0]}               # x, y in metres, yaw in degrees
        - {part: room, at: [8, 5, 180]}
      clutter:
        - {name: stool, size: [0.4, 0.4], within: [0.5, 0.5, 2, 2], count: 2}

Clutter is small furniture whose place and heading vary with the seed; everything else stays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from mapgraft.config import Section, path_of, read_mapping, text_of
from mapgraft.errors import ConfigError
from mapgraft_recordings.simulator.raycast import Segments

Point = tuple[Annotated[float, Field(allow_inf_nan=False)], Annotated[float, Field(allow_inf_nan=False)]]
Placement = tuple[float, float, float]
Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Polygon = NDArray[np.float64]  # (k, 2) corners in metres, closed by the edge from the last to the first
Plan = TypeVar("Plan", bound=Section)

_TRIES = 100


class Thing(NamedTuple):
    """What stands on the floor up to ``top_m``."""

    polygon: Polygon
    top_m: float


class Door(Section):
    """An open doorway, ``at_m`` along the wall's line to its middle."""

    at_m: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    width_m: Length = 1.0


class Wall(Section):
    """A wall along a polyline, as thick as it says, with its doorways left open."""

    line: Annotated[list[Point], Field(min_length=2)]
    doors: list[Door] = Field(default_factory=list)
    thickness_m: Length = 0.12


class Furniture(Section):
    """A thing that a lidar sees: a polygon, or a box with its corner at x, y, turned about that corner."""

    name: str
    polygon: Annotated[list[Point], Field(min_length=3)] | None = None
    box: tuple[float, float, Length, Length] | None = None
    yaw_deg: float = 0.0
    height_m: Length = 0.9

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.polygon is None) == (self.box is None):
            raise ValueError("furniture needs either a polygon or a box")
        return self


class Clutter(Section):
    """Small boxes somewhere inside ``within`` (x_min, y_min, x_max, y_max), new for every seed."""

    name: str
    size: tuple[Length, Length]
    within: tuple[float, float, float, float]
    height_m: Length = 0.9
    count: Annotated[int, Field(ge=1)] = 1


class PlacedPart(Section):
    part: str
    at: Placement = (0.0, 0.0, 0.0)


class Part(Section):
    """A piece of floor in its own frame, made of walls, furniture, clutter and other parts."""

    walls: list[Wall] = Field(default_factory=list)
    furniture: list[Furniture] = Field(default_factory=list)
    clutter: list[Clutter] = Field(default_factory=list)
    parts: list[PlacedPart] = Field(default_factory=list)


class FloorPlan(Section):
    """A whole floor plan file."""

    name: str
    ceiling_m: Length = 2.8
    parts: dict[str, Part] = Field(default_factory=dict)
    floor: Part


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """What lidars see: ``segments`` (m, 4) float64 metres, read-only, and the polygons they bound; world frame.

    ``tops_m`` tells how high each polygon reaches from the floor, infinity being a wall's.
    """

    name: str
    polygons: tuple[Polygon, ...]
    segments: Segments
    tops_m: tuple[float, ...]
    ceiling_m: float

    @property
    def walls(self) -> tuple[Polygon, ...]:
        """Pieces of straight wall: boxes whose edges from the first corner to the second run along the wall."""
        return tuple(p for p, top in zip(self.polygons, self.tops_m, strict=True) if math.isinf(top))

    @property
    def segment_tops_m(self) -> NDArray[np.float64]:
        """How high each segment (m,) reaches, at most to the ceiling."""
        return np.repeat(np.minimum(self.tops_m, self.ceiling_m), [len(polygon) for polygon in self.polygons])


def load_plan(path: Path) -> FloorPlan:
    """Read a floor plan file; raises ConfigError with all its faults."""
    return parse_plan(read_mapping(path), origin=str(path))


def parse_plan(given: Mapping[str, Any], origin: str = "the floor plan") -> FloorPlan:
    """Check a floor plan; raises ConfigError with all its faults, each with its path."""
    return checked(FloorPlan, given, origin)


def checked(kind: type[Plan], given: Mapping[str, Any], origin: str) -> Plan:
    """A mapping as a plan of the given kind; raises ConfigError with all its faults, each with its path."""
    try:
        return kind.model_validate(given)
    except ValidationError as error:
        faults = [f"  {path_of(fault['loc'])}: {text_of(fault)}" for fault in error.errors()]
        raise ConfigError(f"{origin} has {len(faults)} fault(s):\n" + "\n".join(faults)) from None


def build_world(plan: FloorPlan, seed: int, keep_clear: NDArray[np.float64] | None = None) -> World:
    """Flatten a plan to segments; ``seed`` places the clutter.

    ``keep_clear`` (n, 2) metres, in the floor's frame: points, such as the robots' ways, from which clutter stays at
    least half a metre away. Raises ConfigError when a part is unknown or holds itself, a door does not fit into its
    wall, or there is no room for the clutter.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 0xC1077E]))
    clear = np.empty((0, 2)) if keep_clear is None else keep_clear
    things: list[Thing] = []
    _flatten(plan, plan.floor, np.eye(3), (), rng, clear, things)
    polygons = tuple(thing.polygon for thing in things)
    if not polygons:
        raise ConfigError(f"the floor plan {plan.name!r} has neither walls nor furniture: a lidar would see nothing")
    edges = [np.hstack((polygon, np.roll(polygon, -1, axis=0))) for polygon in polygons]
    segments = np.ascontiguousarray(np.vstack(edges))
    segments.setflags(write=False)
    return World(plan.name, polygons, segments, tuple(thing.top_m for thing in things), plan.ceiling_m)


def _flatten(
    plan: FloorPlan,
    part: Part,
    T_floor_part: NDArray[np.float64],
    inside: tuple[str, ...],
    rng: np.random.Generator,
    clear: NDArray[np.float64],
    things: list[Thing],
) -> None:
    here = [Thing(box, math.inf) for wall in part.walls for box in _wall_boxes(wall, plan.name)]
    here += [Thing(_outline(piece), piece.height_m) for piece in part.furniture]
    things += [Thing(_moved(T_floor_part, thing.polygon), thing.top_m) for thing in here]
    for clutter in part.clutter:
        strewn = [_strewn(clutter, T_floor_part, rng, clear) for _ in range(clutter.count)]
        things += [Thing(polygon, clutter.height_m) for polygon in strewn]
    for placed in part.parts:
        if placed.part not in plan.parts:
            known = ", ".join(sorted(plan.parts)) or "none"
            raise ConfigError(
                f"{plan.name!r} places a part {placed.part!r} that it does not define; it defines {known}"
            )
        if placed.part in inside:
            raise ConfigError(f"the part {placed.part!r} of {plan.name!r} holds itself: take it out of its own parts")
        T_floor_placed = T_floor_part @ _planar(*placed.at)
        _flatten(plan, plan.parts[placed.part], T_floor_placed, (*inside, placed.part), rng, clear, things)


def _wall_boxes(wall: Wall, plan: str) -> list[Polygon]:
    boxes: list[Polygon] = []
    done_m = 0.0
    corners = np.array(wall.line)
    length_m = float(np.linalg.norm(np.diff(corners, axis=0), axis=1).sum())
    for door in wall.doors:
        if door.at_m - door.width_m / 2 < 0 or door.at_m + door.width_m / 2 > length_m:
            raise ConfigError(f"a door of {plan!r} at {door.at_m} m does not fit into its wall of {length_m:.2f} m")
    for a, b in pairwise(corners):
        run_m = float(np.linalg.norm(b - a))
        if run_m == 0.0:
            raise ConfigError(f"a wall of {plan!r} has the corner {a.tolist()} twice in a row: remove one")
        for start_m, end_m, closed in _solid_runs(wall.doors, done_m, run_m):
            boxes.append(_box_along(a, (b - a) / run_m, start_m, end_m, wall.thickness_m / 2, closed))
        done_m += run_m
    return boxes


def _solid_runs(doors: list[Door], offset_m: float, run_m: float) -> list[tuple[float, float, tuple[bool, bool]]]:
    """The parts of one straight wall between its doors, as (from, to) along it, and which of its ends are wall ends."""
    gaps = sorted((d.at_m - offset_m - d.width_m / 2, d.at_m - offset_m + d.width_m / 2) for d in doors)
    runs = []
    start_m, at_corner = 0.0, True
    for low_m, high_m in gaps:
        if high_m <= 0.0 or low_m >= run_m:
            continue
        if low_m > start_m:
            runs.append((start_m, low_m, (at_corner, False)))
        start_m, at_corner = high_m, False
    if start_m < run_m:
        runs.append((start_m, run_m, (at_corner, True)))
    return runs


def _box_along(
    origin: NDArray[np.float64],
    along: NDArray[np.float64],
    start_m: float,
    end_m: float,
    half_m: float,
    closed: tuple[bool, bool],
) -> Polygon:
    """A wall piece as a box; ends at corners reach half a thickness further, so that corners are filled."""
    a = origin + along * (start_m - half_m * closed[0])
    b = origin + along * (end_m + half_m * closed[1])
    across = np.array([-along[1], along[0]]) * half_m
    return np.array([a - across, b - across, b + across, a + across])


def _outline(thing: Furniture) -> Polygon:
    if thing.polygon is not None:
        return np.array(thing.polygon)
    assert thing.box is not None
    x, y, length, width = thing.box
    return _moved(_planar(x, y, thing.yaw_deg), np.array([[0, 0], [length, 0], [length, width], [0, width]]))


def _strewn(
    clutter: Clutter, T_floor_part: NDArray[np.float64], rng: np.random.Generator, clear: NDArray[np.float64]
) -> Polygon:
    length, width = clutter.size
    corners = np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2
    x_min, y_min, x_max, y_max = clutter.within
    for _ in range(_TRIES):
        at = _planar(rng.uniform(x_min, x_max), rng.uniform(y_min, y_max), rng.uniform(0.0, 360.0))
        box = _moved(T_floor_part @ at, corners)
        reach_m = 0.5 + math.hypot(length, width) / 2
        if not len(clear) or np.linalg.norm(clear - box.mean(axis=0), axis=1).min() > reach_m:
            return box
    raise ConfigError(f"there is no room for {clutter.name!r} within {clutter.within} away from the robots' ways")


def _planar(x_m: float, y_m: float, yaw_deg: float) -> NDArray[np.float64]:
    yaw = math.radians(yaw_deg)
    c, s = round(math.cos(yaw), 15), round(math.sin(yaw), 15)  # quarter turns stay exact
    return np.array([[c, -s, x_m], [s, c, y_m], [0.0, 0.0, 1.0]])


def _moved(T: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    moved: NDArray[np.float64] = points @ T[:2, :2].T + T[:2, 2]
    return moved
