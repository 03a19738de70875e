"""What the receiver has seen since the donor was placed, where it knew nothing before: no match has used it."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import SCAN, Comparison, MapError, Measurement, Step, Transform
from mapgraft_grid.evidence.joint import TOLERANCE_M, canonical_ratio, cells_to_wall, coarse_classes
from mapgraft_grid.grid_map import FREE, OCCUPIED, UNKNOWN, Classes, GridMap
from mapgraft_grid.kernels import fresh_evidence as kernel
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.observing import beams_of
from mapgraft_grid.overlap import pair_of
from mapgraft_grid.region import GridRegion

BLOCK_M: Final = 0.5  # what lies in one block is seen or missed together: it counts once
LEAST_BLOCK: Final = 3  # cells: of coarse grids blocks are larger
VOTES_MIN: Final = 2  # cells: fewer decide nothing
KNOWN_M: Final = 0.15  # what is so near a wall that the receiver knew is nothing new


class News:
    """The share of blocks that speak against the donor's place, among those of 0.5 m that speak at all, on evidence
    that is newer than the placement.

    A block speaks when at least 2 of its cells have voted, each once. A beam of the receiver that ends where it knew
    nothing when the donor was placed, nor a wall within 0.15 m, votes for the donor within 0.25 m of a wall of it, and
    against it in its free space; one that goes through a wall of the donor votes against it there. When the donor has
    mapped on, the cells vote that it has newly come to know and the receiver knows. After the merge was registered anew
    only what is newer than that votes; what was counted before stays. Where a merged map is compared, which cannot tell
    what the receiver knew, all beams since the merge vote.

    The value is NaN as long as no block speaks; the support is their number. Details: ``agreed`` and ``against``
    (blocks), ``agreed_m``, the length of new walls that stand where the donor has them, and ``places``, in how many
    patches of 2 m a block speaks against.
    """

    def track(self, comparison: Comparison) -> NewsTracker:
        return NewsTracker(comparison)


class NewsTracker:
    """Votes in the blocks of the donor's rectangle; a scan costs as much as its beams are long there."""

    __slots__ = (
        "_T",
        "_cells",
        "_comparison",
        "_corner",
        "_lattice",
        "_places",
        "_reach_m",
        "_tally",
        "_votes",
        "_where",
        "concerns",
    )

    def __init__(self, comparison: Comparison) -> None:
        map_type = comparison.map_type
        if not isinstance(map_type, OccupancyGrid):
            raise MapError(f"news watches occupancy grids, found a map of type {map_type.name!r}: use another metric")
        self._comparison = comparison
        self._reach_m = map_type.reach_m
        self._corner = (0, 0)
        self._cells: NDArray[np.uint8] = np.zeros((0, 0), np.uint8)
        self._votes: NDArray[np.int32] = np.zeros((0, 0, 2), np.int32)
        self._places: NDArray[np.int32] = np.zeros((0, 0), np.int32)
        self._tally = np.zeros(3, np.int64)
        self._T: Transform | None = None
        self._place()

    def update(self, step: Step) -> Measurement:
        if step.donor_changed:
            self._place()
        if step.observations:
            beams, kinds = beams_of(step.observations, self._lattice, self._reach_m)
            kernel.hear(self._cells, self._votes, self._places, self._tally, beams, kinds, self._where)
            ready_made = any(observation.kind != SCAN for observation in step.observations)
            if ready_made and self._comparison.subject == "own":  # a merged map would vote with the donor's own cells
                self._compare_new()
        return self._measured()

    def _compare(self, fresh: NDArray[np.bool_], own: Classes) -> None:
        """Let the cells vote that one of the two has newly come to know."""
        *_, block, least, near_cells = self._where
        near = _away(own) <= near_cells
        kernel.compare(self._cells, fresh, own, near, self._votes, self._places, self._tally, block, least)

    def _compare_new(self) -> None:
        """Let the cells vote that the receiver has come to know from ready-made maps."""
        own = self._seen(pair_of(self._comparison, "news")[0])
        fresh = (own != UNKNOWN) & (self._cells & kernel.KNOWN == 0)
        self._compare(fresh, own)
        self._cells[fresh] |= kernel.KNOWN

    def _measured(self) -> Measurement:
        agreed, against, places = self._tally.tolist()
        spoke = agreed + against
        details = {
            "agreed": float(agreed),
            "against": float(against),
            "agreed_m": agreed * self._where[3] * self._where[0] * self._lattice.resolution_m,
            "places": float(places),
        }
        return Measurement("news", against / spoke if spoke else math.nan, "1", spoke, "lower", details)

    def _place(self) -> None:
        """Take the donor, and what the receiver knows, as they are now; what was voted stays."""
        target, donor = pair_of(self._comparison, "news")
        self._lattice = target.lattice
        known_before = self._enclose(donor)
        classes, own = self._seen(donor), self._seen(target)
        ratio, *_, near = self._where
        away = _away(classes)
        self._cells = np.where(classes == FREE, kernel.FREE, 0).astype(np.uint8)
        self._cells[away <= near] = kernel.NEAR
        self._cells[classes == OCCUPIED] = kernel.WALL
        if known_before is not None and self._comparison.T_receiver_donor == self._T:
            self._compare((self._cells > 0) & ~known_before, own)
        fine = np.repeat(np.repeat(self._cells > 0, ratio, axis=0), ratio, axis=1)
        self.concerns = GridRegion.from_mask(self._lattice, (ratio * self._corner[0], ratio * self._corner[1]), fine)
        if self._comparison.subject == "own":  # a merged map does not tell what the receiver knew itself
            beside = max(1, round(KNOWN_M / (ratio * self._lattice.resolution_m)))
            self._cells[(own != UNKNOWN) | (_away(own) <= beside)] |= kernel.KNOWN
        self._cells |= np.minimum(away, kernel.FARTHEST).astype(np.uint8) << kernel.AWAY
        self._T = self._comparison.T_receiver_donor

    def _enclose(self, donor: GridMap) -> NDArray[np.bool_] | None:
        """Make the window hold the donor and every vote so far; returns where the donor was known there before."""
        corner, cells, votes, places = self._corner, self._cells, self._votes, self._places
        ratio = canonical_ratio(self._lattice.resolution_m)
        cells_in = (round(m / (ratio * self._lattice.resolution_m)) for m in (BLOCK_M, TOLERANCE_M))
        block, near = (max(least, count) for least, count in zip((LEAST_BLOCK, 1), cells_in, strict=True))
        x0, y0, x1, y1 = _box(donor, ratio, block * kernel.PATCH, near)
        if not votes.any() and self._comparison.T_receiver_donor != self._T:
            cells = cells[:0, :0]  # registered anew before anything was said: as if it were the first time
        if cells.size:
            x0, y0 = min(x0, corner[0]), min(y0, corner[1])
            x1, y1 = max(x1, corner[0] + cells.shape[1]), max(y1, corner[1] + cells.shape[0])
        self._corner, shape = (x0, y0), (y1 - y0, x1 - x0)
        self._where = (ratio, x0, y0, block, VOTES_MIN, near)
        self._cells = np.zeros(shape, np.uint8)
        self._votes = np.zeros((shape[0] // block, shape[1] // block, 2), np.int32)
        patch = block * kernel.PATCH
        self._places = np.zeros((shape[0] // patch, shape[1] // patch), np.int32)
        if not cells.size:
            return None
        known = np.zeros(shape, np.bool_)
        row, column = corner[1] - y0, corner[0] - x0
        _put(known, cells & kernel.DONOR != 0, row, column)
        _put(self._votes, votes, row // block, column // block)
        _put(self._places, places, row // patch, column // patch)
        return known

    def _seen(self, map_: GridMap) -> Classes:
        """The classes of a map in the window."""
        height, width = self._cells.shape
        return coarse_classes(map_, self._where[0], self._corner, (height, width))


def _box(donor: GridMap, ratio: int, side: int, near: int) -> tuple[int, int, int, int]:
    """The smallest rectangle of whole squares that holds the donor's walls with what is near them."""
    if donor.is_empty:
        return 0, 0, side, side
    x0, y0, x1, y1 = donor.bounds_cells()
    reach = near + 1
    low_x, low_y = (x0 // ratio - reach) // side * side, (y0 // ratio - reach) // side * side
    return low_x, low_y, -(-(x1 // ratio + 1 + reach) // side) * side, -(-(y1 // ratio + 1 + reach) // side) * side


def _put(whole: NDArray[Any], part: NDArray[Any], row: int, column: int) -> None:
    whole[row : row + part.shape[0], column : column + part.shape[1]] = part


def _away(classes: Classes) -> NDArray[np.uint8]:
    """How many cells the next wall is away, at most 255."""
    cells = cells_to_wall(classes)
    if cells is None:
        return np.full(classes.shape, 255, np.uint8)
    out: NDArray[np.uint8] = np.minimum(np.ceil(cells - 0.05), 255.0).astype(np.uint8)
    return out
