"""Evidence about point landmarks: a row of integers per cell of the plane, in a sorted table that is never written."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Region

Keys = NDArray[np.int64]  # (n,) packed cell indices, strictly rising
Counts = NDArray[np.int64]  # (n, 4): looks, sightings, sum of x, sum of y (the sums in POSITION_STEP_M)

POSITION_STEP_M = 2.0**-10  # about a millimetre
LOOKS, SIGHTINGS, SUM_X, SUM_Y = range(4)
COLUMNS = 4
INDEX_LIMIT = 2**30  # largest cell index in either direction
_STRIDE = 2**32


def pack(ix: NDArray[np.int64], iy: NDArray[np.int64]) -> Keys:
    """Keys of cell indices; a key plus ``offset(dx, dy)`` is the key of the cell that far away."""
    return ix * _STRIDE + iy


def offset(dx: int, dy: int) -> int:
    """What to add to a key to get ``dx``, ``dy`` cells further."""
    return dx * _STRIDE + dy


def unpack(keys: Keys) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The inverse of ``pack``."""
    iy = (keys + _STRIDE // 2) % _STRIDE - _STRIDE // 2
    return (keys - iy) // _STRIDE, iy


def keys_at(points_m: NDArray[np.floating], cell_m: float) -> Keys:
    """Keys (n,) of the cells that hold the points (n, 2) in metres; raises MapError beyond the largest index."""
    index = np.floor(points_m / cell_m)
    if index.size and not np.abs(index).max() < INDEX_LIMIT:
        raise MapError(f"a landmark map reaches {INDEX_LIMIT * cell_m:.0f} m, found a point beyond: check the poses")
    whole = index.astype(np.int64)
    return pack(whole[:, 0], whole[:, 1])


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A table of evidence: ``keys`` strictly rising, ``counts`` beside it; cells without evidence have no row.

    A cell's *looks* are the scans that would have seen a landmark in it, its *sightings* the landmarks found in it,
    and the sums add up where they were found. All four add, so that evidence can be joined and weighted exactly.
    """

    keys: Keys
    counts: Counts

    def __post_init__(self) -> None:
        self.keys.setflags(write=False)
        self.counts.setflags(write=False)

    @classmethod
    def empty(cls) -> Cells:
        return cls(np.empty(0, np.int64), np.empty((0, COLUMNS), np.int64))

    @classmethod
    def summed(cls, keys: NDArray[np.int64], counts: Counts) -> Cells:
        """Rows in any order, those of one cell added up."""
        unique, inverse = np.unique(keys, return_inverse=True)
        total = np.zeros((len(unique), COLUMNS), np.int64)
        np.add.at(total, inverse, counts)
        return cls(unique, total)

    def __len__(self) -> int:
        return len(self.keys)

    def at(self, keys: NDArray[np.int64]) -> Counts:
        """The counts of any cells (n, 4); zeros where there is no evidence."""
        counts = np.zeros((len(keys), COLUMNS), np.int64)
        if len(self.keys):
            place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
            found = self.keys[place] == keys
            counts[found] = self.counts[place[found]]
        return counts

    def plus(self, other: Cells, times: int = 1) -> Cells:
        """This evidence and ``times`` the other's."""
        place = np.searchsorted(self.keys, other.keys)
        found = np.zeros(len(other.keys), np.bool_)
        inside = place < len(self.keys)
        found[inside] = self.keys[place[inside]] == other.keys[inside]
        counts = self.counts.copy()
        counts[place[found]] += other.counts[found] * times
        if found.all():
            return Cells(self.keys, counts)
        new = ~found
        return Cells(
            np.insert(self.keys, place[new], other.keys[new]),
            np.insert(counts, place[new], other.counts[new] * times, axis=0),
        )

    def without(self, keys: Keys) -> Cells:
        """All rows but those of these cells."""
        kept = np.isin(self.keys, keys, assume_unique=True, invert=True)
        return Cells(self.keys[kept], self.counts[kept])


@dataclass(frozen=True, slots=True, eq=False)
class CellRegion:
    """A set of cells of one size."""

    cell_m: float
    keys: Keys

    def union(self, other: CellRegion) -> CellRegion:
        self._check(other)
        return CellRegion(self.cell_m, np.union1d(self.keys, other.keys))

    def minus(self, other: CellRegion) -> CellRegion:
        self._check(other)
        return CellRegion(self.cell_m, np.setdiff1d(self.keys, other.keys, assume_unique=True))

    def __len__(self) -> int:
        return len(self.keys)

    def _check(self, other: CellRegion) -> None:
        if other.cell_m != self.cell_m:
            raise MapError(f"regions of {self.cell_m} m and {other.cell_m} m cells do not mix: place the layer first")


def as_region(region: Region) -> CellRegion:
    """The region as one of this type; raises MapError when it is of another."""
    if not isinstance(region, CellRegion):
        raise MapError(f"a landmark map needs a region of its own cells, found a {type(region).__name__}")
    return region
