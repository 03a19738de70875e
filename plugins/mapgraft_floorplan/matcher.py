"""Matching a robot's map to a floor plan whose scale may be unknown."""

from __future__ import annotations

import dataclasses
import math
import weakref
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, Covariance, Map, MapError, Match, Points, Prior, Transform
from mapgraft_floorplan.evidence_table import Agreement, agreement, share_of
from mapgraft_floorplan.kernels.fitting import information
from mapgraft_floorplan.scaled import PlanGrid
from mapgraft_floorplan.search import THOROUGH, Poses, Range, search
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.prepared import Prepared, canonical_m, prepare, thinned
from mapgraft_grid.refinement import Field, distance_field

OTHER_YAW_RAD: Final = math.radians(10.0)  # two hypotheses nearer than this in both are one
OTHER_SHIFT_M: Final = 2.5  # mean displacement of the plan's walls where the robot's map is
OTHER_SHARE: Final = 0.15  # the same as a share of the robot's map, when that is less
ASKED_WALLS: Final = 200
# Scales that are looked at by themselves: the plan reaches from this to that share of the robot's map across
LEAST_EXTENT: Final = 0.6
MOST_EXTENT: Final = 4.0
DESIGN_EFFECT: Final = 40.0  # neighbouring points of a wall err together, and plans are wrong for whole walls
NOISE_M: Final = 0.1  # by which walls of a plan and of a map lie apart

_PLANS: weakref.WeakKeyDictionary[GridMap, PlanGrid] = weakref.WeakKeyDictionary()


class _Hypothesis(NamedTuple):
    pose: NDArray[np.float64]  # (4,) where the plan's centre lies (m, target's frame), yaw, scale
    T: Transform
    met: Agreement
    spots: Points  # where the robot's walls lie in the plan's units, times the scale of the best


class PlanCorrelation:
    """Search over scale, rotation and shift of a plan's walls and rooms on a robot's map.

    The target is the robot's map, the source a plan as a grid. With ``scale="known"`` the scale is 1. With
    ``"unknown"`` every scale is looked at that makes the plan reach across 0.6 to 4 times what the robot has mapped,
    and with ``[least, most]`` those in between. Rotations are those that lay the plan's walls along the robot's
    (histograms of directions); shifts are all, by FFT on cells of 0.25 m. The best are refined on ever finer cells and
    by robust least squares over x, y, yaw and the scale.

    A prior tells where the plan's origin lies and how it is turned; an unknown scale stays open.

    The score is the log likelihood ratio (nats) of how cells meet at right against wrong places, on cells of 0.1 m or
    the robot's when they are coarser (``evidence_table``): furniture and doors in a plan's rooms weigh little. The
    margin is over the best other hypothesis, which lies elsewhere by 10° or by 2.5 m in the mean.

    Evidence: ``agreement``, ``missing`` (walls of the plan in free space), ``added`` (walls of the robot in rooms) in
    cells of ``resolution_m``; ``common_m``, the length of the plan's walls that the robot has, too; ``scale`` and,
    where it was searched, ``sigma_scale``, its standard deviation relative to it; ``scales_searched``; ``lead``, the
    margin over all others that were found, as a share of the score, whichever of them somebody refuses later and
    however the match is refined; with a prior instead ``lead_here``, the same over the others around it, and
    ``prior_score``, if the scale is known. The covariance is of the walls' fit.
    """

    def __init__(self, *, scale: str | Sequence[float] = "known", returned: int = 4) -> None:
        if returned < 2:
            raise ConfigError(f"plan_correlation needs returned >= 2, found {returned}")
        self.returned = returned
        self.scale = scale
        self._range = _range_of(scale)

    def match(self, target: Map, source: Map, prior: Prior | None = None) -> Sequence[Match]:
        """Hypotheses of ``T_target_source`` and scale, best first; EmptyMapError when a map has no wall."""
        a, b = _grid("target", target), _grid("source", source)
        robot, plan = prepare(a, canonical_m(a.resolution_m), "target"), _plan(b)
        scales = self._range or extents(robot, plan)
        field = distance_field(a)
        poses = search(robot, field, plan, scales, prior)
        if not len(poses):
            return []
        found = _distinct(robot, plan, poses, scales, self.returned)
        asked: dict[str, float] = {"scales_searched": float(len(scales.steps()))}
        if prior is not None and scales.most == scales.least:
            placed = plan.at(scales.least, robot.unit_m)
            asked["prior_score"] = agreement(robot, placed, prior.T_receiver_donor).log_ratio
        return [_told(robot, plan, field, found, rank, scales, asked, prior is None) for rank in range(len(found))]


def extents(robot: Prepared, plan: PlanGrid) -> Range:
    """The scales at which a plan and a robot's map can be of the same building."""
    spread = robot.walls - np.median(robot.walls, axis=0)
    reach = 2.0 * float(np.quantile(np.hypot(*spread.T), 0.98))
    own = 2.0 * plan.radius
    return Range(LEAST_EXTENT * reach / own, MOST_EXTENT * reach / own)


