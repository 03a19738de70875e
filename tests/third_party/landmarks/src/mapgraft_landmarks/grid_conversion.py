"""Landmark evidence as an occupancy grid: where was looked and what was found, count for count."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Layer, MapError, MapType
from mapgraft_grid.kernels.tile_keys import TILE, tile_key
from mapgraft_grid.layer import FROM_SCANS, GridLayer
from mapgraft_grid.parameters import Lattice
from mapgraft_landmarks.cells import LOOKS, POSITION_STEP_M, SIGHTINGS, SUM_X, SUM_Y, Keys, unpack
from mapgraft_landmarks.layer import as_layer

Index = NDArray[np.int64]  # (n, 2) ix, iy of grid cells


class GridConversion:
    """Turns sightings into hits and looks into misses.

    A grid cell has as many misses as there were looks at the landmark cell that holds its centre. The sightings of a
    landmark cell are hits of the one grid cell in which their mean lies, and as many misses less: of the scans that
    looked there, these saw the landmark.
    """

    def convert(self, layer: Layer, source: MapType, target: MapType) -> GridLayer:
        """A grid layer with the target's parameters; raises MapError when the target is no occupancy grid."""
        own, grid = as_layer(layer), _new_grid(target)
        index, row = _cells_inside(own.cells.keys, own.cell_m, grid.lattice)
        sighted = own.cells.counts[own.cells.counts[:, SIGHTINGS] > 0]
        means = sighted[:, [SUM_X, SUM_Y]] * POSITION_STEP_M / sighted[:, SIGHTINGS, None]
        found = np.floor((means - grid.lattice.anchor_m) / grid.lattice.resolution_m).astype(np.int64)
        tiles, slots = np.unique(np.concatenate((index, found)) // TILE, axis=0, return_inverse=True)
        misses, hits = np.zeros((2, len(tiles), TILE, TILE), np.int64)
        np.add.at(misses, _places(slots[: len(index)], index), own.cells.counts[row, LOOKS])
        np.add.at(hits, _places(slots[len(index) :], found), sighted[:, SIGHTINGS])
        misses = np.maximum(misses - hits, 0)
        keys = np.array([tile_key(int(x), int(y)) for x, y in tiles], np.int64)
        grid.pool.set_counts(keys, hits.astype(np.uint32), misses.astype(np.uint32))
        grid.observations, grid.sensors, grid.mapper = own.observations, own.sensors, FROM_SCANS
        return grid


def _new_grid(target: MapType) -> GridLayer:
    layer = target.new_layer()
    if not isinstance(layer, GridLayer):
        raise MapError(f"point landmarks convert to occupancy_grid, found {target.name}: name another `via`")
    return layer


def _cells_inside(keys: Keys, cell_m: float, lattice: Lattice, reach: float = 0.0) -> tuple[Index, NDArray[np.intp]]:
    """Grid cells whose centres lie in the landmark cells, or up to ``reach`` grid cells beside, and in which (row)."""
    corner = (np.stack(unpack(keys), axis=1) * cell_m - lattice.anchor_m) / lattice.resolution_m  # in grid cells
    across = cell_m / lattice.resolution_m
    steps = np.arange(math.ceil(across + 2 * reach) + 1)
    first = np.ceil(corner - 0.5 - reach).astype(np.int64)  # centres lie at whole numbers and a half
    spread = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    index = first[:, None] + spread
    inside = (index + 0.5 < corner[:, None] + across + reach).all(axis=2)
    return index[inside], np.nonzero(inside)[0]


def _places(slots: NDArray[np.intp], index: Index) -> tuple[NDArray[np.intp], Index, Index]:
    return slots, index[:, 1] % TILE, index[:, 0] % TILE
