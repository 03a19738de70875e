"""A whole building from a seed: floor, walls, doors, things, and what of it changes between two visits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mapgraft.errors import ConfigError
from mapgraft_recordings.buildings.furnishing import furnish
from mapgraft_recordings.buildings.layouts import lay_out
from mapgraft_recordings.buildings.openings import Doorway, doorways
from mapgraft_recordings.buildings.shapes import Bend, Outline, Segments, bend, box, disc, edges, turned
from mapgraft_recordings.buildings.tiling import Border, Cell, borders
from mapgraft_recordings.buildings.traits import KINDS, Traits, draw_traits
from mapgraft_recordings.buildings.walls import Leaf, shell
from mapgraft_recordings.simulator.raycast import distance_to_walls

_SALT = 0xB17D
_BENT = {"office": 0.3, "corridors": 0.25, "castle": 0.3, "hall": 0.2, "lab": 0.6, "apartments": 0.15}
_DOOR_CLEAR_M = 0.75
_MOVED_M = 0.8
_NARROW_M = 1.0  # narrower cells hold nothing


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """What stands in a building, in the building's frame.

    ``solid`` (m, 4) segments that always stand; ``glass`` (m, 4) panes; ``leaves`` doors, still in the drawn frame of
    ``bend``; ``loose`` things that people move; ``rooms`` the outlines of the spaces one can enter, with their roles.
    ``walls`` are the outlines among ``solid`` that an architect draws.
    """

    seed: int
    kind: str
    traits: Traits
    solid: Segments
    glass: Segments
    leaves: tuple[Leaf, ...]
    loose: tuple[Outline, ...]
    rooms: tuple[tuple[str, Outline], ...]
    bend: Bend
    walls: tuple[Outline, ...] = ()


def building(seed: int, kind: str | None = None) -> Building:
    """The building of a seed, of a kind in ``KINDS`` or else of one by the seed; raises ConfigError for other kinds."""
    if kind is not None and kind not in KINDS:
        raise ConfigError(f"there is no building kind {kind!r}; there are {', '.join(KINDS)}")
    chosen = KINDS[seed % len(KINDS)] if kind is None else kind
    rng = np.random.default_rng(np.random.SeedSequence([seed, KINDS.index(chosen), _SALT]))
    traits = draw_traits(chosen, rng)
    cells = lay_out(traits, rng)
    walls = borders(cells)
    doors = doorways(cells, walls, traits, rng)
    copies = _copies(cells, traits, rng)
    made = shell(cells, walls, doors, traits, copies, rng)
    fixed, loose = _things(cells, walls, doors, traits, copies, rng)
    bent = _bend(cells, traits, rng)
    outdoors = _outdoors(cells, rng) if traits.glass_outside > 0.0 else []
    return Building(
        seed,
        chosen,
        traits,
        edges(bent.outline(outline) for outline in (*made.solid, *fixed, *outdoors)),
        edges(bent.outline(outline) for outline in made.glass),
        tuple(made.leaves),
        tuple(bent.outline(outline) for outline in loose),
        tuple((cell.role, bent.outline(_outline(cell))) for cell in cells if cell.role != "shaft"),
        bent,
        tuple(bent.outline(outline) for outline in made.solid),
    )


def _outline(cell: Cell) -> Outline:
    return box(*cell.middle, cell.width_m, cell.depth_m)


def _copies(cells: Sequence[Cell], traits: Traits, rng: np.random.Generator) -> list[int]:
    """A seed per cell: equal for exact copies of one model."""
    models = rng.integers(0, 2**31, 10).tolist()
    found = []
    for cell in cells:
        own = int(rng.integers(2**31))
        found.append(models[cell.model] if cell.model and rng.random() < traits.copied else own)
    return found


def _things(
    cells: Sequence[Cell],
    walls: Sequence[Border],
    doors: Sequence[Doorway],
    traits: Traits,
    copies: Sequence[int],
    rng: np.random.Generator,
) -> tuple[list[Outline], list[Outline]]:
    """Everything that stands in the rooms, kept away from the doors; the first door's wall is a room's front."""
    of_cell: dict[int, list[tuple[Border, float]]] = {}
    for door in doors:
        wall = walls[door.border]
        for i in (wall.before, wall.after):
            of_cell.setdefault(i, []).append((wall, door.middle_m))
    ways = np.array([wall.point(middle) for found in of_cell.values() for wall, middle in found]).reshape(-1, 2)
    fixed: list[Outline] = []
    loose: list[Outline] = []
    for i, cell in enumerate(cells):
        if cell.role == "shaft" or min(cell.width_m, cell.depth_m) < _NARROW_M:
            continue
        front = _front(i, of_cell.get(i, []))
        inset = min(traits.wall_m / 2, 0.2 * min(cell.width_m, cell.depth_m))
        size = (cell.width_m - 2 * inset, cell.depth_m - 2 * inset)
        size = size if front % 2 == 0 else (size[1], size[0])
        mirror = traits.mirrored and rng.random() < 0.5
        inside = furnish(traits, cell.role, size, np.random.default_rng(copies[i]))
        for kept, things in zip((fixed, loose), inside, strict=True):
            placed = [_placed(thing, cell, front, size, mirror) for thing in things]
            kept += [thing for thing in placed if _clear(thing, ways, cell)]
    return fixed, loose


def _front(i: int, found: list[tuple[Border, float]]) -> int:
    """Which side of a cell its first door is in: 0 south, 1 east, 2 north, 3 west."""
    if not found:
        return 0
    wall = found[0][0]
    if wall.upright:
        return 3 if wall.after == i else 1
    return 0 if wall.after == i else 2


def _placed(thing: Outline, cell: Cell, front: int, size: tuple[float, float], mirror: bool) -> Outline:
    centred = thing - (size[0] / 2, size[1] / 2)
    if mirror:
        centred = centred[::-1] * (-1.0, 1.0)
    return turned(centred, front * math.pi / 2) + cell.middle


def _clear(thing: Outline, ways: np.ndarray, cell: Cell) -> bool:
    low, high = thing.min(axis=0), thing.max(axis=0)
    if low[0] < cell.x0_m or low[1] < cell.y0_m or high[0] > cell.x1_m or high[1] > cell.y1_m:
        return False
    if not len(ways):
        return True
    away = np.maximum(np.maximum(low - ways, ways - high), 0.0)
    return bool(np.hypot(*away.T).min() > _DOOR_CLEAR_M)


def _bend(cells: Sequence[Cell], traits: Traits, rng: np.random.Generator) -> Bend:
    """A floor as drawn, or curved along some of its length, with a kink, or with its rooms oblique."""
    low, high = min(cell.x0_m for cell in cells), max(cell.x1_m for cell in cells)
    reach = max(max(abs(cell.y0_m), abs(cell.y1_m)) for cell in cells)
    yaw = float(rng.uniform(-math.pi, math.pi))
    curves: list[tuple[float, float, float]] = []
    lean = 0.0
    if rng.random() < _BENT[traits.kind]:
        tightest = 0.6 / max(reach, 4.0)
        for _ in range(int(rng.integers(1, 3))):
            start = float(rng.uniform(low, high))
            length = float(rng.choice([rng.uniform(2.0, 4.0), rng.uniform(6.0, high - low + 6.0)]))
            strength = float(rng.uniform(0.3, 1.0) * tightest * rng.choice([-1.0, 1.0])) / 2
            curves.append((start, start + length, strength))
        if rng.random() < 0.3:
            lean = float(rng.uniform(-0.35, 0.35))
    return bend(curves, (low - abs(lean) * reach, high + abs(lean) * reach), yaw, lean)


def _outdoors(cells: Sequence[Cell], rng: np.random.Generator) -> list[Outline]:
    """Trees, cars and the wall of another house, seen through glass."""
    low_x, high_x = min(cell.x0_m for cell in cells), max(cell.x1_m for cell in cells)
    low_y, high_y = min(cell.y0_m for cell in cells), max(cell.y1_m for cell in cells)
    found = []
    for _ in range(int(rng.integers(5, 60))):
        x, y = float(rng.uniform(low_x - 15.0, high_x + 15.0)), float(rng.uniform(low_y - 15.0, high_y + 15.0))
        if any(c.x0_m - 1.5 < x < c.x1_m + 1.5 and c.y0_m - 1.5 < y < c.y1_m + 1.5 for c in cells):
            continue
        found.append(disc(x, y, float(rng.uniform(0.08, 0.5))) if rng.random() < 0.7 else box(x, y, 1.2, 0.8, x))
    if rng.random() < 0.4:
        found.append(box((low_x + high_x) / 2, high_y + float(rng.uniform(6.0, 16.0)), 0.8 * (high_x - low_x), 4.0))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Visit:
    """How a building stands during one part of a drive: how far each leaf is open, where the loose things are."""

    opened_rad: tuple[float, ...]
    loose: tuple[Outline, ...]


def first_visit(building: Building, rng: np.random.Generator) -> Visit:
    """Doors as the building's habits have them, things in their places."""
    return Visit(tuple(_opened(leaf, building.traits, rng) for leaf in building.leaves), building.loose)


