"""Registering a standing merge anew: whether the maps, grown since, tell a better transform close to the one it has."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Covariance, Map, MapMetadata, Match, Matcher, Prior, Transform
from mapgraft.persons import SAME_PLACE_M, SAME_TURN_RAD, planar_covariance, same_place

ORIGIN: Final = "the standing merge"
INFLATION: Final = 4.0  # of the standing covariance: it was told by maps that shared less than they do now
EXACT_M, EXACT_RAD = 1e-3, 1e-4  # standard deviations of the prior that asks what the standing transform scores now
LEAST_M: Final = 0.025  # half a cell where the map type has none
LEAST_RAD: Final = math.radians(0.1)  # the least turn worth a swap where the donor does not tell how large its map is
WITHIN_SIGMA: Final = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """A better match for a standing merge, how far it moves the donor's map, and what the old one scores now."""

    match: Match
    shift_m: float
    turn_rad: float
    score_before: float

    @property
    def reason(self) -> str:
        """One clause for a person."""
        return (
            f"registered anew: moved by {self.shift_m:.2f} m, {math.degrees(self.turn_rad):.2f}° "
            f"(score {self.score_before:.4g} → {self.match.score:.4g})"
        )


@dataclass(frozen=True, slots=True)
class Site:
    """Where the donor's map is: its middle ``about_m`` (x, y) in its own frame, and how far it reaches.

    ``cell_m`` is the side of the receiver's cells, None where it has none.
    """

    about_m: Sequence[float]
    cell_m: float | None = None
    reach_m: float = 0.0

    @classmethod
    def of(cls, own: MapMetadata, other: MapMetadata) -> Site:
        """From what receiver and donor tell."""
        x0, y0, x1, y1 = other.bounds_m or (0.0, 0.0, 0.0, 0.0)
        return cls(((x0 + x1) / 2.0, (y0 + y1) / 2.0), own.resolution_m, math.hypot(x1 - x0, y1 - y0) / 2.0)

    @property
    def least_m(self) -> float:
        """Half a cell."""
        return self.cell_m / 2.0 if self.cell_m else LEAST_M

    def is_worth_it(self, T_a: Transform, T_b: Transform) -> bool:
        """Whether two transforms put some part of the donor's map more than half a cell apart."""
        shift_m, turn_rad = displacement(T_a, T_b, self.about_m)
        return shift_m + self.reach_m * turn_rad > self.least_m or (self.reach_m == 0.0 and turn_rad > LEAST_RAD)


def find_move(matcher: Matcher, target: Map, source: Map, standing: Match, site: Site) -> Move | None:
    """A hypothesis within the place of the standing match that scores more now and is worth a swap.

    ``target`` and ``source`` are the own maps of receiver and donor, as they are now. What the standing transform
    scores now is asked with a prior that leaves nothing else; a matcher that comes back with another transform all the
    same does not think that the maps lie there. The margin of the standing match stays: a search around it knows no
    rivals. Raises what the matcher raises.
    """
    found = matcher.match(target, source, prior_around(standing, site.about_m))
    best = next((match for match in found if is_within(standing, match.T_receiver_donor, site.about_m)), None)
    if best is None:
        return None
    if not site.is_worth_it(standing.T_receiver_donor, best.T_receiver_donor):
        return None
    exact = Prior(standing.T_receiver_donor, _about(standing, site.about_m, EXACT_M, EXACT_RAD), ORIGIN)
    held = next(iter(matcher.match(target, source, exact)), None)
    if held is None or best.score < held.score:
        return None
    if best.score == held.score and not site.is_worth_it(standing.T_receiver_donor, held.T_receiver_donor):
        return None
    shift_m, turn_rad = displacement(standing.T_receiver_donor, best.T_receiver_donor, site.about_m)
    evidence = {**standing.evidence, **best.evidence}
    return Move(dataclasses.replace(best, margin=standing.margin, evidence=evidence), shift_m, turn_rad, held.score)


def prior_around(standing: Match, about_m: Sequence[float]) -> Prior:
    """The standing transform with its covariance, inflated, and no less than what a person would call its place."""
    covariance = _about(standing, about_m, SAME_PLACE_M / WITHIN_SIGMA, SAME_TURN_RAD / WITHIN_SIGMA)
    if standing.covariance is not None:
        covariance = covariance + INFLATION * standing.covariance
    return Prior(standing.T_receiver_donor, covariance, ORIGIN)


def is_within(standing: Match, T_receiver_donor: Transform, about_m: Sequence[float]) -> bool:
    """Whether a transform is the standing one, seen anew: at its place, or within three of its standard deviations."""
    if same_place(standing.T_receiver_donor, T_receiver_donor, about_m):
        return True
    if standing.covariance is None:
        return False
    off = _difference(standing.T_receiver_donor, T_receiver_donor)
    scatter = standing.covariance + 1e-12 * np.eye(6)
    return float(off @ np.linalg.solve(scatter, off)) <= WITHIN_SIGMA**2


def displacement(T_a: Transform, T_b: Transform, about_m: Sequence[float]) -> tuple[float, float]:
    """How far apart two transforms put the donor's map, where it is: (m, rad)."""
    point = np.array([[about_m[0], about_m[1]]])
    return float(np.linalg.norm(T_a.apply(point) - T_b.apply(point))), T_a.difference(T_b)[1]


def _about(standing: Match, about_m: Sequence[float], sigma_m: float, sigma_yaw_rad: float) -> Covariance:
    """The covariance of the transform when shift and turn of the donor's map are known so well at ``about_m``.

    The translation of a transform is that of the donor's origin, which moves when the map is turned about its middle.
    """
    T = standing.T_receiver_donor
    lever = T.matrix[:2, :2] @ np.array([about_m[0], about_m[1]]) * standing.scale
    jacobian = np.eye(6)
    jacobian[0, 5], jacobian[1, 5] = lever[1], -lever[0]
    covariance: Covariance = jacobian @ planar_covariance(sigma_m, sigma_yaw_rad) @ jacobian.T
    return covariance


def _difference(T_a: Transform, T_b: Transform) -> NDArray[np.float64]:
    """(6,) of translation (m) and small turns (rad) about the axes of the common frame, from a to b."""
    turn = T_b.matrix[:3, :3] @ T_a.matrix[:3, :3].T
    axes = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.concatenate((T_b.matrix[:3, 3] - T_a.matrix[:3, 3], axes))
