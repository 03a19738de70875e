"""Walls out of evidence: pieces that continue each other, one line fitted through all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points
from mapgraft_lines.kernels import growing
from mapgraft_lines.kernels.chopping import UNIT, UNIT_M
from mapgraft_lines.kernels.keys import (
    BARE,
    BARE_BINS,
    FACED,
    FACED_BINS,
    INDEX_BITS,
    LIMIT,
    SLOT_BITS,
    STEPS_PER_M,
)
from mapgraft_lines.layer import DX, DY, LOOKS, WX, WXX, WXY, WY, WYY, W
from mapgraft_lines.table import Keys, Table

ACROSS_M: Final = 0.12  # a piece of a wall lies no further from its line
GAP_M: Final = 0.3  # between two pieces of one wall
TURN_COSINE: Final = math.cos(math.radians(15.0))  # between a piece and its wall
LEAST_SIGMA_M: Final = 0.005  # no wall is straighter
SLOT_MASK: Final = (1 << SLOT_BITS) - 1


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Straight walls in the map frame, longest first.

    ``ends_m`` (n, 2, 2) the two ends, with the seen side on the left where ``faced`` (n,) is True. ``sigma_m`` (n,) is
    the standard deviation of the line across itself at its middle, ``sigma_rad`` (n,) that of its angle. ``looks`` (n,)
    in how many observations it was seen on average along it; ``own_share`` (n,) how much of the information is the
    map's own and not received.
    """

    ends_m: NDArray[np.float64]
    faced: NDArray[np.bool_]
    sigma_m: NDArray[np.float64]
    sigma_rad: NDArray[np.float64]
    looks: NDArray[np.float64]
    own_share: NDArray[np.float64]

    def __post_init__(self) -> None:
        for array in (self.ends_m, self.faced, self.sigma_m, self.sigma_rad, self.looks, self.own_share):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.ends_m)

    @property
    def lengths_m(self) -> NDArray[np.float64]:
        lengths: NDArray[np.float64] = np.hypot(*(self.ends_m[:, 1] - self.ends_m[:, 0]).T)
        return lengths

    @property
    def angles_rad(self) -> NDArray[np.float64]:
        """The directions from first to second end, in (-π, π]."""
        along = self.ends_m[:, 1] - self.ends_m[:, 0]
        angles: NDArray[np.float64] = np.arctan2(along[:, 1], along[:, 0])
        return angles

    def covariance(self, wall: int) -> NDArray[np.float64]:
        """The covariance (2, 2) of offset across at the middle (m) and angle (rad) of one wall."""
        return np.diag([self.sigma_m[wall] ** 2, self.sigma_rad[wall] ** 2])

    def samples(self, step_m: float) -> Points:
        """Places (k, 2) along all walls, one for each ``step_m``, wall by wall."""
        counts = np.maximum(np.round(self.lengths_m / step_m).astype(np.int64), 1)
        wall = np.repeat(np.arange(len(self)), counts)
        nth = np.arange(len(wall)) - np.repeat(np.cumsum(counts) - counts, counts)
        share = ((nth + 0.5) / counts[wall])[:, None]
        points: Points = self.ends_m[wall, 0] * (1.0 - share) + self.ends_m[wall, 1] * share
        return points


def standing(pieces: Table, space: Table, looks_min: int, share_min: float) -> Table:
    """The pieces seen often enough, and in a fair share of the observations that saw their cell or through it.

    Pieces of one wall may lie in slots of neighbouring directions: what these saw counts for each.
    """
    looks = pieces.counts[:, LOOKS]
    if looks_min > 1 or share_min > 0.0:
        looks = looks + sum(pieces.at(keys)[:, LOOKS] for keys in _beside(pieces.keys))
    through = space.at(pieces.keys & ~SLOT_MASK)[:, 0]
    kept = (looks >= looks_min) & (looks >= share_min * through)
    return pieces if kept.all() else Table(pieces.keys[kept], pieces.counts[kept])


def _beside(keys: Keys) -> tuple[Keys, Keys]:
    """The slots of the next directions to the right and left, in the same cells."""
    slot, cell = keys & SLOT_MASK, keys & ~SLOT_MASK
    first, bins = np.where(slot < BARE, FACED, BARE), np.where(slot < BARE, FACED_BINS, BARE_BINS)
    right, left = (cell | (first + (slot - first + turn) % bins) for turn in (-1, 1))
    return right, left


