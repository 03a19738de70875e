"""An open-addressing hash from tile keys to slots of a pool."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # 2⁶⁴ / golden ratio: spreads neighbouring keys


@njit(cache=True)
def _home(key: int, mask: int) -> int:
    mixed = np.uint64(key) * _GOLDEN
    return int(np.int64(mixed >> np.uint64(32))) & mask


@njit(cache=True)
def rebuild(table: NDArray[np.int32], keys: NDArray[np.int64], size: int) -> None:
    """Fill ``table`` (a power of two, all -1) with the slots of the first ``size`` keys."""
    mask = table.size - 1
    for slot in range(size):
        place = _home(keys[slot], mask)
        while table[place] >= 0:
            place = (place + 1) & mask
        table[place] = slot


@njit(cache=True)
def find(table: NDArray[np.int32], keys: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int32]:
    """The slots (k,) of the wanted keys (k,), -1 where a key is absent."""
    mask = table.size - 1
    slots = np.empty(wanted.size, np.int32)
    for i in range(wanted.size):
        place = _home(wanted[i], mask)
        while table[place] >= 0 and keys[table[place]] != wanted[i]:
            place = (place + 1) & mask
        slots[i] = table[place]
    return slots


@njit(cache=True)
def claim(
    table: NDArray[np.int32], keys: NDArray[np.int64], size: int, wanted: NDArray[np.int64], slots: NDArray[np.int32]
) -> int:
    """Write the slots of the wanted keys into ``slots`` (k,), giving new keys the next free slots.

    Returns how many slots are in use then. When ``keys`` has no room for all new keys nothing is written and the
    number of slots needed is returned, which is larger than ``keys.size``.
    """
    mask = table.size - 1
    missing = 0
    for i in range(wanted.size):
        place = _home(wanted[i], mask)
        while table[place] >= 0 and keys[table[place]] != wanted[i]:
            place = (place + 1) & mask
        slots[i] = table[place]
        missing += slots[i] < 0
    if size + missing > keys.size:
        return size + missing
    for i in range(wanted.size):
        if slots[i] < 0:
            place = _home(wanted[i], mask)
            while table[place] >= 0 and keys[table[place]] != wanted[i]:
                place = (place + 1) & mask
            if table[place] < 0:
                table[place] = size
                keys[size] = wanted[i]
                size += 1
            slots[i] = table[place]
    return size
