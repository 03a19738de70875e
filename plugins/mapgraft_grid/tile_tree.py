"""The tiles of one map, shared between a map and those made from it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft_grid.kernels.tile_keys import KEY_BITS

_BLOCK_BITS: Final = 4  # a block is 16 × 16 tiles
_PART: Final = ((1 << (KEY_BITS - _BLOCK_BITS)) - 1) << _BLOCK_BITS
_BLOCK: Final = (_PART << KEY_BITS) | _PART  # the bits of a key that name its block


class Tile(NamedTuple):
    """64 × 64 cells of a map: clamped log-odds (64, 64) int16, read-only, and how many of them are known."""

    log_odds: NDArray[np.int16]
    known: int


class TileTree(Mapping[int, Tile]):
    """An immutable mapping from tile key to tile. A changed copy costs the blocks that changed, not the map."""

    __slots__ = ("_blocks",)

    def __init__(self, blocks: dict[int, dict[int, Tile]] | None = None) -> None:
        self._blocks = blocks or {}

    def __getitem__(self, key: int) -> Tile:
        return self._blocks[key & _BLOCK][key]

    def __iter__(self) -> Iterator[int]:
        """The keys in ascending order."""
        return iter(sorted(key for block in self._blocks.values() for key in block))

    def __len__(self) -> int:
        return sum(map(len, self._blocks.values()))

    def changed(self, changes: Iterable[tuple[int, Tile | None]]) -> tuple[TileTree, int]:
        """The tree with some tiles replaced, or taken out where it is None, and how many more cells it knows."""
        blocks = dict(self._blocks)
        fresh: dict[int, dict[int, Tile]] = {}
        grown = 0
        for key, tile in changes:
            name = key & _BLOCK
            block = fresh.get(name)
            if block is None:
                block = fresh[name] = blocks[name] = dict(blocks.get(name, {}))
            before = block.pop(key, None)
            if before is not None:
                grown -= before.known
            if tile is not None:
                grown += tile.known
                block[key] = tile
        for name, block in fresh.items():
            if not block:
                del blocks[name]
        return TileTree(blocks), grown
