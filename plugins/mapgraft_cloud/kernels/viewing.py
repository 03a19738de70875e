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
    sums: NDArray[np.int64],
    source_keys: NDArray[np.int64],
    counts: NDArray[np.uint32],
    slots: NDArray[np.int64],
    model: NDArray[np.int64],
) -> None:
    """Add one source to log-odds (k, 512) and position sums (k, 4, 512: hits, x, y, z) of ascending blocks ``keys``.

    ``counts`` (capacity, 5, 512) is read at the ``slots`` (m,) of the ascending ``source_keys`` (m,); ``model`` (3,) is
    the evidence of a hit, of a miss, and how often the source counts.
    """
    for k in range(keys.size):
        place = slot_of(source_keys, keys[k])
        if place < 0:
            continue
        slot = slots[place]
        for i in range(VOLUME):
            hits, misses = np.int64(counts[slot, 0, i]), np.int64(counts[slot, 1, i])
            if hits or misses:
                odds[k, i] += model[2] * (hits * model[0] + misses * model[1])
                sums[k, 0, i] += model[2] * hits
                for axis in range(3):
                    sums[k, 1 + axis, i] += model[2] * np.int64(counts[slot, 2 + axis, i])


@njit(cache=True)
def mean_offsets(sums: NDArray[np.int64], offsets: NDArray[np.uint16]) -> None:
    """The mean position (k, 512, 3) in a voxel from sums (k, 4, 512), in 1/1024 voxel; the middle without hits."""
    for k in range(sums.shape[0]):
        for i in range(VOLUME):
            hits = sums[k, 0, i]
            for axis in range(3):
                offsets[k, i, axis] = np.uint16(sums[k, 1 + axis, i] // hits) if hits > 0 else np.uint16(512)


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
