"""Following the beams of one sweep through the voxels: what was hit and what was seen through."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_cloud.kernels.block_keys import BLOCK, block_key

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # 2⁶⁴ / golden ratio: spreads neighbouring keys


@njit(cache=True)
def _home(key: int, mask: int) -> int:
    return int(np.int64((np.uint64(key) * _GOLDEN) >> np.uint64(32))) & mask


@njit(cache=True)
def _claim(key: int, table: NDArray[np.int32], keys: NDArray[np.int64], used: NDArray[np.int64]) -> int:
    """The slot of a block, the next free one when it is new; -1 when there is no room."""
    mask = table.size - 1
    place = _home(key, mask)
    while table[place] >= 0:
        if keys[table[place]] == key:
            return int(table[place])
        place = (place + 1) & mask
    if used[0] == keys.size:
        return -1
    table[place] = used[0]
    keys[used[0]] = key
    used[0] += 1
    return int(table[place])


@njit(cache=True)
def rehash(table: NDArray[np.int32], keys: NDArray[np.int64], used: int) -> None:
    """Fill ``table`` (a power of two, all -1) with the slots of the first ``used`` keys."""
    mask = table.size - 1
    for slot in range(used):
        place = _home(keys[slot], mask)
        while table[place] >= 0:
            place = (place + 1) & mask
        table[place] = slot


@njit(cache=True)
def see_through(
    origin: NDArray[np.float64],
    ends: NDArray[np.float64],
    first: int,
    short: int,
    table: NDArray[np.int32],
    keys: NDArray[np.int64],
    bits: NDArray[np.uint64],
    used: NDArray[np.int64],
) -> int:
    """Set the bits of all voxels between an origin (3,) and ends (n, 3), in voxels, from the first end on.

    A beam stops when it comes within ``short`` voxels of the one it ends in, along every axis: beams that graze a wall
    would eat it. Returns how far it came, less than n when there is no room; setting bits again does no harm.
    Source: J. Amanatides and A. Woo, A fast voxel traversal algorithm for ray tracing (Eurographics 1987).
    """
    step, voxel, last = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64)
    reach, across = np.empty(3), np.empty(3)
    for i in range(first, ends.shape[0]):
        for axis in range(3):
            way = ends[i, axis] - origin[axis]
            voxel[axis] = int(np.floor(origin[axis]))
            last[axis] = int(np.floor(ends[i, axis]))
            step[axis] = 1 if way > 0.0 else -1
            if way == 0.0:
                reach[axis], across[axis] = np.inf, np.inf
            else:
                across[axis] = abs(1.0 / way)
                border = voxel[axis] + 1.0 if way > 0.0 else float(voxel[axis])
                reach[axis] = (border - origin[axis]) / way
        known, slot = -1, 0
        while True:
            if (
                abs(voxel[0] - last[0]) <= short
                and abs(voxel[1] - last[1]) <= short
                and abs(voxel[2] - last[2]) <= short
            ):
                break
            key = block_key(voxel[0] >> 3, voxel[1] >> 3, voxel[2] >> 3)
            if key != known:
                slot = _claim(key, table, keys, used)
                if slot < 0:
                    return i
                known = key
            bits[slot, voxel[2] & 7] |= np.uint64(1) << np.uint64((voxel[1] & 7) * BLOCK + (voxel[0] & 7))
            axis = 0
            if reach[1] < reach[axis]:
                axis = 1
            if reach[2] < reach[axis]:
                axis = 2
            if reach[axis] > 1.0:  # beyond the end, which rounding let it miss
                break
            voxel[axis] += step[axis]
            reach[axis] += across[axis]
    return int(ends.shape[0])


@njit(cache=True)
def count(
    slots: NDArray[np.int64], free: NDArray[np.uint64], hit: NDArray[np.uint64], counts: NDArray[np.uint32]
) -> None:
    """Add one miss to every free voxel that was not hit, and one hit to every hit one; counts (slots, 2, 512)."""
    one = np.uint64(1)
    for i in range(slots.size):
        for z in range(BLOCK):
            hits, misses = hit[i, z], free[i, z] & ~hit[i, z]
            for k in range(BLOCK * BLOCK):
                if (hits >> np.uint64(k)) & one:
                    counts[slots[i], 0, z * 64 + k] += np.uint32(1)
                elif (misses >> np.uint64(k)) & one:
                    counts[slots[i], 1, z * 64 + k] += np.uint32(1)
