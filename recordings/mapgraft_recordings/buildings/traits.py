"""What makes one building differ from the next: its kind, and everything that is drawn once for the whole of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

KINDS = ("office", "corridors", "castle", "hall", "lab", "apartments")


@dataclass(frozen=True, slots=True)
class Traits:
    """Sizes in metres, shares between 0 and 1; drawn once per building.

    ``copied`` is the share of rooms that are exact copies of the building's model room of their size; the others are
    furnished anew. ``relief`` is the number of niches, pilasters and radiators per metre of wall face, ``relief_m``
    how deep they are, ``crooked_m`` how far the corners of a wall face lie off its line, ``uneven`` how much thicker
    than others some walls are. ``columns`` is the share of walls with a column,
    ``cut_corners`` of rooms with an oblique or round corner, ``sidelights`` of doors with a narrow pane beside them,
    through which a little of the room is seen. ``glass_reflects`` is the share of beams that a pane sends back,
    ``people`` the share of scans into which somebody walks, ``changes`` that of things and doors found changed later.
    """

    kind: str
    wall_m: float
    outer_wall_m: float
    door_m: float
    door_place: str
    door_closed: float
    door_ajar: float
    door_leafless: float
    corridor_m: float
    room_width_m: float
    room_depth_m: float
    size_varies: float
    copied: float
    mirrored: bool
    clutter: float
    relief: float
    relief_m: float
    regular_relief: bool
    crooked_m: float
    uneven: float
    columns: float
    cut_corners: float
    glass_outside: float
    glass_inside: float
    sidelights: float
    glass_reflects: float
    people: float
    changes: float


_WALL_M = {
    "office": (0.08, 0.22),
    "corridors": (0.1, 0.35),
    "castle": (0.35, 0.9),
    "hall": (0.1, 0.4),
    "lab": (0.08, 0.25),
    "apartments": (0.08, 0.25),
}
_CLOSED = {"office": 0.5, "corridors": 0.8, "castle": 0.15, "hall": 0.5, "lab": 0.4, "apartments": 0.35}
_CORRIDOR_M = {
    "office": (1.5, 2.8),
    "corridors": (1.7, 3.4),
    "castle": (2.0, 4.5),
    "hall": (2.0, 4.0),
    "lab": (1.7, 3.2),
    "apartments": (1.2, 2.0),
}
_ROOM_M = {  # width from, to, depth from, to
    "office": (2.4, 5.0, 3.2, 6.0),
    "corridors": (3.0, 7.0, 3.0, 7.0),
    "castle": (4.0, 9.0, 4.5, 9.0),
    "hall": (3.0, 7.0, 3.0, 6.0),
    "lab": (3.5, 9.0, 4.0, 8.0),
    "apartments": (6.5, 11.0, 6.0, 10.0),
}


def draw_traits(kind: str, rng: np.random.Generator) -> Traits:
    """The traits of one building of a kind."""
    width_from, width_to, depth_from, depth_to = _ROOM_M[kind]
    wall = rng.uniform(*_WALL_M[kind])
    closed = rng.uniform(0.0, _CLOSED[kind])
    glassy = rng.random() < (0.1 if kind == "castle" else 0.3)
    return Traits(
        kind=kind,
        wall_m=wall,
        outer_wall_m=wall * rng.uniform(1.0, 2.0),
        door_m=rng.uniform(0.8, 1.1) if kind not in ("castle", "hall") else rng.uniform(0.9, 1.6),
        door_place=str(rng.choice(["corner", "middle", "anywhere"], p=[0.3, 0.2, 0.5])),
        door_closed=closed,
        door_ajar=rng.uniform(0.0, 0.4),
        door_leafless=rng.uniform(0.5, 1.0) if kind == "castle" else rng.uniform(0.0, 0.4),
        corridor_m=rng.uniform(*_CORRIDOR_M[kind]),
        room_width_m=rng.uniform(width_from, width_to),
        room_depth_m=rng.uniform(depth_from, depth_to),
        size_varies=float(rng.choice([0.0, rng.uniform(0.05, 0.6)], p=[0.2, 0.8])),
        copied=float(rng.choice([0.0, rng.uniform(0.0, 1.0), 1.0], p=[0.7, 0.2, 0.1])),
        mirrored=bool(rng.random() < 0.4),
        clutter=float(rng.choice([rng.uniform(0.15, 0.7), rng.uniform(0.7, 2.0)])),
        relief=rng.uniform(0.0, 1.1),
        relief_m=rng.uniform(0.04, 0.15) * (1.6 if kind == "castle" else 1.0),
        regular_relief=bool(rng.random() < 0.5),
        crooked_m=float(rng.choice([0.0, rng.uniform(0.0, 0.025)])),
        uneven=float(rng.choice([0.0, rng.uniform(0.1, 1.0)], p=[0.2, 0.8])),
        columns=float(rng.choice([0.0, rng.uniform(0.1, 1.0)])),
        cut_corners=float(rng.choice([0.0, rng.uniform(0.02, 0.5)])),
        glass_outside=rng.uniform(0.1, 0.7) if glassy else 0.0,
        glass_inside=float(rng.choice([0.0, rng.uniform(0.05, 0.4)], p=[0.7, 0.3])),
        sidelights=float(rng.choice([0.0, rng.uniform(0.1, 0.9)])),
        glass_reflects=rng.uniform(0.05, 0.6),
        people=float(rng.choice([0.0, rng.uniform(0.02, 0.3)])),
        changes=float(rng.choice([0.0, rng.uniform(0.1, 0.8)])),
    )
