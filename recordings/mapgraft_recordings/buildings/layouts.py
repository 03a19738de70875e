"""Floors of every kind as rectangles: corridors with rooms along them, bands of rooms, halls, flats."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mapgraft_recordings.buildings.tiling import Cell, Role
from mapgraft_recordings.buildings.traits import Traits

Corners = tuple[float, float, float, float]  # x, y of two opposite corners in metres

_CORRIDOR_SPACE = 0
_NARROWEST_M = 1.8
_LEAST_M2 = 280.0
_TRIES = 20
_ROTUNDA = 0.4
_DEPTH_VARIES = 0.3  # of the share by which rooms vary
_SECTION_M = 9.0
_NARROWEST_HALF_M = 0.6


class Corridor(NamedTuple):
    """A straight corridor along x, or along y where ``upright``, from ``start_m`` to ``end_m``, around ``at_m``."""

    upright: bool
    start_m: float
    end_m: float
    at_m: float
    half_m: float

    @property
    def corners(self) -> Corners:
        near, far = self.at_m - self.half_m, self.at_m + self.half_m
        return (near, self.start_m, far, self.end_m) if self.upright else (self.start_m, near, self.end_m, far)


class Floor:
    """Cells so far, with a new space for every room."""

    def __init__(self, traits: Traits, rng: np.random.Generator) -> None:
        self.cells: list[Cell] = []
        self.traits = traits
        self.rng = rng
        self._spaces = _CORRIDOR_SPACE

    def add(self, corners: Corners, role: Role, space: int | None = None, model: int = 0) -> bool:
        """Add a cell; False, and nothing added, where it would lie over another or be too narrow."""
        x0, y0, x1, y1 = corners
        cell = Cell(min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1), -1, role, model)
        if min(cell.width_m, cell.depth_m) < 0.8 or any(cell.overlaps(other) for other in self.cells):
            return False
        if space is None:
            self._spaces += 1
            space = self._spaces
        self.cells.append(Cell(cell.x0_m, cell.y0_m, cell.x1_m, cell.y1_m, space, role, model))
        return True

    def corridor(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """A corridor cell; where it crosses others it is left out there, so that corridors join."""
        pieces = [Cell(min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1), _CORRIDOR_SPACE, "corridor")]
        for other in list(self.cells):
            pieces = [rest for piece in pieces for rest in _without(piece, other)]
        self.cells += [piece for piece in pieces if min(piece.width_m, piece.depth_m) > 0.05]

    def varied(self, size_m: float) -> float:
        return size_m * (1.0 + self.traits.size_varies * self.rng.uniform(-1.0, 1.0))


def _without(piece: Cell, other: Cell) -> list[Cell]:
    if not piece.overlaps(other):
        return [piece]
    x0, x1 = max(piece.x0_m, other.x0_m), min(piece.x1_m, other.x1_m)
    parts = [
        (piece.x0_m, piece.y0_m, x0, piece.y1_m),
        (x1, piece.y0_m, piece.x1_m, piece.y1_m),
        (x0, piece.y0_m, x1, max(piece.y0_m, other.y0_m)),
        (x0, min(piece.y1_m, other.y1_m), x1, piece.y1_m),
    ]
    made = [Cell(a, b, c, d, piece.space, piece.role) for a, b, c, d in parts]
    return [part for part in made if part.width_m > 1e-6 and part.depth_m > 1e-6]


def _rooms_along(floor: Floor, start: float, end: float, at: float, depth: float, upright: bool, filled: float) -> None:
    """A row of rooms from ``start`` to ``end`` along a line ``at``, reaching ``depth`` (of either sign) from it."""
    traits, rng = floor.traits, floor.rng
    place = start
    while place < end - _NARROWEST_M:
        double = rng.random() < 0.12
        width = min(floor.varied(traits.room_width_m) * (2.0 if double else 1.0), end - place)
        if end - place - width < _NARROWEST_M:
            width = end - place
        if rng.random() < filled:
            wet = not double and rng.random() < 0.06
            across = at + depth * (1.0 + _DEPTH_VARIES * traits.size_varies * float(rng.uniform(-1.0, 1.0)))
            corners = (at, place, across, place + width) if upright else (place, at, place + width, across)
            floor.add(corners, "wet" if wet else "room", model=2 if double else 1)
        place += width


def _lines(rng: np.random.Generator, count: int, spacing: tuple[float, float], alike: bool) -> list[float]:
    steps = rng.uniform(*spacing, size=max(0, count - 1))
    if alike and len(steps):
        steps[:] = steps[0]
    return [0.0, *np.cumsum(steps).tolist()]


def _web(floor: Floor, xs: list[float], ys: list[float], kept: float) -> list[Corridor]:
    """Corridors along lines at ``xs`` and ``ys``, some of their pieces left out but all joined."""
    rng, half = floor.rng, floor.traits.corridor_m / 2
    edges = [((i, j), (i + 1, j)) for j in range(len(ys)) for i in range(len(xs) - 1)]
    edges += [((i, j), (i, j + 1)) for i in range(len(xs)) for j in range(len(ys) - 1)]
    order = rng.permutation(len(edges)).tolist()
    group = {(i, j): (i, j) for i in range(len(xs)) for j in range(len(ys))}
    pieces = []
    for k in order:
        a, b = edges[k]
        joins = group[a] != group[b]
        if joins:
            old, new = group[b], group[a]
            group = {node: new if root == old else root for node, root in group.items()}
        if joins or rng.random() < kept:
            upright = a[0] == b[0]
            ends, at = ((ys[a[1]], ys[b[1]]), xs[a[0]]) if upright else ((xs[a[0]], xs[b[0]]), ys[a[1]])
            pieces += _sections(floor, upright, ends[0] - half, ends[1] + half, at)
    if rng.random() < _ROTUNDA and len(xs) > 1 and len(ys) > 1:
        middle, size = (xs[len(xs) // 2], ys[len(ys) // 2]), half * rng.uniform(1.6, 3.0)
        floor.corridor(middle[0] - size, middle[1] - size, middle[0] + size, middle[1] + size)
    for piece in pieces:
        floor.corridor(*piece.corners)
    return sorted(pieces)


def _sections(floor: Floor, upright: bool, start: float, end: float, at: float) -> list[Corridor]:
    """One corridor, of several widths along its way where the building varies."""
    traits, rng = floor.traits, floor.rng
    most = 1 + int((end - start) / _SECTION_M)
    count = int(rng.integers(1, most + 1)) if traits.size_varies > 0.0 else 1
    cuts = [start, *np.sort(rng.uniform(start, end, count - 1)).tolist(), end]
    found = []
    for low, high in pairwise(cuts):
        wider = 1.0 + traits.size_varies * float(rng.uniform(-0.7, 1.3))
        half = max(traits.corridor_m / 2 * wider, _NARROWEST_HALF_M)
        aside = float(rng.uniform(-0.5, 0.5)) * (half - traits.corridor_m / 2)
        found.append(Corridor(upright, low, high, at + aside, half))
    return found


def _offices(floor: Floor) -> None:
    """Double-loaded corridors: one, a tee, two with cross links, a ring."""
    traits, rng = floor.traits, floor.rng
    shape = str(rng.choice(["one", "ell", "ring", "comb"], p=[0.25, 0.2, 0.35, 0.2]))
    depth, half = traits.room_depth_m, traits.corridor_m / 2
    between = (2 * depth + 2 * half + 0.2, 2 * depth + 2 * half + float(rng.choice([0.3, 6.0])))
    if shape == "one":
        xs, ys, kept = [0.0, rng.uniform(22.0, 70.0)], [0.0], 1.0
    elif shape == "ell":
        xs, ys, kept = [0.0, rng.uniform(15.0, 45.0)], [0.0, rng.uniform(15.0, 30.0)], 0.0
    elif shape == "ring":
        xs, ys, kept = [0.0, rng.uniform(18.0, 45.0)], _lines(rng, 2, between, True), 1.0
    else:
        xs, ys, kept = (
            _lines(rng, 3, (between[0], between[1] + 8.0), rng.random() < 0.5),
            [0.0, rng.uniform(12.0, 28.0)],
            0.4,
        )
    pieces = _web(floor, xs, ys, kept)
    _line_with_rooms(floor, pieces, rng.uniform(0.85, 1.0))


def _line_with_rooms(floor: Floor, pieces: list[Corridor], filled: float) -> None:
    for piece in pieces:
        for side in (-1.0, 1.0):
            depth = side * floor.varied(floor.traits.room_depth_m)
            at = piece.at_m + side * piece.half_m
            _rooms_along(floor, piece.start_m, piece.end_m, at, depth, piece.upright, filled)


def _corridors(floor: Floor) -> None:
    """Long corridors that cross, with alcoves, and few rooms."""
    rng = floor.rng
    alike = rng.random() < 0.5
    columns, rows = int(rng.integers(2, 4)), int(rng.integers(2, 4))
    spacing = (12.0, 32.0)
    pieces = _web(floor, _lines(rng, columns, spacing, alike), _lines(rng, rows, spacing, alike), rng.uniform(0.3, 1.0))
    every, deep, wide = rng.uniform(3.0, 9.0), rng.uniform(0.8, 2.0), rng.uniform(0.9, 2.5)
    shown = rng.uniform(0.1, 0.9)
    for piece in pieces:
        at, half = piece.at_m, piece.half_m
        for place in np.arange(piece.start_m + every / 2, piece.end_m - wide, every).tolist():
            side = float(rng.choice([-1.0, 1.0]))
            if rng.random() < shown:
                a, b = at + side * half, at + side * (half + deep)
                corners = (a, place, b, place + wide) if piece.upright else (place, a, place + wide, b)
                floor.add(corners, "corridor", space=_CORRIDOR_SPACE)
    _line_with_rooms(floor, pieces, rng.uniform(0.0, 0.6))


def _castle(floor: Floor) -> None:
    """Bands of rooms, each room opening into the next; some with a gallery along them or a court between them."""
    traits, rng = floor.traits, floor.rng
    bands, rooms = int(rng.integers(1, 4)), int(rng.integers(5, 12))
    gallery = rng.random() < 0.4
    y = 0.0
    if gallery:
        floor.corridor(0.0, -traits.corridor_m, rooms * traits.room_width_m, 0.0)
    shared = [floor.varied(traits.room_width_m) for _ in range(rooms)]
    for band in range(bands):
        depth = floor.varied(traits.room_depth_m)
        widths = shared if rng.random() < 0.6 else [floor.varied(traits.room_width_m) for _ in range(rooms)]
        x, length = 0.0, rooms * traits.room_width_m
        for k, width in enumerate(widths):
            last = k == len(widths) - 1 or x + width > length - _NARROWEST_M
            end = length if last else x + width
            shaft = 0 < band < bands - 1 and rng.random() < 0.25
            floor.add((x, y, end, y + depth), "shaft" if shaft else "room", model=1)
            x = end
            if last:
                break
        y += depth


def _halls(floor: Floor) -> None:
    """One to three large halls and a row of small rooms."""
    traits, rng = floor.traits, floor.rng
    x, high = 0.0, rng.uniform(12.0, 32.0)
    for _ in range(int(rng.integers(1, 4))):
        width = rng.uniform(12.0, 34.0)
        floor.add((x, 0.0, x + width, high * rng.uniform(0.7, 1.0)), "hall", model=3)
        x += width
    if rng.random() < 0.6:
        floor.corridor(0.0, -traits.corridor_m, x, 0.0)
        _rooms_along(floor, 0.0, x, -traits.corridor_m, -traits.room_depth_m, False, 0.9)
    else:
        _rooms_along(floor, 0.0, x, 0.0, -traits.room_depth_m, False, 0.8)


def _apartments(floor: Floor) -> None:
    """Flats along a stairwell corridor, each cut into a hallway and rooms."""
    traits, rng = floor.traits, floor.rng
    flats = int(rng.integers(2, 6))
    half = traits.corridor_m / 2
    length = flats * traits.room_width_m
    floor.corridor(0.0, -half, length, half)
    cut, seeds = rng.uniform(0.35, 0.6), rng.integers(0, 2**31, 2)
    for k in range(flats):
        for side in (-1.0, 1.0):
            exact = rng.random() < traits.copied
            flat_rng = np.random.default_rng(int(seeds[0])) if exact else rng
            x0, x1 = k * traits.room_width_m, (k + 1) * traits.room_width_m
            _flat(floor, x0, x1, side * half, side * (half + traits.room_depth_m), cut, flat_rng)


def _flat(floor: Floor, x0: float, x1: float, near: float, far: float, cut: float, rng: np.random.Generator) -> None:
    """A hallway behind the flat's door; a wet room and a room beside it, two or three rooms at the far side."""
    hallway = near + (far - near) * (0.3 if rng.random() < 0.5 else 0.4)
    thirds = [x0 + (x1 - x0) * share for share in (0.28, 0.62)]
    floor.add((thirds[0], near, thirds[1], hallway), "room", model=4)
    floor.add((x0, near, thirds[0], hallway), "wet", model=5)
    floor.add((thirds[1], near, x1, hallway), "room", model=6)
    middle = x0 + (x1 - x0) * cut
    floor.add((x0, hallway, middle, far), "room", model=7)
    floor.add((middle, hallway, x1, far), "room", model=8)


_LAYOUTS: dict[str, Callable[[Floor], None]] = {
    "office": _offices,
    "corridors": _corridors,
    "castle": _castle,
    "hall": _halls,
    "lab": _offices,
    "apartments": _apartments,
}


def lay_out(traits: Traits, rng: np.random.Generator) -> list[Cell]:
    """The cells of one floor of the traits' kind."""
    for _ in range(_TRIES):
        floor = Floor(traits, rng)
        _LAYOUTS[traits.kind](floor)
        if sum(cell.width_m * cell.depth_m for cell in floor.cells if cell.role != "shaft") >= _LEAST_M2:
            break
    return floor.cells
