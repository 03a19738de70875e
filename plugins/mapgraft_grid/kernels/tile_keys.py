"""How a tile of 64 × 64 cells is named by one integer."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

TILE = 64  # cells along one side of a tile
KEY_BITS = 26  # bits of one tile coordinate in a key
KEY_BIAS = 1 << 25  # makes both parts non-negative, so that keys sort by row, then by column


@njit(cache=True)
def tile_key(tile_x: int, tile_y: int) -> int:
    """The key of the tile whose lowest cell is (64 · tile_x, 64 · tile_y); both in ±2²⁴."""
    return ((tile_y + KEY_BIAS) << KEY_BITS) | (tile_x + KEY_BIAS)


@njit(cache=True)
def tile_x(key: int) -> int:
    return (key & ((1 << KEY_BITS) - 1)) - KEY_BIAS


@njit(cache=True)
def tile_y(key: int) -> int:
    return (key >> KEY_BITS) - KEY_BIAS


@njit(cache=True)
def spread(keys: NDArray[np.int64]) -> tuple[int, int, int, int]:
    """The least and the greatest tile x and y of some keys (k,): x0, y0, x1, y1; k is at least 1."""
    x0 = x1 = tile_x(keys[0])
    y0 = y1 = tile_y(keys[0])
    for key in keys[1:]:
        x, y = tile_x(key), tile_y(key)
        x0, x1 = min(x0, x), max(x1, x)
        y0, y1 = min(y0, y), max(y1, y)
    return x0, y0, x1, y1
