"""Sets of slots of cells: what an observation touched, what a donor changed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mapgraft.contracts import MapError, Region
from mapgraft_lines.table import Keys, distinct


@dataclass(frozen=True, slots=True, eq=False)
class LineRegion:
    """Slots of cells of one size (see ``kernels.keys``), immutable; ``keys`` (n,) ascending."""

    cell_m: float
    keys: Keys

    def __post_init__(self) -> None:
        self.keys.setflags(write=False)

    @classmethod
    def empty(cls, cell_m: float) -> LineRegion:
        return cls(cell_m, np.empty(0, np.int64))

    def union(self, other: LineRegion) -> LineRegion:
        """The slots in either; raises MapError when both hold slots of cells of different size."""
        if not self.keys.size:
            return other
        if not other.keys.size:
            return self
        self._require_same_cells(other)
        return LineRegion(self.cell_m, distinct(self.keys, other.keys))

    def minus(self, other: LineRegion) -> LineRegion:
        """The slots that the other does not have; raises MapError as ``union``."""
        self._require_same_cells(other)
        return LineRegion(self.cell_m, np.setdiff1d(self.keys, other.keys, assume_unique=True))

    def meets(self, other: LineRegion) -> bool:
        """Whether any slot is in both; raises MapError as ``union``."""
        self._require_same_cells(other)
        return bool(np.isin(self.keys, other.keys, assume_unique=True).any())

    def __len__(self) -> int:
        return len(self.keys)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, LineRegion)
            and np.array_equal(self.keys, other.keys)
            and (self.cell_m == other.cell_m or not self.keys.size)
        )

    def __hash__(self) -> int:
        return hash(self.keys.tobytes())

    def _require_same_cells(self, other: LineRegion) -> None:
        if self.keys.size and other.keys.size and self.cell_m != other.cell_m:
            raise MapError(
                f"regions of {self.cell_m:g} m and {other.cell_m:g} m cells do not mix: place the layer first"
            )


def as_region(region: Region) -> LineRegion:
    """The region as one of this type; raises MapError when it is of another."""
    if not isinstance(region, LineRegion):
        raise MapError(f"a map of line segments needs a region of its own, found a {type(region).__name__}")
    return region
