"""Reading maps: evidence summed, positions averaged, voxels looked up and looked around in."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_cloud.kernels.block_keys import BLOCK, VOLUME, block_key, slot_of


@njit(cache=True)
def add_evidence(
    keys: NDArray[np.int64],
    odds: NDArray[np.int64],
    positions: NDArray[np.int64],
    source_keys: NDArray[np.int64],
    counts: NDArray[np.uint32],
    slots: NDArray[np.int64],
    sums: NDArray[np.uint32],
    rows: NDArray[np.int64],
    model: NDArray[np.int64],
) -> None:
    """Add one source to log-odds (k, 512) and positions (k, 4, 512: hits, x, y, z) of ascending blocks ``keys``.

    ``counts`` (capacity, 2, 512) is read at the ``slots`` (m,) of the ascending ``source_keys`` (m,), ``sums``
    (s, 3, 512) at the ``rows`` (capacity,) of these; ``model`` (3,) is the evidence of a hit, of a miss, and how often
    the source counts.
    """
    for k in range(keys.size):
        place = slot_of(source_keys, keys[k])
        if place < 0:
            continue
        slot = slots[place]
        row = rows[slot]
        for i in range(VOLUME):
            hits, misses = np.int64(counts[slot, 0, i]), np.int64(counts[slot, 1, i])
            if hits or misses:
                odds[k, i] += model[2] * (hits * model[0] + misses * model[1])
            if hits:
                positions[k, 0, i] += model[2] * hits
                for axis in range(3):
                    positions[k, 1 + axis, i] += model[2] * np.int64(sums[row, axis, i])


@njit(cache=True)
def most(counts: NDArray[np.uint32], slots: NDArray[np.int64]) -> int:
    """The largest of the counts (capacity, 2, 512) at these slots (n,), 0 without any."""
    found = 0
    for slot in slots:
        for channel in range(2):
            for i in range(VOLUME):
                found = max(found, int(counts[slot, channel, i]))
    return found


@njit(cache=True)
def filled(counts: NDArray[np.uint32], slots: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which slots (n,) have any counts (capacity, 2, 512)."""
    found = np.zeros(slots.size, np.bool_)
    for n in range(slots.size):
        for i in range(VOLUME):
            if counts[slots[n], 0, i] or counts[slots[n], 1, i]:
                found[n] = True
                break
    return found


@njit(cache=True)
def held(
    counts: NDArray[np.uint32], slots: NDArray[np.int64], places: NDArray[np.int64], bits: NDArray[np.uint64]
) -> None:
    """Set the bits (k, 8) of the voxels with counts: those of ``slots`` (n,) in the rows ``places`` (n,)."""
    for n in range(slots.size):
        for i in range(VOLUME):
            if counts[slots[n], 0, i] or counts[slots[n], 1, i]:
                bits[places[n], i >> 6] |= np.uint64(1) << np.uint64(i & 63)


@njit(cache=True)
def clear(
    counts: NDArray[np.uint32],
    sums: NDArray[np.uint32],
    rows: NDArray[np.int64],
    slots: NDArray[np.int64],
    bits: NDArray[np.uint64],
) -> None:
    """Forget the counts and position sums of the voxels whose bits (n, 8) are set in the blocks at ``slots`` (n,)."""
    for n in range(slots.size):
        slot = slots[n]
        for i in range(VOLUME):
            if (bits[n, i >> 6] >> np.uint64(i & 63)) & np.uint64(1):
                counts[slot, 0, i] = 0
                counts[slot, 1, i] = 0
                if rows[slot] >= 0:
                    for axis in range(3):
                        sums[rows[slot], axis, i] = 0


@njit(cache=True)
def values_at(keys: NDArray[np.int64], values: NDArray[np.int16], voxels: NDArray[np.int64]) -> NDArray[np.int16]:
    """The values (n,) of voxels (n, 3) from blocks (k, 512), 0 where there is none."""
    out = np.zeros(voxels.shape[0], np.int16)
    for n in range(voxels.shape[0]):
        x, y, z = voxels[n, 0], voxels[n, 1], voxels[n, 2]
        slot = slot_of(keys, block_key(x >> 3, y >> 3, z >> 3))
        if slot >= 0:
            out[n] = values[slot, (z & 7) * 64 + (y & 7) * BLOCK + (x & 7)]
    return out


@njit(cache=True)
def around(
    keys: NDArray[np.int64], values: NDArray[np.int16], voxels: NDArray[np.int64], reach: int
) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """The lowest and the highest value (n,) within ``reach`` voxels of voxels (n, 3) along every axis."""
    low, high = np.zeros(voxels.shape[0], np.int16), np.zeros(voxels.shape[0], np.int16)
    for n in range(voxels.shape[0]):
        least, most = np.int16(32767), np.int16(-32768)
        known, slot = -1, -1
        for z in range(voxels[n, 2] - reach, voxels[n, 2] + reach + 1):
            for y in range(voxels[n, 1] - reach, voxels[n, 1] + reach + 1):
                for x in range(voxels[n, 0] - reach, voxels[n, 0] + reach + 1):
                    key = block_key(x >> 3, y >> 3, z >> 3)
                    if key != known:
                        slot, known = slot_of(keys, key), key
                    value = np.int16(0)
                    if slot >= 0:
                        value = values[slot, (z & 7) * 64 + (y & 7) * BLOCK + (x & 7)]
                    least, most = min(least, value), max(most, value)
        low[n], high[n] = least, most
    return low, high
