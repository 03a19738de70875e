"""The block pool: counts of 8 × 8 × 8 voxels each, allocated where there is evidence."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_cloud.kernels import viewing
from mapgraft_cloud.kernels.block_keys import BLOCK, VOLUME
from mapgraft_cloud.parameters import MOST_LOOKS
from mapgraft_cloud.region import BitLayers, BlockKeys, find

HITS, MISSES = range(2)
AXES: Final = 3
Counts = NDArray[np.uint32]  # (k, 2, 512) hits and misses
Sums = NDArray[np.uint32]  # (s, 3, 512) sums of positions x, y, z in 1/1024 voxel
Rows = NDArray[np.int64]  # (k,) which row of sums belongs to a block, -1 where it has no hits
AT_ONCE: Final = 1024  # blocks that are copied at once: 10 MB
_FIRST_CAPACITY: Final = 64


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Some blocks in ascending order: ``keys`` (k,), ``counts`` (k, 2, 512), and the ``sums`` (s, 3, 512) of those
    that have hits, the ``solid`` (s,) ones."""

    keys: BlockKeys
    counts: Counts
    solid: NDArray[np.int64]
    sums: Sums

    @property
    def most(self) -> int:
        return int(self.counts.max(initial=0))


class BlockPool:
    """Hits and misses of all blocks of one sensor model, and where in their voxels the hits lie.

    ``keys`` (k,) ascend, ``slots`` (k,) tell where in ``counts`` (capacity, 2, 512) each block is. A hit adds the mean
    position of a sweep's points in its voxel to the sums; only blocks with hits have them: ``rows`` (capacity,) tells
    where in ``sums`` (capacity, 3, 512). So a voxel costs 8 bytes, and 12 more beside walls. There is room for
    ``capacity`` blocks at first.
    """

    __slots__ = ("counts", "keys", "rows", "slots", "solid", "sums")

    def __init__(self, capacity: int = _FIRST_CAPACITY) -> None:
        self.keys: BlockKeys = np.empty(0, np.int64)
        self.slots: NDArray[np.int64] = np.empty(0, np.int64)
        self.counts: Counts = np.zeros((capacity, 2, VOLUME), np.uint32)
        self.rows: Rows = np.full(capacity, -1, np.int64)
        self.sums: Sums = np.zeros((_FIRST_CAPACITY, AXES, VOLUME), np.uint32)
        self.solid = 0  # how many rows of sums are taken

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in (self.counts, self.sums, self.keys, self.slots, self.rows))

    @property
    def most(self) -> int:
        """The most hits or misses of any voxel."""
        return int(self.counts[: self.keys.size].max(initial=0))

    def require_room(self, keys: BlockKeys, looks: int) -> None:
        """Raises MapError where a voxel of these blocks cannot count so many more looks."""
        places = find(self.keys, keys)
        slots = self.slots[places[places >= 0]]
        require_countable(int(viewing.most(self.counts, slots)) + looks)

    def claim(self, wanted: BlockKeys) -> NDArray[np.int64]:
        """The slots of ascending keys; blocks that are new begin empty."""
        fresh = wanted[find(self.keys, wanted) < 0]
        if fresh.size:
            used = self.keys.size
            self._grow(used + fresh.size)
            keys = np.concatenate((self.keys, fresh))
            order = np.argsort(keys, kind="stable")
            slots = np.concatenate((self.slots, np.arange(used, used + fresh.size)))
            self.keys, self.slots = keys[order], slots[order]
        return self.slots[find(self.keys, wanted)]

    def claim_sums(self, slots: NDArray[np.int64]) -> Rows:
        """The rows of the position sums of slots that differ; those that are new begin at zero."""
        fresh = slots[self.rows[slots] < 0]
        if fresh.size:
            needed = self.solid + fresh.size
            if needed > self.sums.shape[0]:
                self.sums = _longer(self.sums, max(2 * self.sums.shape[0], needed))
            self.rows[fresh] = np.arange(self.solid, needed)
            self.solid = needed
        return self.rows[slots]

    def _grow(self, needed: int) -> None:
        if needed <= self.counts.shape[0]:
            return
        capacity = max(2 * self.counts.shape[0], needed)
        rows = np.full(capacity, -1, np.int64)
        rows[: self.rows.size] = self.rows
        self.counts, self.rows = _longer(self.counts, capacity), rows

    def filled(self) -> BlockKeys:
        """The blocks that hold evidence, ascending."""
        return self.keys[viewing.filled(self.counts, self.slots)]

    def blocks(self, at_once: int = AT_ONCE) -> Iterator[Blocks]:
        """Copies of the blocks that hold evidence, ascending, ``at_once`` in each but the last."""
        keys = self.filled()
        for first in range(0, keys.size, at_once):
            yield self.some(keys[first : first + at_once])

    def some(self, keys: BlockKeys) -> Blocks:
        """Copies of blocks that are all there."""
        slots = self.slots[find(self.keys, keys)]
        counts = self.counts[slots]
        solid = np.flatnonzero(counts[:, HITS].any(axis=1))
        return Blocks(keys, counts, solid, self.sums[self.rows[slots[solid]]])

    def add(self, blocks: Blocks, weight: int = 1) -> None:
        """Add the counts of blocks, ``weight`` times; that they fit was asked before."""
        slots = self.claim(blocks.keys)
        self.counts[slots] += blocks.counts * np.uint32(weight)
        rows = self.claim_sums(slots[blocks.solid])
        self.sums[rows] += blocks.sums * np.uint32(weight)

    def clear(self, keys: BlockKeys, bits: BitLayers) -> None:
        """Forget the voxels whose bits (k, 8) are set in blocks."""
        places = find(self.keys, keys)
        viewing.clear(self.counts, self.sums, self.rows, self.slots[places[places >= 0]], bits[places >= 0])

    def held(self, keys: BlockKeys) -> BitLayers:
        """Where there is evidence, as bits (k, 8) of blocks."""
        bits = empty_bits(keys.size)
        places = find(self.keys, keys)
        here = np.flatnonzero(places >= 0)
        viewing.held(self.counts, self.slots[places[here]], here, bits)
        return bits


def require_countable(looks: int) -> None:
    """Raises MapError where a voxel would be looked at more often than can be counted."""
    if looks > MOST_LOOKS:
        raise MapError(
            f"a voxel can be looked at {MOST_LOOKS} times, found {looks}: map fewer of the sweeps (mission.every)"
        )


def empty_bits(blocks: int) -> BitLayers:
    return np.zeros((blocks, BLOCK), np.uint64)


def _longer(array: NDArray[np.uint32], length: int) -> NDArray[np.uint32]:
    out = np.zeros((length, *array.shape[1:]), np.uint32)
    out[: array.shape[0]] = array
    return out
