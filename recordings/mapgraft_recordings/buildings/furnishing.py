"""What stands in rooms: desks, chairs, shelves, beds, pillars, boxes, as outlines a low lidar sees."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mapgraft_recordings.buildings.shapes import Outline, box, disc
from mapgraft_recordings.buildings.traits import Traits

Things = tuple[list[Outline], list[Outline]]  # what stays, and what people move


class Room:
    """A room to furnish in its own frame: its front wall, with the door, along x from 0 to ``width_m``; y leads in."""

    def __init__(self, width_m: float, depth_m: float, clutter: float, rng: np.random.Generator) -> None:
        self.width_m, self.depth_m, self.clutter, self.rng = width_m, depth_m, clutter, rng
        self.fixed: list[Outline] = []
        self.loose: list[Outline] = []

    def against_wall(self, length_m: float, width_m: float, side: int) -> Outline:
        """A box with its long side along one of the walls: 0 left, 1 far, 2 right, 3 front."""
        gap = width_m / 2 + float(self.rng.uniform(0.0, 0.06))
        run = self.depth_m if side in (0, 2) else self.width_m
        along = float(self.rng.uniform(length_m / 2, max(run - length_m / 2, length_m / 2)))
        if side in (0, 2):
            return box(gap if side == 0 else self.width_m - gap, along, width_m, length_m)
        return box(along, self.depth_m - gap if side == 1 else gap, length_m, width_m)

    def cut_corner(self) -> None:
        """A far corner of the room walled off: by an oblique wall or a round one."""
        most = min(2.5, self.width_m / 2, self.depth_m / 2)
        along, into = self.rng.uniform(min(0.4, most), most, 2).tolist()
        if self.rng.random() < 0.5:
            into = along
        bulge = float(self.rng.choice([0.0, self.rng.uniform(-0.4, 0.6)]))
        share = np.linspace(0.0, 1.0, 2 if bulge == 0.0 else 7)
        depth = 1.0 + bulge * 4.0 * share * (1.0 - share)
        wall = np.stack((along * (1.0 - share) * depth, into * share * depth), axis=1)
        corner = np.vstack((wall, np.zeros((1, 2))))
        outline = np.array((0.0, self.depth_m)) + corner * (1.0, -1.0)
        self.fixed.append(outline if self.rng.random() < 0.5 else np.array((self.width_m, 0.0)) + outline * (-1.0, 1.0))

    def somewhere(self, margin_m: float = 0.5) -> tuple[float, float]:
        low = min(margin_m, self.width_m / 3, self.depth_m / 3)
        return (
            float(self.rng.uniform(low, self.width_m - low)),
            float(self.rng.uniform(low, self.depth_m - low)),
        )

    def count(self, per_ten_m2: float, most: int = 40) -> int:
        return min(int(self.rng.poisson(per_ten_m2 * self.clutter * self.width_m * self.depth_m / 10.0)), most)


def legs(x: float, y: float, length: float, width: float, yaw: float, radius: float = 0.025) -> list[Outline]:
    """The four legs of a table."""
    corners = box(x, y, length - 4 * radius, width - 4 * radius, yaw)
    return [disc(cx, cy, radius, 4) for cx, cy in corners.tolist()]


def _chair(room: Room, x: float, y: float) -> None:
    style, yaw = room.rng.random(), float(room.rng.uniform(0.0, math.pi))
    if style < 0.4:
        room.loose += legs(x, y, 0.45, 0.45, yaw, 0.02)
    elif style < 0.75:
        room.loose.append(disc(x, y, 0.05, 5))
        room.loose += [
            disc(x + 0.28 * math.cos(a), y + 0.28 * math.sin(a), 0.03, 4) for a in yaw + 1.2566 * np.arange(5)
        ]
    else:
        room.loose.append(box(x, y, 0.45, 0.42, yaw))


def _desk(room: Room) -> None:
    length, width = float(room.rng.uniform(1.2, 1.8)), float(room.rng.uniform(0.65, 0.85))
    desk = room.against_wall(length, width, int(room.rng.integers(0, 3)))
    (x0, y0), (x1, y1) = desk.min(axis=0), desk.max(axis=0)
    if room.rng.random() < 0.35:
        room.fixed.append(desk)
    else:
        room.fixed += [disc(cx, cy, 0.03, 4) for cx, cy in (desk * 0.94 + desk.mean(axis=0) * 0.06).tolist()]
        if room.rng.random() < 0.7:
            room.fixed.append(box(x0 + 0.25, y0 + 0.3, 0.42, 0.55))
    middle = np.array([room.width_m / 2, room.depth_m / 2]) - ((x0 + x1) / 2, (y0 + y1) / 2)
    away = middle / (np.hypot(*middle) + 1e-9) * 0.7
    _chair(room, (x0 + x1) / 2 + away[0], (y0 + y1) / 2 + away[1])


def _cabinets(room: Room, per_ten_m2: float) -> None:
    for _ in range(room.count(per_ten_m2, 8)):
        side = int(room.rng.integers(0, 4))
        room.fixed.append(room.against_wall(float(room.rng.uniform(0.6, 2.4)), float(room.rng.uniform(0.3, 0.6)), side))


def _boxes(room: Room, per_ten_m2: float) -> None:
    for _ in range(room.count(per_ten_m2)):
        x, y = room.somewhere(0.3)
        size = room.rng.uniform(0.08, 0.55, 2)
        if room.rng.random() < 0.3:
            room.loose.append(disc(x, y, float(size[0]) / 2))
        else:
            room.loose.append(box(x, y, float(size[0]), float(size[1]), float(room.rng.uniform(0.0, math.pi))))


def _meeting(room: Room) -> None:
    length, width = max(0.8, room.width_m - 2.6), max(0.8, min(1.6, room.depth_m - 2.6))
    x, y = room.width_m / 2, room.depth_m / 2
    room.fixed += legs(x, y, length, width, 0.0, 0.04)
    for side in (-1.0, 1.0):
        for place in np.arange(x - length / 2 + 0.4, x + length / 2, 0.8).tolist():
            if room.rng.random() < 0.85:
                _chair(room, place + float(room.rng.normal(0, 0.08)), y + side * (width / 2 + 0.3))


def _shelves(room: Room) -> None:
    deep, gap = float(room.rng.uniform(0.4, 1.0)), float(room.rng.uniform(1.1, 2.6))
    start = 1.2
    for y in np.arange(start + deep / 2, room.depth_m - 0.8, deep + gap).tolist():
        x = float(room.rng.uniform(1.0, 1.8))
        while x < room.width_m - 2.2:
            length = min(float(room.rng.uniform(2.0, 12.0)), room.width_m - 1.2 - x)
            if room.rng.random() < 0.9:
                room.fixed.append(box(x + length / 2, y, length, deep * float(room.rng.uniform(0.7, 1.0))))
            x += length + float(room.rng.choice([0.0, 1.3]))


def _office(room: Room) -> None:
    for _ in range(max(1, int(room.width_m * room.depth_m / 9.0 * room.rng.uniform(0.6, 1.2)))):
        _desk(room)
    _cabinets(room, 1.3)
    _boxes(room, 0.5)


def _lab(room: Room) -> None:
    for y in np.arange(1.4, room.depth_m - 1.2, float(room.rng.uniform(1.8, 2.8))).tolist():
        length = room.width_m * float(room.rng.uniform(0.4, 0.7))
        bench = (float(room.rng.choice([length / 2 + 0.02, room.width_m - length / 2])), y, length, 0.75)
        room.fixed += [box(*bench, 0.0)] if room.rng.random() < 0.4 else legs(*bench, 0.0, 0.04)
        for _ in range(int(room.rng.integers(0, 4))):
            _chair(room, *room.somewhere())
    _cabinets(room, 1.2)
    _boxes(room, 2.2)


def _storage(room: Room) -> None:
    _cabinets(room, 1.6)
    _boxes(room, 2.0)


def _living(room: Room) -> None:
    rng = room.rng
    choice = rng.random()
    if choice < 0.4:  # bedroom
        room.fixed.append(room.against_wall(2.0, float(rng.uniform(0.9, 1.8)), int(rng.integers(0, 3))))
        room.fixed.append(room.against_wall(float(rng.uniform(1.0, 2.4)), 0.6, int(rng.integers(0, 4))))
    elif choice < 0.75:
        room.fixed.append(room.against_wall(float(rng.uniform(1.6, 2.4)), 0.9, int(rng.integers(0, 3))))
        x, y = room.somewhere(1.2)
        room.fixed += legs(x, y, 1.4, 0.9, float(rng.choice([0.0, math.pi / 2])))
        for _ in range(int(rng.integers(2, 6))):
            _chair(room, x + float(rng.uniform(-1, 1)), y + float(rng.choice([-0.75, 0.75])))
    else:
        room.fixed.append(room.against_wall(min(room.depth_m, 3.0), 0.62, int(rng.choice([0, 2]))))
    _cabinets(room, 1.0)
    _boxes(room, 0.6)


def _state_room(room: Room) -> None:
    """Sparse: chests, show cases, a table, a fireplace."""
    rng = room.rng
    if rng.random() < 0.4:
        room.fixed.append(room.against_wall(float(rng.uniform(1.2, 2.2)), float(rng.uniform(0.3, 0.6)), 1))
    _cabinets(room, 0.4)
    if rng.random() < 0.5 * room.clutter:
        x, y = room.somewhere(1.5)
        length = float(rng.uniform(1.0, 2.4))
        room.fixed += [box(x, y, length, 1.0)] if rng.random() < 0.5 else legs(x, y, length, 1.0, 0.0, 0.05)
    for _ in range(room.count(0.4)):
        _chair(room, *room.somewhere())


def _hall(room: Room) -> None:
    rng = room.rng
    if rng.random() < 0.8:
        spacing, size = rng.uniform(3.5, 8.0, 2), float(rng.uniform(0.15, 0.4))
        is_round = rng.random() < 0.4
        for x in np.arange(spacing[0] / 2 + 0.5, room.width_m - 0.8, spacing[0]).tolist():
            for y in np.arange(spacing[1] / 2 + 0.5, room.depth_m - 0.8, spacing[1]).tolist():
                thick = size * float(rng.uniform(0.9, 1.1))
                room.fixed.append(disc(x, y, thick, 12) if is_round else box(x, y, 2 * thick, 2 * thick))
    use = rng.random()
    if use < 0.35:
        _shelves(room)
    elif use < 0.6:
        for _ in range(room.count(0.25, 30)):
            x, y = room.somewhere(1.5)
            room.fixed += legs(x, y, 1.4, 0.8, 0.0)
            _chair(room, x, y + 0.8)
    _boxes(room, 0.5)
    _cabinets(room, 0.1)


def _corridor(room: Room) -> None:
    """Things along the walls only: the way stays open."""
    for _ in range(room.count(0.9, 16)):
        side = int(room.rng.choice([0, 2]) if room.depth_m > room.width_m else room.rng.choice([1, 3]))
        thing = room.against_wall(float(room.rng.uniform(0.3, 1.2)), float(room.rng.uniform(0.2, 0.45)), side)
        (room.loose if room.rng.random() < 0.3 else room.fixed).append(thing)


def _wet(room: Room) -> None:
    for place in np.arange(0.5, room.depth_m - 0.4, 0.95).tolist():
        room.fixed.append(box(0.3, place, 0.6, 0.42))
    if room.rng.random() < 0.5:
        room.fixed.append(room.against_wall(min(1.7, room.width_m), 0.7, 1))


_USES: dict[str, dict[str, float]] = {
    "office": {"office": 0.8, "meeting": 0.12, "storage": 0.08},
    "corridors": {"office": 0.4, "storage": 0.2, "lab": 0.2, "meeting": 0.2},
    "castle": {"state room": 1.0},
    "hall": {"office": 0.4, "storage": 0.6},
    "lab": {"lab": 0.7, "office": 0.2, "meeting": 0.1},
    "apartments": {"living": 1.0},
}
_FURNISH: dict[str, Callable[[Room], None]] = {
    "office": _office,
    "meeting": _meeting,
    "storage": _storage,
    "lab": _lab,
    "living": _living,
    "state room": _state_room,
    "hall": _hall,
    "corridor": _corridor,
    "wet": _wet,
}


def furnish(traits: Traits, role: str, size_m: tuple[float, float], rng: np.random.Generator) -> Things:
    """The things in one room of a building, in the room's own frame: what stays, and what people move."""
    room = Room(*size_m, traits.clutter, rng)
    if rng.random() < traits.cut_corners:
        room.cut_corner()
    if role in ("hall", "corridor", "wet"):
        use = role
    else:
        uses = _USES[traits.kind]
        use = str(rng.choice(list(uses), p=list(uses.values())))
    _FURNISH[use](room)
    return room.fixed, room.loose
