"""Matching by correlation: every rotation and every shift, with walls and free space as evidence."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from mapgraft.contracts import ConfigError, Map, MapError, Match, Points, Prior, Transform
from mapgraft_grid.bayes import Meeting, log_bayes_factor, log_bayes_factors, meet, occupancy_prior
from mapgraft_grid.certainty import Certainty, Lattice, certainty
from mapgraft_grid.correlation_search import search
from mapgraft_grid.gate import Gate
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.kernels.refining import distinct
from mapgraft_grid.prepared import Prepared, canonical_m, prepare, thinned
from mapgraft_grid.refinement import distance_field, placed, refined

OTHER_YAW_RAD: Final = math.radians(10.0)  # two hypotheses nearer than this in both are one
OTHER_SHIFT_M: Final = 2.5  # mean displacement of the source's walls
ASKED_WALLS: Final = 200  # of the source that tell how far two hypotheses lie apart
SAME_M: Final = 0.05  # refined hypotheses nearer than this are one and the same
RIVAL_SHARE: Final = 0.5  # of the best's log Bayes factor: what has less is no rival
SEARCH_CELLS: Final = 0.1  # sd of a refined shift per axis, in cells, and of a refined yaw
DEGENERATE_M: Final = 0.25  # a placement that may be off by twice that, half a metre, in some direction is degenerate
SEARCH_RAD: Final = math.radians(0.1)
# Share of the covariance that the walls alone tell that is left when both maps' walls are drawn to each other: on 120
# right matches of four real logs 97.5 % of the true transforms lie in their 95 % ellipsoid with it, and 94 % with 0.4.
REFINED_SHARE: Final = 0.5


class _Hypothesis(NamedTuple):
    T: Transform
    met: Meeting
    spots: Points  # where some of the source's walls come to lie


class Correlation:
    """Exhaustive search over rotations and shifts: walls that lie on walls and free space on free space count for a
    placement, walls in free space against it.

    The best ``returned`` hypotheses come back, best first, each refined below a cell and a degree. Two of them differ
    by more than 10° or by more than 2.5 m where the source's walls are. The score is the log Bayes factor L (nats) at
    0.1 m, or at the coarser map's resolution when that is coarser (``bayes``); the margin is L minus that of the best
    other hypothesis. Never a reflection. A prior restricts the search to 3.5 of its standard deviations and a little
    more (``gate``); the margin is then over what was searched.

    Evidence: ``agreement``, ``disagreement``, ``overlap_cells``, ``occupied_agreement`` in cells of ``resolution_m``;
    ``occupied_m``, the length of the walls that both maps have; ``log_bayes_factor``, which is the score;
    ``rivals``, the number of other hypotheses with at least half of the best L; ``occupancy_prior``, the π of L; with a
    prior ``prior_score``, the L of its own transform as it is; with a covariance also ``sigma_max_m``, the greatest
    standard deviation of where the common walls lie, ``degenerate_dir_rad``, its direction in the target's frame in
    [0, π), and ``degenerate``, 1 when it is more than 0.25 m, as along a corridor.
    """

    def __init__(self, *, returned: int = 4) -> None:
        if returned < 2:
            raise ConfigError(f"correlation needs returned >= 2, found {returned}")
        self.returned = returned

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        """Hypotheses of ``T_target_source``, best first; EmptyMapError when a map has no occupied cell."""
        a, b = _grid("target", target), _grid("source", source)
        unit_m = canonical_m(a.resolution_m, b.resolution_m)
        ours, theirs = prepare(a, unit_m, "target"), prepare(b, unit_m, "source")
        gate = None if prior is None else Gate.of(prior, theirs.centre_m)
        rough = [placed(pose, theirs.centre_m) for pose in search(ours, theirs, gate)]
        exact = refined(distance_field(a), distance_field(b), theirs.centre_m, rough)
        if gate is not None:
            exact = [gate.clipped(*pair, theirs.centre_m) for pair in zip(exact, rough, strict=True)]
        found = _distinct(ours, theirs, exact, self.returned)
        asked = {} if prior is None else {"prior_score": log_bayes_factor(ours, theirs, prior.T_receiver_donor)}
        return [_told(ours, theirs, found, rank, asked) for rank in range(len(found))]


def _grid(name: str, map_: Map) -> GridMap:
    if not isinstance(map_, GridMap):
        raise MapError(f"correlation matches occupancy grids, the {name} is a map of type {map_.map_type!r}")
    return map_


def _distinct(target: Prepared, source: Prepared, transforms: Sequence[Transform], count: int) -> list[_Hypothesis]:
    """The best of each place, best first, at most so many."""
    some = thinned(source.walls, ASKED_WALLS)
    spots = np.array([T.apply(some) for T in transforms]).reshape(len(transforms), len(some), 2)
    factors = log_bayes_factors(occupancy_prior(target, source))
    met = [
        _Hypothesis(transforms[k], meet(target, source, transforms[k], factors), spots[k])
        for k in distinct(spots, SAME_M).tolist()
    ]
    kept: list[_Hypothesis] = []
    for one in sorted(met, key=lambda h: -h.met.log_bayes_factor):
        if not any(_same_place(one, other) for other in kept):
            kept.append(one)
        if len(kept) == count:
            break
    return kept


def _mean_distance(a: Points, b: Points) -> float:
    return float(np.hypot(*(a - b).T).mean())


def _same_place(a: _Hypothesis, b: _Hypothesis) -> bool:
    turn = abs(math.remainder(a.T.yaw_rad - b.T.yaw_rad, 2.0 * math.pi))
    return turn <= OTHER_YAW_RAD and _mean_distance(a.spots, b.spots) <= OTHER_SHIFT_M


def _told(
    target: Prepared, source: Prepared, found: Sequence[_Hypothesis], rank: int, asked: Mapping[str, float]
) -> Match:
    """The match with its margin, its evidence, and how certain it is where the walls tell."""
    one = found[rank]
    score = one.met.log_bayes_factor
    others = [other.met.log_bayes_factor for other in found if other is not one]
    evidence = {
        "agreement": float(one.met.agreement),
        "disagreement": float(one.met.disagreement),
        "overlap_cells": float(one.met.overlap),
        "occupied_agreement": float(one.met.occupied_agreement),
        "occupied_m": one.met.near_agreement * target.unit_m,
        "log_bayes_factor": score,
        "rivals": float(sum(other >= RIVAL_SHARE * found[0].met.log_bayes_factor for other in others)),
        "occupancy_prior": occupancy_prior(target, source),
        "resolution_m": target.unit_m,
        **asked,
    }
    bare = Match(one.T, score, score - max(others) if others else math.inf, evidence=evidence)
    known = _certainty(target, source, one.T)
    if known is None:
        return bare
    evidence |= {
        "sigma_max_m": known.sigma_max_m,
        "degenerate_dir_rad": known.degenerate_dir_rad,
        "degenerate": float(known.sigma_max_m > DEGENERATE_M),
    }
    return dataclasses.replace(bare, covariance=known.covariance, evidence=evidence)


def _certainty(target: Prepared, source: Prepared, T: Transform) -> Certainty | None:
    ours, theirs = (Lattice(side.classes, side.unit_m, side.origin_m) for side in (target, source))
    known = certainty(ours, theirs, T, SEARCH_CELLS * target.unit_m, SEARCH_RAD)
    if known is None:
        return None
    return known._replace(
        covariance=known.covariance * REFINED_SHARE, sigma_max_m=known.sigma_max_m * math.sqrt(REFINED_SHARE)
    )
