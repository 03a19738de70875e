"""Evidence as a sorted table of integers that is never written: what is added makes a new table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Keys = NDArray[np.int64]  # (n,) strictly rising, see kernels.keys
Counts = NDArray[np.int64]  # (n, columns)


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Rows of counts by key; a key without evidence has no row. Equal evidence has equal arrays."""

    keys: Keys
    counts: Counts

    def __post_init__(self) -> None:
        self.keys.setflags(write=False)
        self.counts.setflags(write=False)

    @classmethod
    def empty(cls, columns: int) -> Table:
        return cls(np.empty(0, np.int64), np.empty((0, columns), np.int64))

    @classmethod
    def summed(cls, keys: NDArray[np.int64], counts: Counts, most: int | None = None) -> Table:
        """Rows in any order, those of one key added up; of the column ``most`` the largest."""
        unique, inverse = np.unique(keys, return_inverse=True)
        total = np.zeros((len(unique), counts.shape[1]), np.int64)
        np.add.at(total, inverse, counts)
        if most is not None:
            total[:, most] = 0
            np.maximum.at(total[:, most], inverse, counts[:, most])
        return cls(unique, total)

    def __len__(self) -> int:
        return len(self.keys)

    def at(self, keys: NDArray[np.int64]) -> Counts:
        """The counts of any keys (n, columns); zeros where there is no row."""
        out = np.zeros((len(keys), self.counts.shape[1]), np.int64)
        if len(self.keys):
            place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
            found = self.keys[place] == keys
            out[found] = self.counts[place[found]]
        return out

    def plus(self, other: Table, times: int = 1) -> Table:
        """This evidence and ``times`` the other's."""
        if not len(other):
            return self
        if not len(self) and times == 1:
            return other
        place = np.searchsorted(self.keys, other.keys)
        found = np.zeros(len(other.keys), np.bool_)
        inside = place < len(self.keys)
        found[inside] = self.keys[place[inside]] == other.keys[inside]
        counts = self.counts.copy()
        counts[place[found]] += other.counts[found] * times
        if found.all():
            return Table(self.keys, counts)
        new = ~found
        return Table(
            np.insert(self.keys, place[new], other.keys[new]),
            np.insert(counts, place[new], other.counts[new] * times, axis=0),
        )

    def without(self, keys: Keys) -> Table:
        """All rows but those of these keys (ascending)."""
        if not len(self) or not len(keys):
            return self
        place = np.minimum(np.searchsorted(keys, self.keys), len(keys) - 1)
        kept = keys[place] != self.keys
        return Table(self.keys[kept], self.counts[kept])

    def replaced(self, keys: Keys, counts: Counts) -> Table:
        """This table with other counts at these keys (ascending); rows of zeros are left out."""
        some = counts.any(axis=1)
        return self.without(keys).plus(Table(keys[some], counts[some]))

    def equals(self, other: Table) -> bool:
        return np.array_equal(self.keys, other.keys) and np.array_equal(self.counts, other.counts)
