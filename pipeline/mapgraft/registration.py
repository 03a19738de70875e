"""Registering a standing merge anew: whether the maps, grown since, tell a better transform close to the one it has."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mapgraft.contracts import Covariance, Map, MapMetadata, Match, Matcher, Prior, Transform
from mapgraft.persons import SAME_PLACE_M, SAME_TURN_RAD, planar_covariance, same_place

ORIGIN: Final = "the standing merge"
LEAST_M: Final = 0.025  # half a cell where the map type has none
LEAST_RAD: Final = math.radians(0.1)  # the least turn worth a swap where the donor does not tell how large its map is
SIGMAS: Final = 3.0  # of the prior that reach as far as a place does
PRIOR_SCORE: Final = "prior_score"  # the evidence that a matcher gives of the transform it was asked to search around


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """A better match for a standing merge, how far it moves the donor's map, and what the standing one scores now."""

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


def find_move(
    matcher: Matcher, target: Map, source: Map, standing: Match, accepted: Transform, site: Site
) -> Move | None:
    """A hypothesis that scores more now than the standing match, at the place that was accepted, and worth a swap.

    ``target`` and ``source`` are the own maps of receiver and donor, as they are now; ``accepted`` is the transform at
    which the merge was accepted: however often it is moved, it stays at that place. A matcher that does not tell what
    the standing transform scores now moves nothing. The margin of the standing match stays: a search around it knows
    no rivals. Raises what the matcher raises.
    """
    found = matcher.match(target, source, prior_around(standing, site.about_m))
    best = next((match for match in found if same_place(accepted, match.T_receiver_donor, site.about_m)), None)
    if best is None or not site.is_worth_it(standing.T_receiver_donor, best.T_receiver_donor):
        return None
    before = best.evidence.get(PRIOR_SCORE)
    if before is None or not best.score > before:
        return None
    shift_m, turn_rad = displacement(standing.T_receiver_donor, best.T_receiver_donor, site.about_m)
    evidence = {**standing.evidence, **best.evidence}
    return Move(dataclasses.replace(best, margin=standing.margin, evidence=evidence), shift_m, turn_rad, before)


def prior_around(standing: Match, about_m: Sequence[float]) -> Prior:
    """The standing transform, sure within what a person would call its place.

    However unsure the match is, farther away it would be another one.
    """
    covariance = _about(standing, about_m, SAME_PLACE_M / SIGMAS, SAME_TURN_RAD / SIGMAS)
    return Prior(standing.T_receiver_donor, covariance, ORIGIN)


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
