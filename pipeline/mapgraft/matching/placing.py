"""The other map where a match puts it: its walls, and what it says is free, in the receiver's frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Layer, Map, MapError, MapType, Points, Transform
from mapgraft.matching.ready_map import ReadyMap
from mapgraft.procedures import Workshop

OCCUPANCY_GRID = "nav_msgs/msg/OccupancyGrid"
_FREE_BELOW = 20  # percent: what map_server calls free


@dataclass(frozen=True, slots=True, eq=False)
class Sketch:
    """A map reduced to what a picture shows: ``walls_m`` and ``free_m`` (n, 2) in the receiver's frame.

    ``cell_m`` is the side of the map's own cells, None where the type does not show its maps as occupancy grids: then
    nothing is told free.
    """

    walls_m: Points
    free_m: Points
    cell_m: float | None


def sketch(map_type: MapType, map_: Map) -> Sketch:
    """What stands in a map, and what is free where the type shows its maps as occupancy grids."""
    walls = np.asarray(map_type.structure(map_)[:, :2], np.float64)
    for message in map_type.messages(map_):
        if message.message_type == OCCUPANCY_GRID:
            free, cell_m = _free(cast("Mapping[str, Any]", message.fields))
            return Sketch(walls, free, cell_m)
    return Sketch(walls, np.empty((0, 2)), None)


def placed(workshop: Workshop, a: ReadyMap, b: ReadyMap, T_a_b: Transform, scale: float = 1.0) -> Map | None:
    """b's map in a's frame and type; None where no conversion leads there. Raises MapError when it cannot be placed."""
    layer = in_type_of(workshop, a, b)
    return None if layer is None else a.map_type.view(a.map_type.place(layer, T_a_b, scale))


def placed_sketch(workshop: Workshop, a: ReadyMap, b: ReadyMap, T_a_b: Transform, scale: float = 1.0) -> Sketch:
    """b's map in a's frame; of a type that cannot be converted to a's only what stands in it."""
    try:
        map_ = placed(workshop, a, b, T_a_b, scale)
    except MapError:
        map_ = None
    if map_ is not None:
        seen, own_m = sketch(a.map_type, map_), b.metadata.resolution_m
        return seen if own_m is None else dataclasses.replace(seen, cell_m=scale * own_m)
    walls = T_a_b.apply(scale * np.asarray(b.map_type.structure(b.view)[:, :2], np.float64))
    return Sketch(walls, np.empty((0, 2)), None)


def in_type_of(workshop: Workshop, a: ReadyMap, b: ReadyMap) -> Layer | None:
    """b's layer in a's map type; None where no conversions lead there."""
    if workshop.plugins.way(b.map_type.name, a.map_type.name) is None:
        return None
    return workshop.converter(b.map_type, a.map_type)(b.layer)


def _free(fields: Mapping[str, Any]) -> tuple[Points, float]:
    """The centres of the free cells of an OccupancyGrid message that is not turned, and the side of a cell."""
    info = fields["info"]
    position, side_m = info["origin"]["position"], float(info["resolution"])
    data: NDArray[np.int8] = np.asarray(fields["data"]).reshape(int(info["height"]), int(info["width"]))
    rows, columns = np.nonzero((data >= 0) & (data < _FREE_BELOW))
    corner_m = np.array((position["x"], position["y"]), np.float64)
    return corner_m + (np.column_stack((columns, rows)) + 0.5) * side_m, side_m
