"""The matcher ``gicp``: small_gicp from a prior to the best transform near it; and what every refinement needs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, Covariance, EmptyMapError, Map, MapError, Match, Prior, Transform
from mapgraft_cloud.agreement import Agreement, agreement
from mapgraft_cloud.cloud_map import CloudMap, as_map
from mapgraft_cloud.surface import Surface

FEWEST_POINTS: Final = 30
_WIDE_M, _NARROW_M = 1.0, 0.4  # largest distance of a pair, first and last run
_ROUNDS: Final = 30
_NEIGHBOURS: Final = 15  # of which small_gicp makes a covariance
_STEPS: Final = {_WIDE_M: 1e-3, _NARROW_M: 1e-5}  # m and rad: smaller ones end a run
_MOST_TILT_RAD: Final = math.radians(6.0)  # of a hypothesis for maps whose z axes are said to point up
# points err together and maps bend; even so the squared errors of simulated drives are larger than they should be, see
# ``squares`` in tests/bench/choose_cloud_limits.py and docs/clouds.md
_TOGETHER: Final = 400.0
_LARGEST_SIGMA: Final = 10.0  # m or rad: what the clouds do not determine at all
_UPRIGHT_AXES: Final = [0, 1, 2, 5]  # x, y, z, yaw


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Where a refinement ended, what it rests on, and how well the clouds agree there."""

    T: Transform
    covariance: Covariance
    inliers: int
    residual_m: float
    agreement: Agreement

    @property
    def evidence(self) -> dict[str, float]:
        sigma = np.sqrt(np.diag(self.covariance))
        return {
            "inliers": float(self.inliers),
            "residual_m": self.residual_m,
            "shared_m2": self.agreement.shared_m2,
            "seen_through_m2": self.agreement.through_m2,
            "overlap": self.agreement.shared_m2 / max(self.agreement.covered_m2, 1e-9),
            "sigma_m": float(np.linalg.norm(sigma[:3])),
            "sigma_yaw_rad": float(sigma[5]),
        }


class Gicp:
    """Refines a prior by generalised ICP and tells how well the clouds agree.

    ``aligned``: both maps' z axes point up, so that only x, y, z and yaw are open; floors and ceilings then do not
    count in the score, because they agree everywhere. The score is in square metres of surface: what both maps have,
    less twice what the other saw through (``seen_through_m2``). Evidence: ``inliers`` and their mean ``residual_m``,
    ``shared_m2``, ``overlap`` (the shared part of what both looked at), ``lead`` (the margin as a share of the score),
    ``sigma_m`` and ``sigma_yaw_rad`` from the covariance, and ``prior_score``. The covariance is the inverse Hessian of
    the last run, scaled by the residuals, times 400: points that lie near each other err together, and maps bend.

    A second hypothesis comes from the prior shifted along and across by its own uncertainty, where that leads to
    another place. Source: K. Koide, small_gicp (JOSS 2024).
    """

    def __init__(self, *, aligned: bool = True) -> None:
        self.aligned = _flag("gicp", aligned)

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        """Raises MapError without a prior, EmptyMapError where a map has nothing to hold on to."""
        pair = Pair.of(target, source, self.aligned)
        if prior is None:
            raise MapError("gicp refines a prior, and nobody knows one for this pair: match with kiss, or give a prior")
        return around_prior(pair, prior)


def around_prior(pair: Pair, prior: Prior) -> list[Match]:
    """What refinement finds from a prior and from places about it, best first."""
    T = prior.T_receiver_donor
    scored = agreement(pair.target, pair.source, T, pair.aligned).score_m2
    sigma = np.sqrt(np.maximum(np.diag(np.asarray(prior.covariance, np.float64)), 0.0))
    starts = [T, *(_shifted(T, sigma, direction) for direction in ((1, 0), (-1, 0), (0, 1), (0, -1)))]
    refined = [one for start in dict.fromkeys(starts) if (one := refine(pair, start)) is not None]
    return as_matches(distinct(pair, refined), {"prior_score": scored})


