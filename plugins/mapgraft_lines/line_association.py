"""Matching maps of line segments by walls that consistently lie on each other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, Map, MapError, Match, Points, Prior, Transform
from mapgraft_grid.gate import Gate
from mapgraft_lines.alignment import Fit, aligned, fit_of, planar_covariance
from mapgraft_lines.crossing import crossing_m
from mapgraft_lines.hypotheses import propose
from mapgraft_lines.kernels.explaining import AGAINST, EXPLAINED, FULL, LENGTH, SQUARES
from mapgraft_lines.line_map import as_map
from mapgraft_lines.scene import PROPOSING, Poses, Scene, both_ways, scene_of

ACROSS_M: Final = 0.25  # walls that may be one lie no further apart
ALIGNED: Final = 24  # proposals that are aligned, the best
SAME_M: Final = 0.05  # aligned proposals nearer than this are one and the same
OTHER_YAW_RAD: Final = math.radians(10.0)  # two hypotheses nearer than this in both are one
OTHER_SHIFT_M: Final = 2.5  # mean displacement of the source's walls
DEGENERATE_M: Final = 0.25  # as for occupancy grids: half a metre at two standard deviations
CROSSING_M: Final = 1.0  # with less wall across the rest nothing tells how far maps are shifted along it
RIVAL_SHARE: Final = 0.5


class _Hypothesis(NamedTuple):
    pose: NDArray[np.float64]
    told: NDArray[np.float64]  # (2, 5) of kernels.explaining
    score: float
    spots: Points  # the ends of the source's walls there


class LineAssociation:
    """Finds the placements under which the walls of two maps consistently lie on each other.

    Rotations come from how much wall runs in which direction, with the side from which it was seen. For each of the
    best 12, every pair of walls that then run alike votes for the shifts under which they lie on each other; shifts on
    which pairs of more than one direction agree collect most. The best are aligned by least squares across the walls,
    and compared with all there is: the score is the length of wall, of both maps, that the other explains (less, the
    more it is off, none beyond 0.25 m; of a wall of length l that counts 2 m · log(1 + l / 2 m)), minus ``against``
    times the length that stands in the other's free space. In metres, so that placements of the same two maps can be
    compared. The best ``returned`` come back; two of them differ by more than 10° or by more than 2.5 m where the
    source's walls are. Never a reflection. A prior restricts the search to 3.5 of its standard deviations and a little
    more.

    Evidence: ``explained_m`` and ``against_m`` (both maps together), ``explained_target`` and ``explained_source`` (the
    share of the walls of either that the other explains), ``residual_m``, ``pairs`` and ``inlier_m`` (overlaps of walls
    and their length), ``crossing_m`` (of it what runs across the rest), ``rivals`` (other hypotheses with half of the
    best score or more); with a prior ``prior_score``; ``sigma_max_m``, ``degenerate_dir_rad`` and ``degenerate``
    as ``correlation`` tells them: 1 when along some direction nothing tells the shift better than 0.25 m.

    Source: maps of segments brought together by which correspond, as in R. Lakaemper, L. J. Latecki and D. Wolter,
    Incremental multi-robot mapping, IROS 2005; votes by overlap are this project's own.
    """

    def __init__(self, *, returned: int = 4, against: float = 3.0) -> None:
        if isinstance(returned, bool) or not isinstance(returned, int) or returned < 2:
            raise ConfigError(f"line_association needs a whole number returned >= 2, found {returned!r}")
        if not 0.0 <= against <= 100.0:
            raise ConfigError(f"line_association needs against in [0, 100], found {against!r}")
        self.returned, self.against = returned, against

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        """Hypotheses of ``T_target_source``, best first; none when no wall can lie on another.

        Raises EmptyMapError when a map knows nothing, MapError when it has no walls, or, without a prior, none that run
        across the others.
        """
        ours, theirs = scene_of(as_map(target), "target"), scene_of(as_map(source), "source")
        if prior is None:
            _require_crossing(ours, "target")
            _require_crossing(theirs, "source")
        gate = None if prior is None else Gate.of(prior, theirs.centre_m)
        found = self._distinct(ours, theirs, self._aligned(ours, theirs, gate))
        asked: dict[str, float] = {}
        if gate is not None:
            told = both_ways(ours, theirs, _asked(gate, ours), ACROSS_M)
            asked["prior_score"] = float(self._scores(told)[0])
        return [self._match(ours, theirs, found, rank, asked) for rank in range(len(found))]

    def _aligned(self, ours: Scene, theirs: Scene, gate: Gate | None) -> Poses:
        """The best proposals, aligned; within the gate."""
        rough = propose(ours, theirs, gate)
        if gate is not None:
            rough = np.concatenate((_asked(gate, ours), rough))
        some, others = ours.longest(PROPOSING), theirs.longest(PROPOSING)
        scores = self._scores(both_ways(some, others, rough, ACROSS_M))
        rough = rough[np.argsort(-scores, kind="stable")[:ALIGNED]]
        exact = np.array([aligned(some, others, pose) for pose in rough]).reshape(-1, 3)
        if gate is None:
            return exact
        inside = gate.admits(exact + np.array([*ours.centre_m, 0.0]))
        return np.where(inside[:, None], exact, rough)

    def _scores(self, told: NDArray[np.float64]) -> NDArray[np.float64]:
        scores: NDArray[np.float64] = (told[:, :, EXPLAINED] - self.against * told[:, :, AGAINST]).sum(axis=1)
        return scores

    def _distinct(self, ours: Scene, theirs: Scene, poses: Poses) -> list[_Hypothesis]:
        """The best of each place, best first; what explains nothing is none."""
        told = both_ways(ours, theirs, poses, ACROSS_M)
        scores = self._scores(told)
        kept: list[_Hypothesis] = []
        for k in np.argsort(-scores, kind="stable").tolist():
            if told[k, :, FULL].sum() <= 0.0:
                continue
            one = _Hypothesis(poses[k], told[k], float(scores[k]), _placed(theirs.ends.reshape(-1, 2), poses[k]))
            if not any(_same_place(one, other) for other in kept):
                kept.append(one)
            if len(kept) == self.returned:
                break
        return kept

    def _match(
        self, ours: Scene, theirs: Scene, found: Sequence[_Hypothesis], rank: int, asked: Mapping[str, float]
    ) -> Match:
        one = found[rank]
        others = [other.score for other in found if other is not one]
        x, y, yaw = _uncentred(one.pose[None], ours, theirs)[0].tolist()
        told = one.told
        evidence = {
            "explained_m": float(told[:, FULL].sum()),
            "against_m": float(told[:, AGAINST].sum()),
            "explained_target": float(told[0, FULL] / told[0, LENGTH]),
            "explained_source": float(told[1, FULL] / told[1, LENGTH]),
            "residual_m": math.sqrt(float(told[:, SQUARES].sum() / told[:, FULL].sum())),
            "rivals": float(sum(score >= RIVAL_SHARE * found[0].score for score in others)),
            **asked,
        }
        fit = fit_of(ours, theirs, one.pose)
        covariance = None
        if fit is not None:
            evidence |= _told(fit)
            origin = _placed(-theirs.centre_m[None], one.pose)[0]  # of the source's frame
            covariance = planar_covariance(fit, one.pose, origin)
        margin = one.score - max(others) if others else math.inf
        return Match(Transform.planar(x, y, yaw), one.score, margin, covariance=covariance, evidence=evidence)


def _told(fit: Fit) -> dict[str, float]:
    return {
        "pairs": float(fit.pairs),
        "inlier_m": fit.inlier_m,
        "crossing_m": fit.crossing_m,
        "sigma_max_m": fit.sigma_max_m,
        "degenerate_dir_rad": fit.direction_rad,
        "degenerate": float(fit.sigma_max_m > DEGENERATE_M),
    }


def _require_crossing(scene: Scene, name: str) -> None:
    crossing = crossing_m(scene.angles_rad, scene.lengths_m)
    if crossing < CROSSING_M:
        raise MapError(
            f"the {name}'s {len(scene.ends)} walls all run one way ({crossing:.1f} of {scene.lengths_m.sum():.1f} m "
            f"across): how far two maps are shifted along them cannot be told; map {CROSSING_M:g} m of wall across "
            "them, or give a prior"
        )


def _placed(points: Points, pose: NDArray[np.float64]) -> Points:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    placed: Points = points @ np.array([[c, s], [-s, c]]) + pose[:2]
    return placed


def _asked(gate: Gate, ours: Scene) -> Poses:
    """The pose (1, 3) between the two centres at which the prior says that the source lies."""
    return np.array([[*(gate.place_m - ours.centre_m), gate.yaw_rad]])


def _uncentred(poses: Poses, ours: Scene, theirs: Scene) -> Poses:
    """Poses between the two centres as those of T_target_source."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y = theirs.centre_m
    shift = np.column_stack((c * x - s * y, s * x + c * y))
    return np.column_stack((poses[:, :2] - shift + ours.centre_m, poses[:, 2]))


def _same_place(a: _Hypothesis, b: _Hypothesis) -> bool:
    turn = abs(math.remainder(a.pose[2] - b.pose[2], math.tau))
    return turn <= OTHER_YAW_RAD and float(np.hypot(*(a.spots - b.spots).T).mean()) <= OTHER_SHIFT_M
