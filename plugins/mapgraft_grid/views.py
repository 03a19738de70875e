"""Making a map from a layer and what others contribute, anew or only where something has changed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from mapgraft_grid.foreign import ForeignEvidence
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.kernels import viewing
from mapgraft_grid.kernels.tile_keys import TILE
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.parameters import Thresholds
from mapgraft_grid.tile_tree import Tile, TileTree
from mapgraft_grid.tiles import TileKeys

_AT_ONCE: Final = 256  # tiles per call: 2 MB, a second-level cache


def fresh(layer: GridLayer, foreign: ForeignEvidence, thresholds: Thresholds) -> GridMap:
    """The map of all tiles that anybody knows something about."""
    keys = np.union1d(layer.pool.index.keys, foreign.index.keys)
    return updated(GridMap(layer.lattice, thresholds, TileTree(), 0), layer, foreign, keys)


def updated(previous: GridMap, layer: GridLayer, foreign: ForeignEvidence, keys: TileKeys) -> GridMap:
    """The map with these tiles computed anew and all others as they were."""
    tiles, grown = previous.tiles.changed(_computed(previous.thresholds, layer, foreign, keys))
    return GridMap(layer.lattice, previous.thresholds, tiles, previous.known() + grown)


def _computed(
    read: Thresholds, layer: GridLayer, foreign: ForeignEvidence, keys: TileKeys
) -> Iterator[tuple[int, Tile | None]]:
    """The tiles as they are now, None for those without evidence."""
    pool, model = layer.pool, layer.sensor_model
    for first in range(0, keys.size, _AT_ONCE):
        part = keys[first : first + _AT_ONCE]
        values = np.empty((part.size, TILE, TILE), np.int16)
        counts = np.empty(part.size, np.int32)
        viewing.fuse(
            pool.index.find(part),
            *pool.arrays(),
            (model.l_hit, model.l_miss),
            foreign.index.find(part),
            foreign.tiles,
            (read.clamp, read.free, read.occupied),
            values,
            counts,
        )
        for key, count, value in zip(part.tolist(), counts.tolist(), values, strict=True):
            if count < 0:
                yield key, None
            else:
                cells = value.copy()  # by itself, so that a tile keeps no other alive
                cells.setflags(write=False)
                yield key, Tile(cells, count)