def _distinct(robot: Prepared, plan: PlanGrid, poses: Poses, scales: Range, count: int) -> list[_Hypothesis]:
    """The best of each place, best first, at most so many."""
    some = thinned(robot.walls, ASKED_WALLS)
    made = []
    for pose in poses[:, :4]:
        if not 0.9 * scales.least <= pose[3] <= 1.1 * scales.most:
            continue
        T = _transform(pose, plan.centre)
        placed = plan.at(float(pose[3]), robot.unit_m)
        met = agreement(robot, placed, T, any_scale=scales.most > scales.least)
        made.append(_Hypothesis(pose, T, met, T.inverse().apply(some) / pose[3]))
    kept: list[_Hypothesis] = []
    for one in sorted(made, key=lambda h: -h.met.log_ratio):
        if not any(_same_place(one, other, robot.radius_m) for other in kept):
            kept.append(one)
        if len(kept) == count:
            break
    return kept


def _same_place(a: _Hypothesis, b: _Hypothesis, reach_m: float) -> bool:
    """Whether two hypotheses put the robot's walls to about the same places of the plan."""
    turn = abs(math.remainder(float(a.pose[2] - b.pose[2]), 2.0 * math.pi))
    apart_m = float(np.hypot(*(a.spots - b.spots).T).mean()) * float(b.pose[3])
    return turn <= OTHER_YAW_RAD and apart_m <= max(0.5, min(OTHER_SHIFT_M, OTHER_SHARE * reach_m))


def _transform(pose: NDArray[np.float64], centre: NDArray[np.float64]) -> Transform:
    """The rigid part that, after stretching, brings the plan's centre to (x, y)."""
    x, y, yaw, scale = (float(value) for value in pose)
    turned = Transform.planar(0.0, 0.0, yaw).apply(scale * centre[None])[0]
    return Transform.planar(x - float(turned[0]), y - float(turned[1]), yaw)


def _told(
    robot: Prepared,
    plan: PlanGrid,
    field: Field,
    found: Sequence[_Hypothesis],
    rank: int,
    scales: Range,
    asked: Mapping[str, float],
    everywhere: bool,
) -> Match:
    one = found[rank]
    scale, score = float(one.pose[3]), one.met.log_ratio
    others = [other.met.log_ratio for other in found if other is not one]
    evidence = {
        "agreement": float(one.met.agreeing),
        "missing": float(one.met.missing),
        "added": float(one.met.added),
        "common_m": one.met.common * robot.unit_m,
        "scale": scale,
        "resolution_m": robot.unit_m,
        **asked,
    }
    free = scales.most > scales.least
    margin = score - max(others) if others else math.inf
    if others or not everywhere:
        evidence["lead" if everywhere else "lead_here"] = share_of(margin, score)
    bare = Match(one.T, score, margin, scale=scale if free else 1.0, evidence=evidence)
    covariance, sigma_scale = _covariance(plan, field, one, free)
    if covariance is None:
        return bare
    told = {"sigma_scale": sigma_scale} if free else {}
    return dataclasses.replace(bare, covariance=covariance, evidence={**evidence, **told})


def _covariance(plan: PlanGrid, field: Field, one: _Hypothesis, free: bool) -> tuple[Covariance | None, float]:
    """The (6, 6) covariance of T, the scale's uncertainty included, and the scale's relative standard deviation."""
    pose = one.pose.copy()
    pose[:2] -= field.origin_m
    points = thinned(plan.walls - plan.centre, THOROUGH.points)
    told, n = information(field.distances_m, field.unit_m, points, pose, NOISE_M)
    if n < 20:
        return None, math.nan
    size = 4 if free else 3
    share = len(plan.walls) / max(1, len(points)) * plan.unit * float(pose[3]) / field.unit_m
    weight = max(share, 1e-6) / NOISE_M**2 / DESIGN_EFFECT
    floor = np.diag([1e-4, 1e-4, 1e-2, 1e-2])[:size, :size]
    here = np.linalg.inv(weight * told[:size, :size] + floor)
    scale, x, y = float(pose[3]), one.T.x_m, one.T.y_m
    jacobian = np.zeros((6, size))  # the plan's origin lies off its centre: a turn and a stretch move it
    jacobian[0, 0] = jacobian[1, 1] = jacobian[5, 2] = 1.0
    jacobian[:2, 2] = one.pose[1] - y, x - one.pose[0]
    if free:
        jacobian[:2, 3] = (x - one.pose[0]) / scale, (y - one.pose[1]) / scale
    covariance: Covariance = jacobian @ here @ jacobian.T
    return (covariance + covariance.T) / 2.0, math.sqrt(float(here[3, 3])) / scale if free else 0.0


def _plan(map_: GridMap) -> PlanGrid:
    if map_ not in _PLANS:
        _PLANS[map_] = PlanGrid.of(map_)
    return _PLANS[map_]


def _grid(name: str, map_: Map) -> GridMap:
    if not isinstance(map_, GridMap):
        raise MapError(f"plan_correlation matches occupancy grids, the {name} is a map of type {map_.map_type!r}")
    return map_


def _range_of(scale: Any) -> Range | None:
    """The range that a rule asks for; None where the maps tell it."""
    if scale == "known":
        return Range(1.0, 1.0)
    if scale == "unknown":
        return None
    try:
        least, most = (float(value) for value in scale)
    except (TypeError, ValueError):
        raise ConfigError(
            f"plan_correlation takes the scale known, unknown or [least, most], found {scale!r}"
        ) from None
    if not 0.0 < least <= most < math.inf:
        raise ConfigError(f"plan_correlation needs 0 < least <= most for the scale, found {scale!r}")
    return Range(least, most)
