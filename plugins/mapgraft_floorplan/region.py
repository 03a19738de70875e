"""Sets of pieces of wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Region

Rows = NDArray[np.int32]  # (n, 4) x0, y0, x1, y1 in steps, each once, in ascending order

_KEY = np.dtype([("x0", "i4"), ("y0", "i4"), ("x1", "i4"), ("y1", "i4")])


def keys_of(rows: Rows) -> NDArray[np.void]:
    """The rows (n, 4) as (n,) records that sort and compare as a whole."""
    return np.ascontiguousarray(rows, np.int32).view(_KEY).reshape(-1)


def rows_of(keys: NDArray[np.void]) -> Rows:
    """The inverse of ``keys_of``."""
    return np.ascontiguousarray(keys).view(np.int32).reshape(-1, 4)


@dataclass(frozen=True, slots=True, eq=False)
class PlanRegion:
    """Pieces of wall, immutable: ``rows`` (n, 4) int32, each once, in ascending order."""

    rows: Rows

    def __post_init__(self) -> None:
        self.rows.setflags(write=False)

    @classmethod
    def of(cls, rows: Rows) -> PlanRegion:
        """The pieces in rows of any order."""
        return cls(rows_of(np.unique(keys_of(rows))))

    def union(self, other: PlanRegion) -> PlanRegion:
        return PlanRegion(rows_of(np.union1d(keys_of(self.rows), keys_of(other.rows))))

    def minus(self, other: PlanRegion) -> PlanRegion:
        return PlanRegion(rows_of(np.setdiff1d(keys_of(self.rows), keys_of(other.rows), assume_unique=True)))

    def __len__(self) -> int:
        return len(self.rows)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PlanRegion) and np.array_equal(self.rows, other.rows)

    def __hash__(self) -> int:
        return hash(self.rows.tobytes())


def as_region(region: Region) -> PlanRegion:
    if not isinstance(region, PlanRegion):
        raise MapError(f"a floor plan has regions of walls, found {type(region).__name__}")
    return region
