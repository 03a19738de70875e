"""What a grid is made with: the lattice of its cells, the sensor model, what it keeps of the beams."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from mapgraft.contracts import MapError

LOG_ODDS_PER_NAT: Final = 1024  # fixed point of all evidence
CELL_LIMIT: Final = 1 << 30  # cells beyond ± this do not exist
FINEST_M: Final = 1e-6
COARSEST_M: Final = 1e6
_SAME_PLACE: Final = 1e-6  # cells: anchors nearer than this to a whole cell lie on it


@dataclass(frozen=True, slots=True)
class Lattice:
    """Where the cells lie: cell (ix, iy) covers anchor_m + [ix, ix + 1) × [iy, iy + 1) · resolution_m.

    ``anchor_m`` (x, y) lies in [0, resolution_m), so that every lattice has one name.
    """

    resolution_m: float
    anchor_m: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def through(cls, x_m: float, y_m: float, resolution_m: float) -> tuple[Lattice, tuple[int, int]]:
        """The lattice with a cell corner at (x_m, y_m), and the cell whose lower-left corner that is.

        Raises MapError when the corner lies beyond the largest cell.
        """
        anchor_x, ix = _split(x_m, resolution_m)
        anchor_y, iy = _split(y_m, resolution_m)
        return cls(resolution_m, (anchor_x, anchor_y)), (ix, iy)

    def corner_m(self, ix: int, iy: int) -> tuple[float, float]:
        """The lower-left corner of a cell, in metres."""
        return self.anchor_m[0] + ix * self.resolution_m, self.anchor_m[1] + iy * self.resolution_m


def _split(position_m: float, resolution_m: float) -> tuple[float, int]:
    cells = position_m / resolution_m
    if not abs(cells) < CELL_LIMIT:
        raise MapError(
            f"a grid reaches ±2^30 cells, found a corner at {position_m} m with {resolution_m} m per cell: "
            "give a nearer origin or a coarser resolution"
        )
    nearest = round(cells)
    if abs(cells - nearest) < _SAME_PLACE:
        return 0.0, nearest
    whole = math.floor(cells)
    return position_m - whole * resolution_m, whole


@dataclass(frozen=True, slots=True)
class SensorModel:
    """Evidence of one hit and one miss as log-odds, 1024 per nat."""

    l_hit: int
    l_miss: int


@dataclass(frozen=True, slots=True)
class Thresholds:
    """How evidence is read: clamped to ± ``clamp``, occupied from ``occupied``, free up to ``free`` (1024 per nat)."""

    occupied: int
    free: int
    clamp: int


@dataclass(frozen=True, slots=True)
class TraceLimits:
    """How much a layer keeps of beams and poses.

    Of each tile at most ``rays_per_tile`` end points and ``poses_per_tile`` poses; about one beam per
    ``beam_step_rad``; a pose only ``path_step_m`` or ``path_step_rad`` after the last.
    """

    rays_per_tile: int = 64
    poses_per_tile: int = 256
    beam_step_rad: float = math.radians(5.0)
    path_step_m: float = 0.1
    path_step_rad: float = math.radians(5.0)


def log_odds(probability: float) -> float:
    """The natural log-odds of a probability in (0, 1)."""
    return math.log(probability / (1.0 - probability))


def in_fixed_point(nats: float) -> int:
    return round(nats * LOG_ODDS_PER_NAT)
