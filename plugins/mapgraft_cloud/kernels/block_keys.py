"""How a block of 8 × 8 × 8 voxels is named by one integer, and where voxels lie in it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

BLOCK = 8  # voxels along one side of a block
VOLUME = BLOCK**3
KEY_BITS = 21  # bits of one block coordinate in a key
KEY_BIAS = 1 << 20  # makes the parts non-negative, so that keys sort by z, then y, then x
VOXEL_LIMIT = 1 << 20  # voxels beyond ± this do not exist: 105 km of 0.1 m
_MASK = (1 << KEY_BITS) - 1


@njit(cache=True)
def block_key(x: int, y: int, z: int) -> int:
    """The key of the block whose lowest voxel is 8 · (x, y, z)."""
    return ((z + KEY_BIAS) << (2 * KEY_BITS)) | ((y + KEY_BIAS) << KEY_BITS) | (x + KEY_BIAS)


@njit(cache=True)
def block_x(key: int) -> int:
    return (key & _MASK) - KEY_BIAS


@njit(cache=True)
def block_y(key: int) -> int:
    return ((key >> KEY_BITS) & _MASK) - KEY_BIAS


@njit(cache=True)
def block_z(key: int) -> int:
    return (key >> (2 * KEY_BITS)) - KEY_BIAS


@njit(cache=True)
def slot_of(keys: NDArray[np.int64], wanted: int) -> int:
    """Where a key stands among ascending keys, -1 where it is absent."""
    low, high = 0, keys.size
    while low < high:
        middle = (low + high) // 2
        if keys[middle] < wanted:
            low = middle + 1
        else:
            high = middle
    return low if low < keys.size and keys[low] == wanted else -1
