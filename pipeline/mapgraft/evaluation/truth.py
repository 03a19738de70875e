"""How two maps really lie to each other, and how far a hypothesis is from that."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from mapgraft.contracts import EmptyMapError, Layer, Map, MapType, Points, Transform

RIGHT_M, RIGHT_DEG = 0.5, 5.0  # a hypothesis is right when it is no further off
BLOCK_M = 0.5  # in which new walls are counted


class Error(NamedTuple):
    """How far a hypothesis is off: the mean displacement of the donor's walls, and the angle."""

    displacement_m: float
    rotation_deg: float

    @property
    def right(self) -> bool:
        return self.displacement_m <= RIGHT_M and self.rotation_deg <= RIGHT_DEG


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The true transform between two maps.

    ``placed`` is the donor's map where it belongs, in the receiver's type; ``walls_m`` (n, 2) or (n, 3) are its walls
    there by which errors are measured: those where the receiver knows something, all of them if there are none.
    ``overlap`` is the number of units that both know over that of the smaller map, all in the receiver's units.
    """

    map_type: MapType
    T_receiver_donor: Transform
    placed: Map
    walls_m: Points
    shared_walls: int
    overlap: float
    scale: float = 1.0

    @classmethod
    def of(cls, map_type: MapType, own_map: Map, donor: Layer, T_receiver_donor: Transform, scale: float = 1.0) -> Self:
        """The truth about a receiver's map, and a donor's layer in its own frame and scale."""
        try:
            placed = map_type.view(map_type.place(donor, T_receiver_donor, scale))
        except EmptyMapError:
            placed = map_type.view(None)
        walls_m = map_type.structure(placed, own_map)
        ours, theirs = map_type.known_region(own_map), map_type.known_region(placed)
        joint = len(theirs) - len(theirs.minus(ours))
        return cls(
            map_type,
            T_receiver_donor,
            placed,
            walls_m if len(walls_m) else map_type.structure(placed),
            len(walls_m),
            joint / max(1, min(len(ours), len(theirs))),
            scale,
        )

    @property
    def points_m(self) -> Points:
        """The walls by which errors are measured; where the donor has none, its origin."""
        return self.walls_m if len(self.walls_m) else self.T_receiver_donor.matrix[None, :2, 3]

    def error(self, T_receiver_donor: Transform, scale: float = 1.0) -> Error:
        """How far a hypothesis of the transform is off."""
        return error_of(self.points_m, self.T_receiver_donor, self.scale, T_receiver_donor, scale)

    def new_walls_m(self, before: Map, now: Map) -> float:
        """The length of the donor's walls that the receiver's map knows ``now`` and did not know ``before``.

        Counted in blocks of half a metre in which none was known before: a thick wall is no longer than a thin one, and
        what fills a gap in a known one is no new wall.
        """
        known, seen = (_blocks(self.map_type.structure(self.placed, map_)) for map_ in (before, now))
        return len(seen - known) * BLOCK_M


def error_of(points_m: Points, T_true: Transform, true_scale: float, T: Transform, scale: float) -> Error:
    """How far ``T_receiver_donor`` is off, measured at points of the donor where they belong."""
    found = T.apply(scale * (T_true.inverse().apply(points_m) / true_scale))
    _, turn_rad = T_true.difference(T)
    return Error(float(np.linalg.norm(found - points_m, axis=1).mean()), math.degrees(abs(turn_rad)))


def _blocks(points_m: Points) -> set[tuple[int, ...]]:
    """The blocks in which points (n, 2) or (n, 3) lie."""
    return set(map(tuple, np.unique(np.floor(points_m / BLOCK_M).astype(np.int64), axis=0).tolist()))
