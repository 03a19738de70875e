"""Moving evidence into another frame, by integers: positions in 1/1024 voxel, coefficients with 24 binary places."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_cloud.kernels.block_keys import BLOCK, block_key, block_x, block_y, block_z, slot_of

STEP_BITS = 10  # a position is given in 1/1024 voxel
STEPS = 1 << STEP_BITS
PLACES = 24  # binary places of the linear part
BEYOND = 1 << 30  # a voxel that does not exist: farther is no farther
_HALF = 1 << (PLACES - 1)


@njit(cache=True)
def _moved(linear: NDArray[np.int64], x: int, y: int, z: int, axis: int) -> int:
    return int((linear[axis, 0] * x + linear[axis, 1] * y + linear[axis, 2] * z + _HALF) >> PLACES)


@njit(cache=True)
def scattered(
    keys: NDArray[np.int64],
    slots: NDArray[np.int64],
    counts: NDArray[np.uint32],
    sums: NDArray[np.uint32],
    rows: NDArray[np.int64],
    linear: NDArray[np.int64],
    shift: NDArray[np.int64],
    out_voxels: NDArray[np.int32],
    out_counts: NDArray[np.int64],
) -> int:
    """Where every voxel with hits of some blocks (k,) goes: to where its mean point lies, with all that it counted.

    ``counts`` (capacity, 2, 512) are read at ``slots`` (k,), ``sums`` (s, 3, 512) at their ``rows`` (capacity,).
    ``out_voxels`` (n, 3) and ``out_counts`` (n, 5: hits, misses, position sums) have room for all of them; returns how
    many there are. What the mean leaves of the sum of positions is turned along, so that nothing is lost when nothing
    moves.
    """
    n = 0
    mean, rest = np.empty(3, np.int64), np.empty(3, np.int64)
    for block in range(keys.size):
        slot = slots[block]
        row = rows[slot]
        if row < 0:
            continue
        base_x, base_y, base_z = block_x(keys[block]), block_y(keys[block]), block_z(keys[block])
        for i in range(BLOCK**3):
            hits = np.int64(counts[slot, 0, i])
            if hits == 0:
                continue
            corner = (base_x * BLOCK + i % BLOCK, base_y * BLOCK + i // BLOCK % BLOCK, base_z * BLOCK + i // 64)
            for axis in range(3):
                total = np.int64(sums[row, axis, i])
                mean[axis] = corner[axis] * STEPS + total // hits
                rest[axis] = total - total // hits * hits
            out_counts[n, 0], out_counts[n, 1] = hits, np.int64(counts[slot, 1, i])
            for axis in range(3):
                at = _moved(linear, mean[0], mean[1], mean[2], axis) + shift[axis]
                out_voxels[n, axis] = max(-BEYOND, min(BEYOND, at >> STEP_BITS))
                total = (at & (STEPS - 1)) * hits + _moved(linear, rest[0], rest[1], rest[2], axis)
                out_counts[n, 2 + axis] = min(max(total, 0), (STEPS - 1) * hits)
            n += 1
    return n


@njit(cache=True)
def together(
    blocks: NDArray[np.int64], places: NDArray[np.int64], counts: NDArray[np.int64], model: NDArray[np.int64]
) -> int:
    """Make one of all rows (n,) that come to one voxel, in place; they are sorted by block and place.

    It takes the counts (n, 5) of the one that is most surely occupied by ``model`` (hit, miss), of equal ones with most
    hits, of equal ones the first: one look that fell into several of them was one look all the same. Its point is the
    mean of all points. Returns how many are left.
    """
    n, i = 0, 0
    while i < blocks.size:
        best, hits = i, np.int64(0)
        total = np.zeros(3, np.int64)
        j = i
        while j < blocks.size and blocks[j] == blocks[i] and places[j] == places[i]:
            odds = counts[j, 0] * model[0] + counts[j, 1] * model[1]
            most = counts[best, 0] * model[0] + counts[best, 1] * model[1]
            if odds > most or (odds == most and counts[j, 0] > counts[best, 0]):
                best = j
            hits += counts[j, 0]
            for axis in range(3):
                total[axis] += counts[j, 2 + axis]
            j += 1
        kept = counts[best, 0]
        blocks[n], places[n] = blocks[i], places[i]
        counts[n, 0], counts[n, 1] = kept, counts[best, 1]
        for axis in range(3):  # the mean, and its rest, of as many points as are kept
            counts[n, 2 + axis] = total[axis] // hits * kept + total[axis] % hits * kept // hits
        n += 1
        i = j
    return n


@njit(cache=True)
def gathered(
    target_keys: NDArray[np.int64],
    target: NDArray[np.uint32],
    keys: NDArray[np.int64],
    slots: NDArray[np.int64],
    counts: NDArray[np.uint32],
    linear: NDArray[np.int64],
    shift: NDArray[np.int64],
) -> None:
    """Give voxels (m, 2, 512) without hits the misses of the source voxel at their centre, unless that one has hits.

    ``linear`` and ``shift`` lead from the target back to the source: p_source = linear · (p_target − shift).
    """
    for block in range(target_keys.size):
        base_x, base_y, base_z = (
            block_x(target_keys[block]),
            block_y(target_keys[block]),
            block_z(target_keys[block]),
        )
        known, slot = -1, -1
        for i in range(BLOCK**3):
            if target[block, 0, i] > 0:
                continue
            x = (base_x * BLOCK + i % BLOCK) * STEPS + STEPS // 2 - shift[0]
            y = (base_y * BLOCK + i // BLOCK % BLOCK) * STEPS + STEPS // 2 - shift[1]
            z = (base_z * BLOCK + i // 64) * STEPS + STEPS // 2 - shift[2]
            at_x = _moved(linear, x, y, z, 0) >> STEP_BITS
            at_y = _moved(linear, x, y, z, 1) >> STEP_BITS
            at_z = _moved(linear, x, y, z, 2) >> STEP_BITS
            key = block_key(at_x >> 3, at_y >> 3, at_z >> 3)
            if key != known:
                place = slot_of(keys, key)
                slot, known = (slots[place] if place >= 0 else -1), key
            if slot >= 0:
                j = (at_z & 7) * 64 + (at_y & 7) * BLOCK + (at_x & 7)
                if counts[slot, 0, j] == 0:
                    target[block, 1, i] = counts[slot, 1, j]
