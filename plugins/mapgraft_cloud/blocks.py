"""The block pool: counts of 8 × 8 × 8 voxels each, allocated where there is evidence."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_cloud.kernels.block_keys import BLOCK, VOLUME
from mapgraft_cloud.parameters import MOST_LOOKS
from mapgraft_cloud.region import BlockKeys, find

HITS, MISSES, SUM_X, SUM_Y, SUM_Z = range(5)
CHANNELS: Final = 5
Counts = NDArray[np.uint32]  # (k, 5, 512) hits, misses, and the sums of positions in 1/1024 voxel
_FIRST_CAPACITY: Final = 64


class BlockPool:
    """Hits, misses and position sums of all blocks of one sensor model: 20 bytes per voxel that was looked at.

    ``keys`` (k,) ascend, ``slots`` (k,) tell where in ``counts`` (capacity, 5, 512) each block is. A hit adds the mean
    position of a sweep's points in its voxel to the sums. ``most`` bounds the hits and the misses of every voxel.
    """

    __slots__ = ("counts", "keys", "most", "slots")

    def __init__(self) -> None:
        self.keys: BlockKeys = np.empty(0, np.int64)
        self.slots: NDArray[np.int64] = np.empty(0, np.int64)
        self.counts: Counts = np.zeros((_FIRST_CAPACITY, CHANNELS, VOLUME), np.uint32)
        self.most = 0

    @classmethod
    def of(cls, keys: BlockKeys, counts: NDArray[np.int64] | Counts) -> BlockPool:
        """A pool of blocks in ascending order with their counts (k, 5, 512); raises MapError when they do not fit."""
        pool = cls()
        pool.keys, pool.slots = keys.copy(), np.arange(keys.size)
        pool.reserve(int(counts[:, :SUM_X].max(initial=0)))
        pool.counts = counts.astype(np.uint32)
        return pool

    @property
    def nbytes(self) -> int:
        return self.counts.nbytes + self.keys.nbytes + self.slots.nbytes

    def reserve(self, looks: int) -> None:
        """Note that every voxel may get so many more looks; raises MapError when they might not fit any more."""
        if self.most + looks > MOST_LOOKS:
            raise MapError(
                f"a voxel can be looked at {MOST_LOOKS} times, found {self.most + looks}: "
                "map fewer of the sweeps (mission.every)"
            )
        self.most += looks

    def claim(self, wanted: BlockKeys) -> NDArray[np.int64]:
        """The slots of ascending keys; blocks that are new begin empty."""
        fresh = wanted[find(self.keys, wanted) < 0]
        if fresh.size:
            used = self.keys.size
            if used + fresh.size > self.counts.shape[0]:
                larger = np.zeros((max(2 * self.counts.shape[0], used + fresh.size), CHANNELS, VOLUME), np.uint32)
                larger[: self.counts.shape[0]] = self.counts
                self.counts = larger
            keys = np.concatenate((self.keys, fresh))
            order = np.argsort(keys, kind="stable")
            slots = np.concatenate((self.slots, np.arange(used, used + fresh.size)))
            self.keys, self.slots = keys[order], slots[order]
        return self.slots[find(self.keys, wanted)]

    def table(self) -> tuple[BlockKeys, Counts]:
        """Ascending keys (k,) and counts (k, 5, 512) of the blocks that hold evidence."""
        counts = self.counts[self.slots]
        some = counts[:, :SUM_X].any(axis=(1, 2))
        return self.keys[some], counts[some]

    def add(self, keys: BlockKeys, counts: Counts, weight: int) -> None:
        """Add the counts (k, 5, 512) of ascending blocks, ``weight`` times; raises MapError when they do not fit."""
        self.reserve(weight * int(counts[:, :SUM_X].max(initial=0)))
        slots = self.claim(keys)
        self.counts[slots] += counts * np.uint32(weight)

    def clear(self, keys: BlockKeys, mask: NDArray[np.bool_]) -> None:
        """Forget the True voxels of a mask (k, 512) over blocks."""
        places = find(self.keys, keys)
        slots = self.slots[places[places >= 0]]
        self.counts[slots] = np.where(mask[places >= 0][:, None], np.uint32(0), self.counts[slots])

    def held(self, keys: BlockKeys) -> NDArray[np.bool_]:
        """Where there is evidence, (k, 512) over blocks."""
        out = np.zeros((keys.size, VOLUME), np.bool_)
        places = find(self.keys, keys)
        slots = self.slots[places[places >= 0]]
        out[places >= 0] = self.counts[slots, :SUM_X].any(axis=1)
        return out


def empty_bits(blocks: int) -> NDArray[np.uint64]:
    return np.zeros((blocks, BLOCK), np.uint64)
