"""Making a map from a layer and what others contribute, anew or only where something has changed."""

from __future__ import annotations

from typing import Final

import numpy as np

from mapgraft_grid.foreign import ForeignEvidence, own_evidence
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.kernels import viewing
from mapgraft_grid.kernels.tile_keys import TILE
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.parameters import Thresholds
from mapgraft_grid.tile_tree import Tile, TileTree
from mapgraft_grid.tiles import TileKeys

_AT_ONCE: Final = 256  # tiles per call, so that the intermediate evidence stays in the cache


def fresh(layer: GridLayer, foreign: ForeignEvidence, thresholds: Thresholds) -> GridMap:
    """The map of all tiles that anybody knows something about."""
    keys = np.union1d(layer.pool.index.keys, foreign.index.keys)
    return updated(GridMap(layer.lattice, thresholds, TileTree(), 0), layer, foreign, keys)


def updated(previous: GridMap, layer: GridLayer, foreign: ForeignEvidence, keys: TileKeys) -> GridMap:
    """The map with these tiles computed anew and all others as they were."""
    known = previous.known()
    changes: dict[int, Tile | None] = {}
    for first in range(0, keys.size, _AT_ONCE):
        known += _recompute(previous, layer, foreign, keys[first : first + _AT_ONCE], changes)
    return GridMap(layer.lattice, previous.thresholds, previous.tiles.changed(changes), known)


def _recompute(
    previous: GridMap, layer: GridLayer, foreign: ForeignEvidence, keys: TileKeys, changes: dict[int, Tile | None]
) -> int:
    """Put the new tiles into ``changes``; returns by how many the known cells grow."""
    evidence = own_evidence(layer, layer.pool.index.find(keys))
    values = np.empty((keys.size, TILE, TILE), np.int16)
    counts = np.empty(keys.size, np.int32)
    read = previous.thresholds
    viewing.read(
        evidence, foreign.index.find(keys), foreign.tiles, read.clamp, read.free, read.occupied, values, counts
    )
    grown = 0
    for number, (key, count) in enumerate(zip(keys.tolist(), counts.tolist(), strict=True)):
        before = previous.tiles.get(key)
        grown += max(count, 0) - (before.known if before else 0)
        if count < 0:
            changes[key] = None
        else:
            cells = values[number].copy()
            cells.setflags(write=False)
            changes[key] = Tile(cells, count)
    return grown
