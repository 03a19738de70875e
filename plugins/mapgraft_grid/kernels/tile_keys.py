"""How a tile of 64 × 64 cells is named by one integer."""

from __future__ import annotations

from numba import njit

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
