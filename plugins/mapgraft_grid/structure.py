"""Where the walls of a grid are: the centres of its occupied cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.kernels.tile_keys import KEY_BIAS, KEY_BITS, TILE, tile_x, tile_y


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
    values = np.stack(there)[of_point, inside[:, 1], inside[:, 0]]
    known: NDArray[np.bool_] = (values <= grid.thresholds.free) | (values >= grid.thresholds.occupied)
    return known
