"""Which cells of a layer hold evidence, and setting cells back to unknown."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_grid.kernels.tile_keys import TILE


@njit(cache=True)
def touched_rows(
    slots: NDArray[np.int32],
    hits: NDArray[np.uint16],
    misses: NDArray[np.uint16],
    wide_of: NDArray[np.int32],
    wide: NDArray[np.uint32],
    absorbed_of: NDArray[np.int32],
    absorbed: NDArray[np.int32],
) -> NDArray[np.uint64]:
    """Rows of bits (k, 64) of the cells with a count or with absorbed evidence; none where the slot is -1."""
    rows = np.zeros((slots.size, TILE), np.uint64)
    for i in range(slots.size):
        slot = slots[i]
        if slot < 0:
            continue
        base, extra = wide_of[slot], absorbed_of[slot]
        for row in range(TILE):
            bits = np.uint64(0)
            for column in range(TILE):
                some = hits[slot, row, column] != 0 or misses[slot, row, column] != 0
                if base >= 0:
                    some |= wide[base, 0, row, column] != 0 or wide[base, 1, row, column] != 0
                if extra >= 0:
                    some |= absorbed[extra, row, column] != 0
                bits |= np.uint64(some) << np.uint64(column)
            rows[i, row] = bits
    return rows


@njit(cache=True)
def nonzero_rows(tiles: NDArray[np.int32]) -> NDArray[np.uint64]:
    """Rows of bits (k, 64) of the cells of tiles (k, 64, 64) that are not zero."""
    rows = np.zeros((tiles.shape[0], TILE), np.uint64)
    for i in range(tiles.shape[0]):
        for row in range(TILE):
            bits = np.uint64(0)
            for column in range(TILE):
                bits |= np.uint64(tiles[i, row, column] != 0) << np.uint64(column)
            rows[i, row] = bits
    return rows


@njit(cache=True)
def erase(slots: NDArray[np.int32], rows: NDArray[np.uint64], tiles: NDArray[np.generic]) -> None:
    """Set the cells of ``rows`` (k, 64) to zero in ``tiles`` (n, 64, 64); slots (k,) of -1 are passed over."""
    for i in range(slots.size):
        if slots[i] < 0:
            continue
        for row in range(TILE):
            bits = rows[i, row]
            if bits:
                for column in range(TILE):
                    if (bits >> np.uint64(column)) & np.uint64(1):
                        tiles[slots[i], row, column] = 0
