"""Walls along borders: thick pieces between openings, with niches, pilasters and radiators on their faces."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mapgraft_recordings.buildings.openings import Doorway
from mapgraft_recordings.buildings.shapes import Outline, box
from mapgraft_recordings.buildings.tiling import Border, Cell
from mapgraft_recordings.buildings.traits import Traits

_FRAME_M = 0.09  # width of a door frame on the wall
_FACE_STEP_M = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Leaf:
    """A door leaf in the drawn frame: hinged at ``hinge``; closed it lies along ``along``, and it opens to ``into``."""

    hinge: tuple[float, float]
    along: tuple[float, float]
    into: tuple[float, float]
    width_m: float
    vital: bool

    def outline(self, opened_rad: float, thickness_m: float = 0.045) -> Outline:
        """The leaf turned open by an angle."""
        c, s = math.cos(opened_rad), math.sin(opened_rad)
        direction = (c * self.along[0] + s * self.into[0], c * self.along[1] + s * self.into[1])
        middle = (self.hinge[0] + direction[0] * self.width_m / 2, self.hinge[1] + direction[1] * self.width_m / 2)
        return box(*middle, self.width_m, thickness_m, math.atan2(direction[1], direction[0]))


@dataclass(slots=True)
class Shell:
    """What stands where walls run, in the drawn frame: opaque outlines, glass panes, door leaves."""

    solid: list[Outline]
    glass: list[Outline]
    leaves: list[Leaf]


def shell(
    cells: Sequence[Cell],
    walls: Sequence[Border],
    doors: Sequence[Doorway],
    traits: Traits,
    copies: Sequence[int],
    rng: np.random.Generator,
) -> Shell:
    """The walls of a floor. ``copies`` (one per cell) are equal for rooms whose walls shall be exactly alike."""
    made = Shell([], [], [])
    by_border: dict[int, list[Doorway]] = {}
    for door in doors:
        by_border.setdefault(door.border, []).append(door)
    for k, wall in enumerate(walls):
        inside = [i for i in (wall.before, wall.after) if i >= 0]
        seed = [copies[i] for i in inside] + [round(wall.length_m * 100), int(len(inside) == 1)]
        own = np.random.default_rng(zlib.crc32(repr(seed).encode()) if traits.regular_relief else rng.integers(2**31))
        _build(made, wall, by_border.get(k, []), cells, traits, own)
    return made


def _build(
    made: Shell, wall: Border, doors: list[Doorway], cells: Sequence[Cell], traits: Traits, rng: np.random.Generator
) -> None:
    outside = wall.before < 0 or wall.after < 0
    thickness = (traits.outer_wall_m if outside else traits.wall_m) * (1.0 + traits.uneven * rng.uniform(0.0, 1.0))
    wall = replace(wall, at_m=wall.at_m + 0.3 * traits.uneven * thickness * rng.uniform(-1.0, 1.0))
    if rng.random() < traits.columns:
        made.solid.append(_across(wall, wall.low_m, *(thickness + rng.uniform(0.06, 0.4, 2)).tolist()))
    start = wall.low_m - thickness / 2
    for door in sorted(doors, key=lambda door: door.low_m):
        end = _sidelight(made, wall, start, door.low_m, thickness, traits, rng)
        _piece(made, wall, start, end, thickness, traits, rng)
        start = door.high_m
        if door.leaf:
            made.leaves.append(_leaf(wall, door, cells, thickness, rng))
        if rng.random() < 0.6:
            depth = thickness + 2 * rng.uniform(0.02, 0.05)
            made.solid += [_across(wall, at, _FRAME_M, depth) for at in (door.low_m - 0.05, door.high_m + 0.05)]
    _piece(made, wall, start, wall.high_m + thickness / 2, thickness, traits, rng)


def _leaf(wall: Border, door: Doorway, cells: Sequence[Cell], thickness: float, rng: np.random.Generator) -> Leaf:
    """A leaf that opens into the room, away from the corridor, flush with the room's side of the wall."""
    towards_after = cells[wall.after].role in ("room", "wet")
    if cells[wall.before].role in ("room", "wet") and towards_after:
        towards_after = bool(rng.random() < 0.5)
    sign = 1.0 if towards_after else -1.0
    low_hinge = bool(rng.random() < 0.5)
    at, direction = (door.low_m, 1.0) if low_hinge else (door.high_m, -1.0)
    along, into = ((0.0, direction), (sign, 0.0)) if wall.upright else ((direction, 0.0), (0.0, sign))
    x, y = wall.point(at)
    flush = thickness / 2 - 0.03
    hinge = (x + into[0] * flush, y + into[1] * flush)
    return Leaf(hinge, along, into, door.high_m - door.low_m, door.vital)


