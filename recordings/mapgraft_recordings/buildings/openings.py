"""Where the walls of a floor have doors, and which of them must never be closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mapgraft_recordings.buildings.tiling import Border, Cell
from mapgraft_recordings.buildings.traits import Traits

_POST_M = 0.15  # wall left beside a door
_BESIDE = {  # how likely two rooms side by side have a door between them, beyond those needed to reach every room
    "office": 0.08,
    "corridors": 0.05,
    "castle": 0.65,
    "hall": 0.3,
    "lab": 0.2,
    "apartments": 0.0,
}


@dataclass(frozen=True, slots=True)
class Doorway:
    """An opening in a border, from ``low_m`` to ``high_m`` along it; ``vital`` ones lead to more than one room."""

    border: int
    low_m: float
    high_m: float
    vital: bool
    leaf: bool

    @property
    def middle_m(self) -> float:
        return (self.low_m + self.high_m) / 2


def doorways(cells: Sequence[Cell], walls: Sequence[Border], traits: Traits, rng: np.random.Generator) -> list[Doorway]:
    """Doors so that every space but shafts can be reached, and some more."""
    able = [k for k, wall in enumerate(walls) if _can_open(wall, cells, traits)]
    chosen = _tree(able, cells, walls, rng)
    also = sorted(set(able) - set(chosen))
    beside = _BESIDE[traits.kind]
    for k in also:
        front = cells[walls[k].before].role != "room" or cells[walls[k].after].role != "room"
        chance = 0.35 if front and traits.kind in ("castle", "hall") else 0.06 if front else beside
        if rng.random() < chance:
            chosen[k] = False
    return [_doorway(k, walls[k], vital, traits, rng) for k, vital in sorted(chosen.items())]


def _can_open(wall: Border, cells: Sequence[Cell], traits: Traits) -> bool:
    if wall.before < 0 or wall.after < 0 or wall.length_m < traits.door_m + 2 * _POST_M + traits.wall_m:
        return False
    return "shaft" not in (cells[wall.before].role, cells[wall.after].role)


def _tree(able: list[int], cells: Sequence[Cell], walls: Sequence[Border], rng: np.random.Generator) -> dict[int, bool]:
    """Borders that join all spaces, corridors and halls first; True for those that lead on to further spaces."""
    order = sorted(able, key=lambda k: (_rank(walls[k], cells), -walls[k].length_m * rng.uniform(0.5, 1.0)))
    group = {cell.space: cell.space for cell in cells}
    joined: list[int] = []
    for k in order:
        a, b = (cells[i].space for i in (walls[k].before, walls[k].after))
        if group[a] != group[b]:
            old, new = group[b], group[a]
            group = {space: new if root == old else root for space, root in group.items()}
            joined.append(k)
    ends = [cells[i].space for k in joined for i in (walls[k].before, walls[k].after)]
    return {k: all(ends.count(cells[i].space) > 1 for i in (walls[k].before, walls[k].after)) for k in joined}


def _rank(wall: Border, cells: Sequence[Cell]) -> int:
    """Rooms hang on corridors and halls rather than on each other, wet rooms on anything but each other."""
    a, b = cells[wall.before], cells[wall.after]
    roles = {a.role, b.role}
    if roles == {"corridor", "hall"} or roles == {"hall"}:
        return 0
    if "wet" in roles:
        return 3 if roles != {"wet"} else 5
    if {a.model, b.model} == {4, 6}:
        return 4  # of a flat: its hallway leads to the rooms behind
    return 1 if "room" not in roles or len(roles) > 1 else 2


def _doorway(k: int, wall: Border, vital: bool, traits: Traits, rng: np.random.Generator) -> Doorway:
    width = min(traits.door_m * (1.6 if vital and rng.random() < 0.15 else 1.0), wall.length_m - 2 * _POST_M)
    low, high = wall.low_m + _POST_M + traits.wall_m / 2, wall.high_m - _POST_M - traits.wall_m / 2 - width
    if high < low:
        low = high = (low + high) / 2
    if traits.door_place == "middle":
        start = (low + high) / 2
    elif traits.door_place == "corner":
        start = min(low + 0.25, high)
        if traits.mirrored and rng.random() < 0.5:
            start = max(high - 0.25, low)
    else:
        start = float(rng.uniform(low, high))
    return Doorway(k, start, start + width, vital, bool(rng.random() > traits.door_leafless))
