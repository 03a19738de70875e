"""Landmark evidence as an occupancy grid: where was looked and what was found, count for count."""

from __future__ import annotations

import numpy as np

from mapgraft.contracts import Layer, MapType
from mapgraft_grid.cells import HITS, MISSES, GridLayer, added, cells_at, cells_inside, lattice_of, layer_of_cells
from mapgraft_landmarks.cells import LOOKS, POSITION_STEP_M, SIGHTINGS, SUM_X, SUM_Y, unpack
from mapgraft_landmarks.layer import as_layer


class GridConversion:
    """Turns sightings into hits and looks into misses.

    A grid cell has as many misses as there were looks at the landmark cell that holds its centre. The sightings of a
    landmark cell are hits of the one grid cell in which their mean lies, and as many misses less: of the scans that
    looked there, these saw the landmark.
    """

    def convert(self, layer: Layer, source: MapType, target: MapType) -> GridLayer:
        """A grid layer with the target's parameters; raises MapError when the target is no occupancy grid."""
        own, lattice = as_layer(layer), lattice_of(target)
        looked, row = cells_inside(np.stack(unpack(own.cells.keys), axis=1) * own.cell_m, own.cell_m, lattice)
        sighted = own.cells.counts[own.cells.counts[:, SIGHTINGS] > 0]
        found = cells_at(sighted[:, [SUM_X, SUM_Y]] * POSITION_STEP_M / sighted[:, SIGHTINGS, None], lattice)
        told = np.zeros((len(looked) + len(found), 2), np.int64)
        told[: len(looked), MISSES], told[len(looked) :, HITS] = own.cells.counts[row, LOOKS], sighted[:, SIGHTINGS]
        cells, counts = added(np.concatenate((looked, found)), told)
        counts[:, MISSES] = np.maximum(counts[:, MISSES] - counts[:, HITS], 0)
        return layer_of_cells(target, cells, counts, observations=own.observations, sensors=own.sensors)
