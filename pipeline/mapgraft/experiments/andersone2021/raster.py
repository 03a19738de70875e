"""A grid map as viewers see it: probabilities in percent on a lattice, from the message that the map type makes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Map, MapType
from mapgraft.errors import EmptyMapError, PluginError

MESSAGE: Final = "nav_msgs/msg/OccupancyGrid"
OCCUPIED_FROM, FREE_TO = 66, 19  # percent: more than .65 and less than .196, as map_server reads a map
UNKNOWN, FREE, OCCUPIED = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """``percent`` (h, w) int8: the probability of being occupied, -1 where nothing is known; row 0 has the smallest y.

    ``origin`` (ix, iy) is the place of element [0, 0] on a lattice that passes through ``anchor_m``.
    """

    percent: NDArray[np.int8]
    origin: tuple[int, int]
    anchor_m: tuple[float, float]
    resolution_m: float

    @property
    def classes(self) -> NDArray[np.uint8]:
        """UNKNOWN, FREE or OCCUPIED; a probability between is unknown."""
        out = np.zeros(self.percent.shape, np.uint8)
        out[(self.percent >= 0) & (self.percent <= FREE_TO)] = FREE
        out[self.percent >= OCCUPIED_FROM] = OCCUPIED
        return out

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top, as matplotlib wants them."""
        height, width = self.percent.shape
        x, y = (a + i * self.resolution_m for a, i in zip(self.anchor_m, self.origin, strict=True))
        return x, x + width * self.resolution_m, y, y + height * self.resolution_m

    def over(self, origin: tuple[int, int], shape: tuple[int, int]) -> Raster:
        """The same map in another rectangle of the lattice, which must hold all of it."""
        percent = np.full(shape, -1, np.int8)
        x, y = self.origin[0] - origin[0], self.origin[1] - origin[1]
        height, width = self.percent.shape
        percent[y : y + height, x : x + width] = self.percent
        return Raster(percent, origin, self.anchor_m, self.resolution_m)

    def joined(self, *others: Raster) -> list[Raster]:
        """This map and others of the same lattice, all in the smallest rectangle that holds them."""
        all_of_them = [self, *others]
        left = min(one.origin[0] for one in all_of_them)
        bottom = min(one.origin[1] for one in all_of_them)
        right = max(one.origin[0] + one.percent.shape[1] for one in all_of_them)
        top = max(one.origin[1] + one.percent.shape[0] for one in all_of_them)
        shape = top - bottom, right - left
        return [one.over((left, bottom), shape) for one in all_of_them]


def raster_of(map_type: MapType, map_: Map) -> Raster:
    """The map as a viewer sees it.

    Raises EmptyMapError when nothing is known, PluginError when the type does not show itself as an occupancy grid.
    """
    if map_.known() == 0:
        raise EmptyMapError("nothing is known in the map that is to be shown: its scans have no returns")
    for message in map_type.messages(map_):
        if message.message_type == MESSAGE:
            return _raster(cast("dict[str, Any]", message.fields))
    raise PluginError(f"maps of the type {map_type.name!r} show themselves as no {MESSAGE}: the experiment is of grids")


def left_masks(after: Raster, before: Raster) -> dict[str, NDArray[np.bool_]]:
    """What a revert left, cell by cell, each cell under one name: as ``Leftovers`` counts them, but that ``touched``
    are those of which nothing but the probability is another."""
    now, then = after.classes, before.classes
    known = then != UNKNOWN
    masks = {
        "lost": known & (now == UNKNOWN),
        "alien": ~known & (now != UNKNOWN),
        "changed": known & (now != UNKNOWN) & (now != then),
    }
    rest = (after.percent != before.percent) & ~(masks["lost"] | masks["alien"] | masks["changed"])
    return {**masks, "touched": rest}


def _raster(fields: dict[str, Any]) -> Raster:
    info = fields["info"]
    resolution_m = float(info["resolution"])
    position = info["origin"]["position"]
    (left, x_m), (bottom, y_m) = (_split(float(position[axis]), resolution_m) for axis in "xy")
    percent = np.asarray(fields["data"], np.int8).reshape(int(info["height"]), int(info["width"]))
    return Raster(percent, (left, bottom), (x_m, y_m), resolution_m)


def _split(value_m: float, resolution_m: float) -> tuple[int, float]:
    """A position as whole cells, rounded to the nearest, and a rest."""
    cells = round(value_m / resolution_m)
    return cells, value_m - cells * resolution_m
