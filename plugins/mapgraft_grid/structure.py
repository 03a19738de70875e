"""Where the walls of a grid are, which are the centres of its occupied cells, and which cells it knows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.kernels.tile_keys import KEY_BIAS, KEY_BITS, TILE, tile_x, tile_y
from mapgraft_grid.region import GridRegion


def occupied_centres(grid: GridMap) -> Points:
    """The centres of all occupied cells (n, 2) in metres, tile by tile in the order of the keys."""
    occupied = grid.thresholds.occupied
    found = []
    for key, tile in grid.tiles.items():
        rows, columns = np.nonzero(tile.log_odds >= occupied)
        found.append(np.stack((TILE * tile_x(key) + columns, TILE * tile_y(key) + rows), axis=1))
    cells = np.concatenate(found) if found else np.empty((0, 2), np.int64)
    centres: Points = (cells + 0.5) * grid.resolution_m + np.array(grid.anchor_m)
    return centres


def known_cells(grid: GridMap) -> GridRegion:
    """The cells that are free or occupied."""
    keys = [key for key, tile in grid.tiles.items() if tile.known]
    if not keys:
        return GridRegion.empty(grid.lattice)
    known = _is_known(grid, np.stack([grid.tiles[key].log_odds for key in keys]))
    rows = np.packbits(known, axis=2, bitorder="little").view(np.uint64)[:, :, 0]
    return GridRegion(grid.lattice, np.array(keys, np.int64), np.ascontiguousarray(rows))


def known_at(grid: GridMap, points_m: Points) -> NDArray[np.bool_]:
    """Whether the cells (n,) in which the points (n, 2) lie are free or occupied."""
    cells = np.floor((points_m - np.array(grid.anchor_m)) / grid.resolution_m).astype(np.int64)
    tiles = cells // TILE
    keys, of_point = np.unique(((tiles[:, 1] + KEY_BIAS) << KEY_BITS) | (tiles[:, 0] + KEY_BIAS), return_inverse=True)
    nothing = np.zeros((TILE, TILE), np.int16)
    there = [grid.tiles[key].log_odds if key in grid.tiles else nothing for key in keys.tolist()]
    if not there:
        return np.zeros(0, np.bool_)
    inside = cells - TILE * tiles
    return _is_known(grid, np.stack(there)[of_point, inside[:, 1], inside[:, 0]])


def _is_known(grid: GridMap, log_odds: NDArray[np.int16]) -> NDArray[np.bool_]:
    known: NDArray[np.bool_] = (log_odds <= grid.thresholds.free) | (log_odds >= grid.thresholds.occupied)
    return known