def _across(wall: Border, along_m: float, length_m: float, depth_m: float) -> Outline:
    x, y = wall.point(along_m)
    return box(x, y, depth_m, length_m) if wall.upright else box(x, y, length_m, depth_m)


def _sidelight(
    made: Shell, wall: Border, start: float, end: float, thickness: float, traits: Traits, rng: np.random.Generator
) -> float:
    """Maybe a narrow pane between the wall from ``start`` and the door at ``end``; where the wall then ends."""
    width = float(rng.uniform(0.1, 0.5))
    if rng.random() >= traits.sidelights or end - start < width + 0.5:
        return end
    made.solid.append(_across(wall, end - 0.04, 0.08, thickness))
    made.glass.append(_across(wall, end - 0.08 - width / 2, width, 0.02))
    return end - 0.08 - width


def _piece(
    made: Shell, wall: Border, start: float, end: float, thickness: float, traits: Traits, rng: np.random.Generator
) -> None:
    """One piece of wall, or of glass between two posts."""
    length = end - start
    if length <= 0.01:
        return
    outside = wall.before < 0 or wall.after < 0
    share = traits.glass_outside if outside else traits.glass_inside
    if length > 1.2 and rng.random() < share:
        post = rng.uniform(0.15, min(0.5, length / 3))
        made.solid += [_across(wall, start + post / 2, post, thickness), _across(wall, end - post / 2, post, thickness)]
        made.glass.append(_across(wall, (start + end) / 2, length - 2 * post, 0.02))
        return
    faces = [_face(length, thickness, traits, rng) for _ in range(2)]
    upper = faces[0] + (start, 0.0)
    lower = faces[1][::-1] * (1.0, -1.0) + (start, 0.0)
    outline = np.vstack((lower[::-1], upper[::-1]))
    made.solid.append(
        np.stack((wall.at_m + outline[:, 1], outline[:, 0]), axis=1)
        if wall.upright
        else outline + np.array((0.0, wall.at_m))
    )


def _face(length: float, thickness: float, traits: Traits, rng: np.random.Generator) -> Outline:
    """One face of a wall, a line from (0, h) to (length, h) with niches, pilasters and radiators, maybe crooked."""
    half = thickness / 2
    points = [(0.0, half)]
    place = rng.uniform(0.2, 1.5)
    while place < length - 0.6 and traits.relief > 0.02:
        width = min(rng.uniform(0.1, 0.4) if rng.random() < 0.6 else rng.uniform(0.6, 1.6), length - 0.3 - place)
        depth = traits.relief_m * rng.uniform(0.5, 1.3)
        depth = half + (depth if rng.random() < 0.65 else -min(depth, 0.8 * half))
        points += [(place, half), (place, depth), (place + width, depth), (place + width, half)]
        place += width + float(rng.exponential(1.0 / traits.relief))
    points.append((length, half))
    if traits.crooked_m == 0.0:
        return np.array(points)
    return _crooked(np.array(points), traits.crooked_m, rng)


def _crooked(points: Outline, sigma_m: float, rng: np.random.Generator) -> Outline:
    line = [points[:1]]
    for a, b in pairwise(points):
        count = max(1, math.ceil((b[0] - a[0]) / _FACE_STEP_M))
        line.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    face = np.vstack(line)
    face[1:-1, 1] += rng.normal(0.0, sigma_m, len(face) - 2)
    return face
