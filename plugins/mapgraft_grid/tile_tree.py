"""The tiles of one map, shared between a map and those made from it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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

    def changed(self, changes: Mapping[int, Tile | None]) -> TileTree:
        """The tree with some tiles replaced, or taken out where the new one is None."""
        blocks = dict(self._blocks)
        fresh: set[int] = set()
        for key, tile in changes.items():
            name = key & _BLOCK
            if name not in fresh:
                blocks[name] = dict(blocks.get(name, {}))
                fresh.add(name)
            if tile is None:
                blocks[name].pop(key, None)
            else:
                blocks[name][key] = tile
        for name in fresh:
            if not blocks[name]:
                del blocks[name]
        return TileTree(blocks)
