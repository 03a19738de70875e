"""Keys of evidence: a cell of the plane and a slot in it, packed into one integer.

Slot 0 stands for the cell itself, ``FACED`` + 0 … 15 for walls in it of which one side was seen, by the direction along
which that side lies on the left, and ``BARE`` + 0 … 7 for walls of which nobody knows from where they were seen, by
the direction of the line. The first of either are about the direction of x.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

INDEX_BITS = 23
SLOT_BITS = 5
LIMIT = 1 << (INDEX_BITS - 1)  # cell indices lie in [-LIMIT, LIMIT)
FACED, FACED_BINS = 1, 16
BARE, BARE_BINS = 17, 8
SLOTS = 1 + FACED_BINS + BARE_BINS
STEPS_PER_M = 1024  # of positions


@njit(cache=True)
def key_of(ix: int, iy: int, slot: int) -> int:
    """The key of a slot of a cell."""
    return (((ix + LIMIT) << INDEX_BITS | (iy + LIMIT)) << SLOT_BITS) | slot


@njit(cache=True)
def x_of(key: int) -> int:
    """The cell's index along x."""
    return (key >> (INDEX_BITS + SLOT_BITS)) - LIMIT


@njit(cache=True)
def y_of(key: int) -> int:
    """The cell's index along y."""
    return ((key >> SLOT_BITS) & ((1 << INDEX_BITS) - 1)) - LIMIT


@njit(cache=True)
def slot_of(key: int) -> int:
    """The slot in the cell."""
    return key & ((1 << SLOT_BITS) - 1)


@njit(cache=True)
def slot_at(angle_rad: float, faced: bool) -> int:
    """The slot of a wall that runs along a direction."""
    if faced:
        return FACED + math.floor(angle_rad / (2.0 * math.pi) * FACED_BINS + 0.5) % FACED_BINS
    return BARE + math.floor(angle_rad / math.pi * BARE_BINS + 0.5) % BARE_BINS


@njit(cache=True)
def find(keys: NDArray[np.int64], key: int) -> int:
    """The first place in ascending keys whose key is not below the given one."""
    low, high = 0, keys.size
    while low < high:
        middle = (low + high) // 2
        if keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low
