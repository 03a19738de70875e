"""Adding what one scan saw to the counts of the tiles."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_grid.kernels.tile_keys import TILE

FULL = 65535  # the largest count of a narrow tile


@njit(cache=True)
def count(
    first: int,
    slots: NDArray[np.int32],
    free: NDArray[np.uint64],
    hit: NDArray[np.uint64],
    hits: NDArray[np.uint16],
    misses: NDArray[np.uint16],
    looks: NDArray[np.int32],
) -> int:
    """Add one to the misses of the free cells and to the hits of the hit cells of the tiles first, first + 1, …

    ``slots`` (k,), ``free`` and ``hit`` (k, 64) rows of bits; ``hits`` and ``misses`` (n, 64, 64); ``looks`` (n,) is an
    upper bound of the counts of each tile. Stops at the first tile that might overflow and returns its number; k when
    all are done.
    """
    for i in range(first, slots.size):
        slot = slots[i]
        if looks[slot] >= FULL:
            return i
        looks[slot] += 1
        for row in range(TILE):
            bits = free[i, row]
            if bits:
                for column in range(TILE):
                    misses[slot, row, column] += np.uint16((bits >> np.uint64(column)) & np.uint64(1))
            bits = hit[i, row]
            while bits:
                lowest = bits & (~bits + np.uint64(1))
                column = 0
                for power in range(6):
                    shift = np.uint64(32 >> power)
                    if lowest >> shift:
                        lowest >>= shift
                        column += 32 >> power
                hits[slot, row, column] += np.uint16(1)
                bits &= bits - np.uint64(1)
    return slots.size
