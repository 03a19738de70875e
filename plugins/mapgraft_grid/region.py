"""Sets of cells of one lattice: what an observation touched, what a donor changed, what a robot updated itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_grid.kernels import bits
from mapgraft_grid.kernels.tile_keys import TILE
from mapgraft_grid.parameters import Lattice
from mapgraft_grid.tiles import BitRows, TileKeys


@dataclass(frozen=True, slots=True, eq=False)
class GridRegion:
    """Cells of a lattice, immutable.

    ``keys`` (k,) int64 are the tiles that hold a cell, ascending; ``rows`` (k, 64) uint64 their rows, lowest bit =
    lowest x. Equal sets have equal arrays. Build it with ``from_bits``, which leaves out empty tiles.
    """

    lattice: Lattice
    keys: TileKeys
    rows: BitRows

    def __post_init__(self) -> None:
        self.keys.setflags(write=False)
        self.rows.setflags(write=False)

    @classmethod
    def empty(cls, lattice: Lattice) -> GridRegion:
        return cls(lattice, np.empty(0, np.int64), np.empty((0, TILE), np.uint64))

    @classmethod
    def from_bits(cls, lattice: Lattice, keys: TileKeys, rows: BitRows) -> GridRegion:
        """The cells of tiles in ascending order, of which some may be empty."""
        some = rows.any(axis=1)
        return cls(lattice, keys.copy(), rows.copy()) if some.all() else cls(lattice, keys[some], rows[some])

    @classmethod
    def from_mask(cls, lattice: Lattice, origin_cell: tuple[int, int], mask: NDArray[np.bool_]) -> GridRegion:
        """The True cells of a window (h, w) whose element [0, 0] is ``origin_cell`` (ix, iy)."""
        if mask.size == 0:
            return cls.empty(lattice)
        keys, rows = bits.from_mask(np.ascontiguousarray(mask), *origin_cell)
        return cls(lattice, keys.copy(), rows.copy())

    def mask(self, origin_cell: tuple[int, int], shape: tuple[int, int]) -> NDArray[np.bool_]:
        """The window (h, w) whose element [0, 0] is ``origin_cell`` (ix, iy): True where the region has the cell."""
        out = np.zeros(shape, np.bool_)
        bits.to_mask(self.keys, self.rows, *origin_cell, out)
        return out

    def union(self, other: GridRegion) -> GridRegion:
        """The cells in either; raises MapError when both hold cells of different lattices."""
        if not self.keys.size:
            return other
        if not other.keys.size:
            return self
        self._require_same_lattice(other)
        keys, rows = bits.union(self.keys, self.rows, other.keys, other.rows)
        return GridRegion(self.lattice, keys.copy(), rows.copy())

    def minus(self, other: GridRegion) -> GridRegion:
        """The cells that the other does not have; raises MapError as ``union``."""
        return self._meet(other, without=True)

    def intersection(self, other: GridRegion) -> GridRegion:
        """The cells in both; raises MapError as ``union``."""
        return self._meet(other, without=False)

    def meets(self, other: GridRegion) -> bool:
        """Whether any cell is in both; raises MapError as ``union``."""
        if not (self.keys.size and other.keys.size):
            return False
        self._require_same_lattice(other)
        return bool(bits.share(self.keys, self.rows, other.keys, other.rows))

    def __len__(self) -> int:
        return bits.population(self.rows)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, GridRegion)
            and (self.lattice == other.lattice or not (self.keys.size or other.keys.size))
            and np.array_equal(self.keys, other.keys)
            and np.array_equal(self.rows, other.rows)
        )

    def __hash__(self) -> int:
        return hash((self.keys.tobytes(), self.rows.tobytes()))

    def _meet(self, other: GridRegion, without: bool) -> GridRegion:
        if self.keys.size and other.keys.size:
            self._require_same_lattice(other)
        keys, rows = bits.meet(self.keys, self.rows, other.keys, other.rows, without)
        return GridRegion(self.lattice, keys.copy(), rows.copy())

    def _require_same_lattice(self, other: GridRegion) -> None:
        if self.lattice != other.lattice:
            raise MapError(
                f"two regions must lie on one lattice, found {self.lattice} and {other.lattice}: "
                "place the layers at one resolution first"
            )