def piece_rows(pieces: Table, cell_m: float) -> NDArray[np.float64]:
    """Pieces (n, 9) in metres: x, y, ux, uy, second moments xx, xy, yy, weight, and 1 where a side is known."""
    counts = pieces.counts.astype(np.float64)
    corner = cell_corners_m(pieces.keys, cell_m)
    weight = counts[:, W]
    x, y = counts[:, WX] / weight / STEPS_PER_M, counts[:, WY] / weight / STEPS_PER_M
    unit = 1.0 / STEPS_PER_M**2
    faced = (pieces.keys & SLOT_MASK) < BARE
    angle = np.arctan2(counts[:, DY], counts[:, DX]) / np.where(faced, 1.0, 2.0)
    return np.column_stack(
        (
            corner[:, 0] + x,
            corner[:, 1] + y,
            np.cos(angle),
            np.sin(angle),
            counts[:, WXX] / weight * unit - x * x,
            counts[:, WXY] / weight * unit - x * y,
            counts[:, WYY] / weight * unit - y * y,
            weight,
            faced.astype(np.float64),
        )
    )


def half_lengths_m(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half the lengths (n,) of pieces (n, 9), each uniform along its direction."""
    c, s = rows[:, 2], rows[:, 3]
    along = c * c * rows[:, 4] + 2.0 * c * s * rows[:, 5] + s * s * rows[:, 6]
    half: NDArray[np.float64] = np.sqrt(np.maximum(3.0 * along, 0.0))
    return half


def cell_corners_m(keys: Keys, cell_m: float) -> Points:
    """The lower left corners (n, 2) of the cells of keys."""
    ix = (keys >> (INDEX_BITS + SLOT_BITS)) - LIMIT
    iy = ((keys >> SLOT_BITS) & ((1 << INDEX_BITS) - 1)) - LIMIT
    corners: Points = np.stack((ix, iy), axis=1) * cell_m
    return corners


@dataclass(frozen=True, slots=True, eq=False)
class Grown:
    """Walls, and to which of them (``wall`` (k,), -1 where it is too short) the pieces at ``keys`` (k,) belong."""

    walls: Walls
    keys: Keys
    wall: NDArray[np.int64]


def grown(pieces: Table, own: Table, cell_m: float, length_min_m: float) -> Grown:
    """The walls in standing pieces, of which ``own`` tells the map's own share; shorter ones are left out."""
    if not len(pieces):
        return Grown(no_walls(), pieces.keys, np.empty(0, np.int64))
    rows = piece_rows(pieces, cell_m)
    order = np.argsort(-rows[:, 7], kind="stable")
    label, count = growing.grow(pieces.keys, rows, order, ACROSS_M, GAP_M, TURN_COSINE)
    weight = own.at(pieces.keys)[:, W].astype(np.float64)
    found = growing.measure(rows, pieces.counts[:, LOOKS], weight, label, count)
    length = np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1])
    chosen = np.flatnonzero(length >= length_min_m)
    chosen = chosen[np.lexsort((*found[chosen, :4].T, -length[chosen]))]
    number = np.full(count, -1, np.int64)
    number[chosen] = np.arange(len(chosen))
    return Grown(_told(found[chosen], length[chosen], cell_m), pieces.keys, number[label])


def no_walls() -> Walls:
    none = np.empty(0)
    return Walls(np.empty((0, 2, 2)), np.empty(0, np.bool_), none, none.copy(), none.copy(), none.copy())


def _told(found: NDArray[np.float64], length: NDArray[np.float64], cell_m: float) -> Walls:
    """Measured walls with their certainty.

    Of one look the offset has the variance that its information tells, or the mean square across when that is more, and
    looks are taken to be independent: so the variance of the mean falls with their number.
    """
    each = UNIT_M**2 * UNIT / (found[:, 5] * cell_m)  # of a piece as long as a cell, in one look
    variance = np.maximum(each, found[:, 4]) / np.maximum(found[:, 6], 1.0) + LEAST_SIGMA_M**2
    return Walls(
        np.ascontiguousarray(found[:, :4].reshape(-1, 2, 2)),
        found[:, 7] > 0.5,
        np.sqrt(variance),
        np.sqrt(12.0 * variance) / length,
        np.ascontiguousarray(found[:, 6]),
        np.clip(found[:, 8], 0.0, 1.0),
    )