def next_visit(building: Building, before: Visit, share: float, rng: np.random.Generator) -> Visit:
    """Some doors opened or closed, some things moved by up to a step."""
    opened = tuple(
        _opened(leaf, building.traits, rng) if rng.random() < share else was
        for leaf, was in zip(building.leaves, before.opened_rad, strict=True)
    )
    loose = []
    for thing in before.loose:
        moved = thing
        if rng.random() < share:
            middle = thing.mean(axis=0)
            moved = turned(thing - middle, float(rng.uniform(-1.0, 1.0))) + middle + rng.normal(0.0, _MOVED_M / 2, 2)
            if distance_to_walls(moved.mean(axis=0)[None], building.solid)[0] < 0.3:
                moved = thing
        loose.append(moved)
    return Visit(opened, tuple(loose))


def _opened(leaf: Leaf, traits: Traits, rng: np.random.Generator) -> float:
    draw = rng.random()
    if draw < traits.door_closed and not leaf.vital:
        return 0.0
    if draw < traits.door_closed + (1.0 - traits.door_closed) * traits.door_ajar and not leaf.vital:
        return float(rng.uniform(0.2, 1.2))
    return float(rng.uniform(1.3, 2.0))


def standing(building: Building, visit: Visit) -> Segments:
    """All opaque segments (m, 4) during one visit."""
    leaves = [building.bend.outline(leaf.outline(a)) for leaf, a in zip(building.leaves, visit.opened_rad, strict=True)]
    return np.vstack((building.solid, edges((*leaves, *visit.loose))))
