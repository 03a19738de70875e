"""The tile pool: counts of 64 × 64 cells each, allocated where there is evidence."""

from __future__ import annotations

from typing import Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapgraft_grid.kernels import counting, index
from mapgraft_grid.kernels.tile_keys import TILE

TileKeys = NDArray[np.int64]  # (k,) see kernels.tile_keys
BitRows = NDArray[np.uint64]  # (k, 64) one word per row of a tile, lowest bit = lowest x
Slots = NDArray[np.int32]  # (k,) places in a pool, -1 where there is none

PoolArrays = tuple[
    NDArray[np.uint16], NDArray[np.uint16], NDArray[np.int32], NDArray[np.uint32], NDArray[np.int32], NDArray[np.int32]
]
Cell = TypeVar("Cell", bound=np.generic)

_FIRST_CAPACITY: Final = 16


class TileIndex:
    """Tile key → slot. Grows with the number of tiles, not with the area between them."""

    __slots__ = ("_keys", "_size", "_table")

    def __init__(self) -> None:
        self._keys = np.empty(_FIRST_CAPACITY, np.int64)
        self._table = np.full(2 * _FIRST_CAPACITY, -1, np.int32)
        self._size = 0

    def __len__(self) -> int:
        return self._size

    @property
    def capacity(self) -> int:
        return self._keys.size

    @property
    def keys(self) -> TileKeys:
        """The keys in the order of their slots."""
        return self._keys[: self._size]

    def find(self, wanted: TileKeys) -> Slots:
        slots: Slots = index.find(self._table, self._keys, wanted)
        return slots

    def claim(self, wanted: TileKeys) -> Slots:
        """The slots of the keys; keys that are new get the next free ones."""
        slots = np.empty(wanted.size, np.int32)
        size = index.claim(self._table, self._keys, self._size, wanted, slots)
        if size > self._keys.size:
            self._grow(size)
            size = index.claim(self._table, self._keys, self._size, wanted, slots)
        self._size = size
        return slots

    def _grow(self, needed: int) -> None:
        capacity = self._keys.size
        while capacity < needed:
            capacity *= 2
        self._keys = enlarged(self._keys, capacity)
        self._table = np.full(2 * capacity, -1, np.int32)
        index.rebuild(self._table, self._keys, self._size)


class SparsePool(Generic[Cell]):
    """Tiles that only some slots of the tile pool have, such as counts beyond 65 535."""

    __slots__ = ("_used", "of", "tiles")

    def __init__(self, tile_shape: tuple[int, ...], dtype: type[Cell]) -> None:
        self.of = np.full(_FIRST_CAPACITY, -1, np.int32)  # (slots of the tile pool,) → tile, or -1
        self.tiles: NDArray[Cell] = np.zeros((0, *tile_shape), dtype)
        self._used = 0

    def __len__(self) -> int:
        return self._used

    def follow(self, capacity: int) -> None:
        """Take the tile pool's new capacity."""
        of = np.full(capacity, -1, np.int32)
        of[: self.of.size] = self.of
        self.of = of

    def claim(self, slot: int) -> int:
        """The tile of that slot, allocated when it is new."""
        if self.of[slot] < 0:
            if self._used == self.tiles.shape[0]:
                self.tiles = enlarged(self.tiles, max(4, 2 * self._used))
            self.of[slot] = self._used
            self._used += 1
        return int(self.of[slot])

    def write(self, slot: int, values: NDArray[Cell]) -> None:
        """Set the tile of that slot, allocated when it is new."""
        tile = self.claim(slot)
        self.tiles[tile] = values


