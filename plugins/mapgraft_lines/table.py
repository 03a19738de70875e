"""Evidence as a sorted table of integers whose rows never change: what is added makes a new table."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapgraft_lines.kernels import merging

Keys = NDArray[np.int64]  # (n,) strictly rising, see kernels.keys
Counts = NDArray[np.int64]  # (n, columns)


def distinct(*keys: NDArray[np.int64]) -> Keys:
    """All keys of some arrays, each once, ascending. By sorting: numpy finds them by hashing, much slower if many."""
    every = np.sort(np.concatenate(keys), kind="stable")  # which takes sorted parts as they are
    return every[np.flatnonzero(np.diff(every, prepend=np.int64(-1)))] if len(every) else every


class Table:
    """Rows of counts by key; a key without evidence has no row. Equal evidence has equal arrays.

    Adding little to much is cheap. A table keeps what was added beside what there was, in runs of which each has at
    least twice the rows of the next, so that a row is moved as often as the logarithm of their number and not whenever
    something is added. ``keys`` (n,) and ``counts`` (n, columns) put the runs together when they are asked for.
    """

    __slots__ = ("__weakref__", "_runs")

    def __init__(self, keys: Keys, counts: Counts) -> None:
        self._runs: tuple[_Run, ...] = (_Run(keys, counts),)

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

    @property
    def keys(self) -> Keys:
        return self._whole().keys

    @property
    def counts(self) -> Counts:
        return self._whole().counts

    @property
    def is_empty(self) -> bool:
        """Whether there is no row, without putting them together."""
        return not any(len(run.keys) for run in self._runs)

    def __len__(self) -> int:
        return len(self.keys)

    def at(self, keys: NDArray[np.int64]) -> Counts:
        """The counts of any keys (n, columns); zeros where there is no row."""
        out = np.zeros((len(keys), self._runs[0].counts.shape[1]), np.int64)
        for run in self._runs:
            if len(run.keys):
                place = np.minimum(np.searchsorted(run.keys, keys), len(run.keys) - 1)
                found = run.keys[place] == keys
                out[found] += run.counts[place[found]]
        return out

    def plus(self, other: Table, times: int = 1) -> Table:
        """This evidence and ``times`` the other's."""
        runs = [run for run in self._runs if len(run.keys)]
        for run in other._runs:
            if len(run.keys):
                runs.append(run if times == 1 else _Run(run.keys, run.counts * times))
                while len(runs) > 1 and len(runs[-2].keys) < 2 * len(runs[-1].keys):
                    runs[-2:] = [runs[-2].merged(runs[-1])]
        return self._of(runs) if runs else self

    def without(self, keys: Keys) -> Table:
        """All rows but those of these keys (ascending)."""
        if not len(self) or not len(keys):
            return self
        place = np.minimum(np.searchsorted(keys, self.keys), len(keys) - 1)
        kept = keys[place] != self.keys
        return Table(self.keys[kept], self.counts[kept])

    def equals(self, other: Table) -> bool:
        return np.array_equal(self.keys, other.keys) and np.array_equal(self.counts, other.counts)

    def _whole(self) -> _Run:
        while len(self._runs) > 1:  # the smallest first; what was put together is kept
            self._runs = (*self._runs[:-2], self._runs[-2].merged(self._runs[-1]))
        return self._runs[0]

    @staticmethod
    def _of(runs: list[_Run]) -> Table:
        table = Table.__new__(Table)
        table._runs = tuple(runs)
        return table


class _Run:
    """Rows by key, never written."""

    __slots__ = ("counts", "keys")

    def __init__(self, keys: Keys, counts: Counts) -> None:
        self.keys, self.counts = np.ascontiguousarray(keys), np.ascontiguousarray(counts)
        self.keys.setflags(write=False)
        self.counts.setflags(write=False)

    def merged(self, other: _Run) -> _Run:
        return _Run(*merging.merge(self.keys, self.counts, other.keys, other.counts))
