"""What a point-cloud map is made with: the side of its voxels, the sensor model, how evidence is read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

NAME: Final = "point_cloud"
LOG_ODDS_PER_NAT: Final = 1024  # fixed point of all evidence, as in occupancy grids
FINEST_M: Final = 0.005
COARSEST_M: Final = 5.0
MOST_LOOKS: Final = 1 << 22  # of one voxel: their position sums fit 32 bits


@dataclass(frozen=True, slots=True, order=True)
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
class Reach:
    """What counts of a sweep: points from ``near_m`` to ``hit_m`` away are hits, and what lies before one farther off
    is free up to ``free_m``; beams stop ``short_voxels`` before the voxel that they end in, so that those which graze a
    wall do not eat it.
    """

    near_m: float
    hit_m: float
    free_m: float
    short_voxels: int
