"""How well two clouds agree under a transform: the numbers by which hypotheses are told apart and merges are judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points, Transform
from mapgraft_cloud.cloud_map import CloudMap
from mapgraft_cloud.surface import Surface

NEAR_M: Final = 0.3  # farther apart, surfaces share nothing
COVER_M: Final = 1.0  # what lies so near to a surface was looked at when that was seen
CLEAR_M: Final = 0.25  # around a point nothing of the other map may be occupied for it to be seen through
AGAINST: Final = 2.0  # what was seen through tells more than what lies near by chance


@dataclass(frozen=True, slots=True)
class OneWay:
    """One map's surface in the other: how much of it is shared, was seen through, and was looked at; square metres."""

    shared_m2: float
    through_m2: float
    covered_m2: float


@dataclass(frozen=True, slots=True)
class Agreement:
    """Both ways: the receiver's surface in the donor's map (``own``), the donor's in the receiver's."""

    own: OneWay
    donor: OneWay

    @property
    def shared_m2(self) -> float:
        """The surface that both have: the mean of both ways."""
        return (self.own.shared_m2 + self.donor.shared_m2) / 2.0

    @property
    def through_m2(self) -> float:
        """The surface of one that the other saw through: the mean of both ways."""
        return (self.own.through_m2 + self.donor.through_m2) / 2.0

    @property
    def covered_m2(self) -> float:
        """The surface of one where the other looked: the mean of both ways."""
        return (self.own.covered_m2 + self.donor.covered_m2) / 2.0

    @property
    def score_m2(self) -> float:
        return self.shared_m2 - AGAINST * self.through_m2


def agreement(target: CloudMap, source: CloudMap, T: Transform, walls_only: bool) -> Agreement:
    """How the surfaces agree; with ``walls_only`` floors and ceilings, which are alike everywhere, are left out.

    A place on a surface shares 1 − (d / 0.3 m)² with another at the distance d. It was looked at where a surface of the
    other map lies within 1 m or where that map saw through it: it knows free space there, and nothing else for 0.25 m
    around.
    """
    return Agreement(
        _one_way(target.surface, source, T.inverse(), walls_only),
        _one_way(source.surface, target, T, walls_only),
    )


def _one_way(surface: Surface, other: CloudMap, T: Transform, walls_only: bool) -> OneWay:
    points = T.apply(surface.points_m[surface.upright] if walls_only else surface.points_m)
    away = other.surface.distances(points, COVER_M)
    near = np.maximum(0.0, 1.0 - (away / NEAR_M) ** 2)
    through = seen_through(other, points)
    covered = np.isfinite(away) | through
    area_m2 = surface.spacing_m**2
    return OneWay(float(near.sum()) * area_m2, float(through.sum()) * area_m2, float(covered.sum()) * area_m2)


def seen_through(map_: CloudMap, points_m: Points) -> NDArray[np.bool_]:
    """Whether points (n, 3) lie where a map knows free space and, for ``CLEAR_M`` around, nothing occupied."""
    found = np.zeros(len(points_m), np.bool_)
    if not map_.has_free_space:
        return found
    free = map_.log_odds_at(points_m) <= map_.thresholds.free
    _, high = map_.around(points_m[free], CLEAR_M)
    found[free] = high < map_.thresholds.occupied
    return found
