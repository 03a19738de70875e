"""Landmark evidence as an occupancy grid: where was looked and what was found, count for count."""

from __future__ import annotations

import numpy as np

from mapgraft.contracts import Layer, MapType
from mapgraft_grid.cells import HITS, MISSES, GridLayer, added, cells_at, cells_inside, lattice_of, layer_of_cells
from mapgraft_landmarks.cells import LOOKS, unpack
from mapgraft_landmarks.landmarks import as_map
from mapgraft_landmarks.layer import as_layer


class GridConversion:
    """Turns landmarks into hits and looks into misses.

    A landmark that stands in the map of the robot that made it is one grid cell with as many hits as it was sighted and
    no misses. Any other grid cell has as many misses as there were looks at the landmark cell that holds its centre.
    """

    def convert(self, layer: Layer, source: MapType, target: MapType) -> GridLayer:
        """A grid layer with the target's parameters; raises MapError when one of the three is of another type."""
        own, lattice = as_layer(layer), lattice_of(target)
        landmarks = as_map(source.view(own)).landmarks
        looked, row = cells_inside(np.stack(unpack(own.cells.keys), axis=1) * own.cell_m, own.cell_m, lattice)
        found = cells_at(landmarks.positions_m, lattice)
        told = np.zeros((len(looked) + len(found), 2), np.int64)
        told[: len(looked), MISSES], told[len(looked) :, HITS] = own.cells.counts[row, LOOKS], landmarks.sightings
        cells, counts = added(np.concatenate((looked, found)), told)
        counts[counts[:, HITS] > 0, MISSES] = 0
        return layer_of_cells(target, cells, counts, observations=own.observations, sensors=own.sensors)
