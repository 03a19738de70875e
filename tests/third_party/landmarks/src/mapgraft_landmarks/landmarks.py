"""The view of landmark evidence: which landmarks stand where, and what was looked at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Map, MapError, Points
from mapgraft_landmarks.cells import LOOKS, POSITION_STEP_M, SIGHTINGS, SUM_X, SUM_Y, Cells, Counts, keys_at, offset

MAP_TYPE = "point_landmarks"
_NEIGHBOURS = tuple(offset(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if (dx, dy) != (0, 0))


@dataclass(frozen=True, slots=True, eq=False)
class Landmarks:
    """Landmarks in the map frame, ordered by cell: ``positions_m`` (n, 2), ``sightings`` (n,), ``looks`` (n,)."""

    positions_m: Points
    sightings: NDArray[np.int64]
    looks: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.positions_m)

    def strongest(self, most: int) -> Landmarks:
        """At most that many, those of most sightings; equals keep their order."""
        chosen = np.sort(np.argsort(-self.sightings, kind="stable")[:most])
        return Landmarks(self.positions_m[chosen], self.sightings[chosen], self.looks[chosen])


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkMap:
    """What matchers and metrics see: all evidence of the layers in it, and the landmarks that stand out of it."""

    cell_m: float
    cells: Cells
    landmarks: Landmarks

    @property
    def map_type(self) -> str:
        return MAP_TYPE

    def known(self) -> int:
        """How many cells were looked at."""
        return len(self.cells)

    def looks_at(self, points_m: Points) -> NDArray[np.int64]:
        """How many scans looked at the places (n, 2)."""
        looks: NDArray[np.int64] = self.cells.at(keys_at(points_m, self.cell_m))[:, LOOKS]
        return looks


def as_map(map_: Map) -> LandmarkMap:
    """The map as one of this type; raises MapError when it is of another."""
    if not isinstance(map_, LandmarkMap):
        raise MapError(f"{MAP_TYPE} needs a map of its own type, found one of {map_.map_type}")
    return map_


def standing_landmarks(cells: Cells, sightings_min: int, share_min: float) -> Landmarks:
    """Landmarks that were sighted often, and in a fair share of the looks at their place.

    The sightings of one landmark fall into neighbouring cells. A cell with more sightings than each of its eight
    neighbours is a landmark's own cell (of equals, the first); the others give theirs to the strongest such neighbour.
    """
    found = cells.counts[:, SIGHTINGS] > 0
    sighted = Cells(cells.keys[found], cells.counts[found])
    counts = _gathered(sighted)
    sightings, looks = counts[:, SIGHTINGS], np.maximum(counts[:, LOOKS], counts[:, SIGHTINGS])
    stands = (sightings >= sightings_min) & (sightings >= share_min * looks)
    counts, sightings, looks = counts[stands], sightings[stands], looks[stands]
    positions = counts[:, [SUM_X, SUM_Y]] * POSITION_STEP_M / sightings[:, None]
    return Landmarks(positions, sightings, looks)


def _gathered(sighted: Cells) -> Counts:
    """Counts of the landmarks' own cells with what their neighbours give; looks are the largest of all of them."""
    strength = sighted.counts[:, SIGHTINGS]
    rows = np.arange(len(sighted))
    others = np.stack([_row_of(sighted, sighted.keys + step) for step in _NEIGHBOURS])
    rival = np.where(others >= 0, strength[others], 0)
    own = ~((rival > strength) | ((rival == strength) & (others < rows))).any(axis=0)
    offered = np.where((others >= 0) & own[others], rival, 0)
    best = offered.argmax(axis=0)  # of equals the first, which is the lowest key
    receiver = np.where(own, rows, np.where(offered.max(axis=0) > 0, others[best, rows], -1))
    kept = receiver >= 0
    total = np.zeros_like(sighted.counts)
    np.add.at(total, receiver[kept], sighted.counts[kept])
    total[:, LOOKS] = 0
    np.maximum.at(total[:, LOOKS], receiver[kept], sighted.counts[kept, LOOKS])
    gathered: Counts = total[own]
    return gathered


def _row_of(cells: Cells, keys: NDArray[np.int64]) -> NDArray[np.intp]:
    """The rows of the keys, -1 where there is none."""
    if not len(cells):
        return np.full(len(keys), -1, np.intp)
    place = np.minimum(np.searchsorted(cells.keys, keys), len(cells) - 1)
    return np.where(cells.keys[place] == keys, place, -1)