def _shifted(T: Transform, sigma: NDArray[np.float64], direction: tuple[int, int]) -> Transform:
    moved = T.matrix.copy()
    moved[:2, 3] += 1.5 * np.minimum(sigma[:2], _WIDE_M) * direction
    return Transform(moved)


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """Two maps ready for refinement, with what small_gicp makes of them."""

    target: CloudMap
    source: CloudMap
    aligned: bool
    _target: Any
    _source: Any
    _tree: Any

    @classmethod
    def of(cls, target: Map, source: Map, aligned: bool) -> Pair:
        """Raises EmptyMapError where one of the two has too little to hold on to."""
        maps = as_map(target), as_map(source)
        for side, map_ in zip(("receiver", "donor"), maps, strict=True):
            if len(map_.surface.points_m) < FEWEST_POINTS:
                raise EmptyMapError(
                    f"the {side}'s point cloud map has {len(map_.surface.points_m)} places on surfaces, "
                    f"{FEWEST_POINTS} are needed: map more before matching"
                )
        (target_cloud, tree), (source_cloud, _) = (_prepared(map_.surface) for map_ in maps)
        return cls(*maps, aligned, target_cloud, source_cloud, tree)

    def align(self, start: Transform, pair_m: float) -> Any:
        """One run of small_gicp."""
        import small_gicp

        return small_gicp.align(
            self._target,
            self._source,
            self._tree,
            start.matrix,
            "GICP",
            pair_m,
            1,
            _ROUNDS,
            rotation_epsilon=_STEPS[pair_m],
            translation_epsilon=_STEPS[pair_m],
        )


def _prepared(surface: Surface) -> tuple[Any, Any]:
    import small_gicp

    cloud = small_gicp.PointCloud(surface.points_m)
    tree = small_gicp.KdTree(cloud)
    small_gicp.estimate_covariances(cloud, tree, _NEIGHBOURS)
    return cloud, tree


def refine(pair: Pair, start: Transform) -> Refined | None:
    """The best transform near a start; None where the clouds do not hold together there."""
    result: Any = None
    T = start
    for pair_m in (_WIDE_M, _NARROW_M):
        result = pair.align(T, pair_m)
        if result.num_inliers < FEWEST_POINTS or not np.isfinite(result.T_target_source).all():
            return None
        found = _rigid(result.T_target_source)
        # where the clouds hold together only when they tilt, the place they came from is as good as any near it
        T = (_levelled(found, _in_target(found, result.H)) or T) if pair.aligned else found
    return Refined(
        T,
        _covariance(_in_target(T, result.H), result, pair.aligned),
        int(result.num_inliers),
        _residual_m(pair, T),
        agreement(pair.target, pair.source, T, pair.aligned),
    )


def _rigid(matrix: NDArray[np.float64]) -> Transform:
    """The nearest rigid transform: steps of an optimiser add up to one that is rigid but for rounding."""
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    clean = np.eye(4)
    clean[:3, :3], clean[:3, 3] = u @ vt, matrix[:3, 3]
    return Transform(clean)


def _in_target(T: Transform, hessian: NDArray[np.float64]) -> NDArray[np.float64]:
    """small_gicp's Hessian, of a rotation and a shift in the source's frame, for x, y, z, roll, pitch, yaw in the
    target's, rotations about the source's origin."""
    inner = np.zeros((6, 6))  # (rotation, shift) in the source's frame from (shift, rotation) in the target's
    inner[:3, 3:], inner[3:, :3] = T.matrix[:3, :3].T, T.matrix[:3, :3].T
    return inner.T @ np.asarray(hessian, np.float64) @ inner


