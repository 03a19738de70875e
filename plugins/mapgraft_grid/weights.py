"""How often a donor's evidence is applied, tile by tile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_grid.tiles import TileKeys

MOST: Final = 3  # applications of one donor to one tile (the paper, section 4.1)


@dataclass(frozen=True, slots=True, eq=False)
class TileWeights:
    """The application count 0 … 3 of single tiles of the receiver's lattice; every other tile weighs 1.

    ``keys`` (k,) int64 ascending, ``counts`` (k,) uint8. Raises MapError when they are not that.
    """

    keys: TileKeys
    counts: NDArray[np.uint8]

    def __post_init__(self) -> None:
        if self.keys.dtype != np.int64 or self.counts.dtype != np.uint8 or self.keys.shape != self.counts.shape:
            raise MapError(
                "tile weights need int64 keys and as many uint8 counts, "
                f"found {self.keys.dtype} {self.keys.shape} and {self.counts.dtype} {self.counts.shape}"
            )
        if (np.diff(self.keys) <= 0).any() or (self.counts > MOST).any():
            raise MapError(f"tile weights need ascending keys and counts from 0 to {MOST}")
        self.keys.setflags(write=False)
        self.counts.setflags(write=False)

    @classmethod
    def plain(cls) -> TileWeights:
        """Every tile once: plain Bayes."""
        return cls(np.empty(0, np.int64), np.empty(0, np.uint8))

    def of(self, keys: TileKeys) -> NDArray[np.uint8]:
        """The counts (k,) of these tiles."""
        out = np.ones(keys.size, np.uint8)
        if self.keys.size:
            place = np.minimum(np.searchsorted(self.keys, keys), self.keys.size - 1)
            listed = self.keys[place] == keys
            out[listed] = self.counts[place[listed]]
        return out


@dataclass(frozen=True, slots=True)
class Bounds:
    """How far a prior may speak in any cell: its evidence is cut off at these log-odds, 1024 per nat.

    What no robot has observed (a plan, say) enters so: a few observations override it. Raises MapError unless both are
    positive.
    """

    occupied: int
    free: int

    def __post_init__(self) -> None:
        if self.occupied <= 0 or self.free <= 0:
            raise MapError(f"the bounds of a prior must be above 0, found {self.occupied} and {self.free}")