class TilePool:
    """Hits and misses of all tiles, and what was baked into them.

    ``hits`` and ``misses`` are (capacity, 64, 64) uint16, indexed [slot, row, column]. A tile whose counts might not
    fit any more moves them to ``wide`` (n, 2, 64, 64) uint32 and counts on from zero: a count is always the sum of
    both. ``absorbed`` (n, 64, 64) int32 holds log-odds of other sources, 1024 per nat.
    """

    __slots__ = ("_looks", "absorbed", "hits", "index", "misses", "wide")

    def __init__(self) -> None:
        self.index = TileIndex()
        shape = (self.index.capacity, TILE, TILE)
        self.hits = np.zeros(shape, np.uint16)
        self.misses = np.zeros(shape, np.uint16)
        self._looks = np.zeros(self.index.capacity, np.int32)  # upper bound of the counts of each tile
        self.wide: SparsePool[np.uint32] = SparsePool((2, TILE, TILE), np.uint32)
        self.absorbed: SparsePool[np.int32] = SparsePool((TILE, TILE), np.int32)

    def arrays(self) -> PoolArrays:
        """What kernels take: hits, misses, wide of and tiles, absorbed of and tiles."""
        return self.hits, self.misses, self.wide.of, self.wide.tiles, self.absorbed.of, self.absorbed.tiles

    def claim(self, keys: TileKeys) -> Slots:
        """The slots of the tiles, allocated where they are new."""
        slots = self.index.claim(keys)
        capacity = self.index.capacity
        if capacity > self._looks.size:
            self.hits = enlarged(self.hits, capacity)
            self.misses = enlarged(self.misses, capacity)
            self._looks = enlarged(self._looks, capacity)
            self.wide.follow(capacity)
            self.absorbed.follow(capacity)
        return slots

    def count(self, keys: TileKeys, free: BitRows, hit: BitRows) -> None:
        """Add one miss to every free cell and one hit to every hit cell."""
        slots = self.claim(keys)
        done = counting.count(0, slots, free, hit, self.hits, self.misses, self._looks)
        while done < slots.size:
            self._make_room(int(slots[done]))
            done = counting.count(done, slots, free, hit, self.hits, self.misses, self._looks)

    def set_counts(self, keys: TileKeys, hits: NDArray[np.uint32], misses: NDArray[np.uint32]) -> None:
        """Give new tiles their counts (k, 64, 64)."""
        for slot, tile_hits, tile_misses in zip(self.claim(keys), hits, misses, strict=True):
            most = max(int(tile_hits.max()), int(tile_misses.max()))
            if most > counting.FULL:
                wide = self.wide.claim(int(slot))
                self.wide.tiles[wide, 0], self.wide.tiles[wide, 1] = tile_hits, tile_misses
            else:
                self.hits[slot], self.misses[slot] = tile_hits, tile_misses
                self._looks[slot] = most

    def counts(self, keys: TileKeys) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
        """Hits and misses (k, 64, 64) of tiles that are all in the pool."""
        slots = self.index.find(keys)
        hits, misses = self.hits[slots].astype(np.uint32), self.misses[slots].astype(np.uint32)
        wide = self.wide.of[slots]
        more = wide >= 0
        hits[more] += self.wide.tiles[wide[more], 0]
        misses[more] += self.wide.tiles[wide[more], 1]
        return hits, misses

    def most(self) -> int:
        """The largest count of any cell."""
        used = len(self.index)
        wide = np.flatnonzero(self.wide.of[:used] >= 0)
        narrow = (self.hits[:used], self.misses[:used])
        return max(int(counts.max(initial=0)) for counts in (*narrow, *self.counts(self.index.keys[wide])))

    def _make_room(self, slot: int) -> None:
        """Let a tile count on: by its true maximum when that is below the bound, else by moving it to ``wide``."""
        most = max(int(self.hits[slot].max()), int(self.misses[slot].max()))
        if most >= counting.FULL:
            wide = self.wide.claim(slot)
            self.wide.tiles[wide, 0] += self.hits[slot]
            self.wide.tiles[wide, 1] += self.misses[slot]
            self.hits[slot] = 0
            self.misses[slot] = 0
            most = 0
        self._looks[slot] = most


def enlarged(array: NDArray[Cell], length: int) -> NDArray[Cell]:
    """The array with ``length`` first entries, zero where they are new."""
    out = np.zeros((length, *array.shape[1:]), array.dtype)
    out[: array.shape[0]] = array
    return out
