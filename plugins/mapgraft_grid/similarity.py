"""The similarity metric SM: the share of equal cells among the cells that both maps know."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Comparison, ConfigError, Measurement, Step
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.kernels.agreement import tile_tables
from mapgraft_grid.overlap import pair_of
from mapgraft_grid.tile_tree import Tile

# The paper accepts at 0.9 (section 4.2). A merged map holds the donor itself; there right merges stayed above 0.964
# (table 4).
LIMITS = {"own": 0.9, "merged": 0.95}


class Similarity:
    """SM = similar / (similar + dissimilar) over the jointly known cells (Andersone 2021, eq. 1).

    The value is NaN while the maps have less than ``overlap_min_m2`` in common. The support is the number of jointly
    known cells. Details: ``similar``, ``dissimilar``, ``occupied_agreement`` (cells), ``overlap_m2``, ``kappa``
    (Cohen's: SM corrected for the agreement of independent maps with as many free cells each; NaN when one class is
    all there is), and ``limit``, which a right merge should keep: the paper's 0.9, and 0.95 where a merged map is
    compared.
    """

    def __init__(self, *, overlap_min_m2: float = 1.0) -> None:
        if not 0.0 <= overlap_min_m2 < math.inf:
            raise ConfigError(f"similarity needs overlap_min_m2 >= 0, found {overlap_min_m2}")
        self.overlap_min_m2 = overlap_min_m2

    def track(self, comparison: Comparison) -> SimilarityTracker:
        return SimilarityTracker(comparison, self.overlap_min_m2)


class SimilarityTracker:
    """Counts tile by tile; maps share the tiles that did not change, so that only the others are counted again."""

    __slots__ = ("_comparison", "_overlap_min_m2", "_seen", "_total")

    def __init__(self, comparison: Comparison, overlap_min_m2: float) -> None:
        self._comparison = comparison
        self._overlap_min_m2 = overlap_min_m2
        self._seen: dict[int, tuple[Tile, Tile, NDArray[np.int64]]] = {}
        self._total = np.zeros((2, 2), np.int64)

    def update(self, step: Step) -> Measurement:
        target, donor = pair_of(self._comparison, "similarity")
        self._count(target, donor)
        return measurement_of(self._total, target.resolution_m, self._comparison.subject, self._overlap_min_m2)

    def _count(self, target: GridMap, donor: GridMap) -> None:
        common = {key: (target.tiles[key], tile) for key, tile in donor.tiles.items() if key in target.tiles}
        for key in [key for key in self._seen if key not in common]:
            self._total -= self._seen.pop(key)[2]
        changed = [key for key, pair in common.items() if not _same(self._seen.get(key), pair)]
        if not changed:
            return
        own, other = (np.stack([common[key][side].log_odds for key in changed]) for side in (0, 1))
        limits = (target.thresholds.free, target.thresholds.occupied, donor.thresholds.free, donor.thresholds.occupied)
        for key, table in zip(changed, tile_tables(own, other, *limits), strict=True):
            if key in self._seen:
                self._total -= self._seen[key][2]
            self._total += table
            self._seen[key] = (*common[key], table)


def _same(seen: tuple[Tile, Tile, NDArray[np.int64]] | None, pair: tuple[Tile, Tile]) -> bool:
    return seen is not None and seen[0] is pair[0] and seen[1] is pair[1]


def measurement_of(
    table: NDArray[np.int64], resolution_m: float, subject: Literal["own", "merged"], overlap_min_m2: float = 0.0
) -> Measurement:
    """SM from the (2, 2) counts of jointly known cells; rows the target's class, columns the donor's, free first."""
    known = int(table.sum())
    similar = int(np.trace(table))
    overlap_m2 = known * resolution_m**2
    enough = known > 0 and overlap_m2 >= overlap_min_m2
    details = {
        "similar": float(similar),
        "dissimilar": float(known - similar),
        "occupied_agreement": float(table[1, 1]),
        "overlap_m2": overlap_m2,
        "kappa": kappa(table) if enough else math.nan,
        "limit": LIMITS[subject],
    }
    return Measurement("similarity", similar / known if enough else math.nan, "1", known, "higher", details)


def kappa(table: NDArray[np.int64]) -> float:
    """Cohen's κ of (2, 2) counts: the agreement beyond what independent maps with as many free cells would have.

    NaN when one class is all there is.
    """
    known = int(table.sum())
    by_chance = int((table.sum(axis=0) * table.sum(axis=1)).sum()) / known**2 if known else 1.0
    return (int(np.trace(table)) / known - by_chance) / (1.0 - by_chance) if by_chance < 1.0 else math.nan