def _levelled(T: Transform, hessian: NDArray[np.float64]) -> Transform | None:
    """The upright transform that costs least by the quadratic that the Hessian tells; None where it tilts too much.

    Roll and pitch are taken back, and x, y, z and yaw follow as far as they hang together with them.
    """
    up = T.matrix[:3, 2]
    tilt = math.acos(min(1.0, float(up[2])))
    if tilt > _MOST_TILT_RAD:
        return None
    back = np.array([up[1], -up[0]])  # the rotation about x and y that brings z up again, to first order
    free = hessian[np.ix_(_UPRIGHT_AXES, _UPRIGHT_AXES)]
    step = -np.linalg.lstsq(free, hessian[np.ix_(_UPRIGHT_AXES, [3, 4])] @ back, rcond=1e-9)[0]
    yaw = T.yaw_rad + float(step[3])
    return Transform.from_matrix(
        np.vstack(
            (
                np.column_stack((Transform.planar(0.0, 0.0, yaw).matrix[:3, :3], T.matrix[:3, 3] + step[:3])),
                (0.0, 0.0, 0.0, 1.0),
            )
        )
    )


def _covariance(hessian: NDArray[np.float64], result: Any, aligned: bool) -> Covariance:
    """(6, 6) of x, y, z, roll, pitch, yaw in the target's frame; what is not open is zero."""
    axes = _UPRIGHT_AXES if aligned else list(range(6))
    spread = _TOGETHER * max(2.0 * float(result.error) / max(int(result.num_inliers) - len(axes), 1), 1e-3)
    values, vectors = np.linalg.eigh(hessian[np.ix_(axes, axes)] / spread)
    inverse = (vectors / np.maximum(values, _LARGEST_SIGMA**-2)) @ vectors.T
    covariance = np.zeros((6, 6))
    covariance[np.ix_(axes, axes)] = (inverse + inverse.T) / 2.0
    return covariance


def _residual_m(pair: Pair, T: Transform) -> float:
    """The mean distance of the source's points from the planes of the target, of those within the last distance."""
    surface = pair.target.surface
    away, nearest = surface.tree.query(T.apply(pair.source.surface.points_m), distance_upper_bound=_NARROW_M)
    near = np.isfinite(away)
    if not near.any():
        return math.inf
    apart = T.apply(pair.source.surface.points_m)[near] - surface.points_m[nearest[near]]
    return float(np.abs((apart * surface.normals[nearest[near]]).sum(axis=1)).mean())


SAME_M: Final = 0.5  # nearer, two hypotheses are one
SAME_RAD: Final = math.radians(5.0)


def distinct(pair: Pair, found: Sequence[Refined]) -> list[Refined]:
    """The best of those that put the source's map in one place, best first."""
    kept: list[Refined] = []
    for one in sorted(found, key=lambda one: -one.agreement.score_m2):
        if not any(same_place(pair, one.T, other.T) for other in kept):
            kept.append(one)
    return kept


def same_place(pair: Pair, T_a: Transform, T_b: Transform) -> bool:
    """Whether two transforms put the middle of the source's map at one place, turned alike."""
    middle = pair.source.surface.points_m.mean(axis=0, keepdims=True)
    apart_m = float(np.linalg.norm(T_a.apply(middle) - T_b.apply(middle)))
    return apart_m < SAME_M and T_a.difference(T_b)[1] < SAME_RAD


def as_matches(found: Sequence[Refined], evidence: dict[str, float] | None = None) -> list[Match]:
    """Matches of distinct hypotheses, best first."""
    scores = [one.agreement.score_m2 for one in found]
    matches = []
    for k, one in enumerate(found):
        rivals = scores[:k] + scores[k + 1 :]
        margin = scores[k] - max(rivals) if rivals else math.inf
        lead = 0.0 if scores[k] <= 0.0 else 1.0 - max(0.0, *rivals, -1.0) / scores[k]
        said = {**one.evidence, "lead": max(0.0, lead), **(evidence or {})}
        matches.append(Match(one.T, scores[k], margin, covariance=one.covariance, evidence=said))
    return matches


def _flag(who: str, value: bool) -> bool:
    if not isinstance(value, bool):
        raise ConfigError(f"aligned of {who} must be true or false, found {value!r}")
    return value
