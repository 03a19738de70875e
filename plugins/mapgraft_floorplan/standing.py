"""How a robot's map stands to a plan laid upon it: what both have, and where they differ."""

from __future__ import annotations

import math
import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Comparison, EmptyMapError, Transform
from mapgraft_floorplan.evidence_table import Agreement, agreement
from mapgraft_grid.grid_map import FREE, OCCUPIED, UNKNOWN, Classes, GridMap
from mapgraft_grid.overlap import pair_of
from mapgraft_grid.prepared import canonical_m, prepare

SAME_M: Final = 0.12  # a wall this near its place stands as drawn: cells and the placement are off by as much
DISPLACED_M: Final = 0.5  # farther off it is another wall
LEAST_M: Final = 0.5  # of wall: less is a door frame, a pillar or noise

AGREES: Final = 1
DISPLACED: Final = 2
MISSING: Final = 3
ADDED: Final = 4

Kinds = NDArray[np.uint8]  # (h, w) what a cell of wall is, 0 where there is none or nobody has looked


@dataclass(frozen=True, slots=True, eq=False)
class Differences:
    """A window of cells of ``unit_m`` from ``origin_m`` (x, y) on: what the plan's walls are, and what the robot's are.

    ``plan`` and ``robot`` (h, w) hold AGREES, DISPLACED, MISSING and ADDED; ``off_m`` (h, w) how far off a displaced
    wall of the plan stands.
    """

    plan: Kinds
    robot: Kinds
    off_m: NDArray[np.float32]
    unit_m: float
    origin_m: tuple[float, float]

    def lengths_m(self) -> Mapping[str, float]:
        """How much wall is what, in metres: of the plan's that the robot looked at, and of the robot's beside it."""
        plan = {kind: float(np.count_nonzero(self.plan == kind)) for kind in (AGREES, DISPLACED, MISSING)}
        return {
            "agreed_m": plan[AGREES] * self.unit_m,
            "displaced_m": plan[DISPLACED] * self.unit_m,
            "missing_m": plan[MISSING] * self.unit_m,
            "added_m": float(np.count_nonzero(self.robot == ADDED)) * self.unit_m,
        }


_KEPT: weakref.WeakKeyDictionary[GridMap, tuple[weakref.ref[GridMap], Differences]] = weakref.WeakKeyDictionary()


def agreement_of(comparison: Comparison, metric: str) -> Agreement | None:
    """How the cells of both meet; None when one of them has no wall."""
    target, donor = pair_of(comparison, metric)
    unit_m = canonical_m(target.resolution_m)
    try:
        robot, plan = prepare(target, unit_m), prepare(donor, unit_m)
    except EmptyMapError:
        return None
    return agreement(robot, plan, Transform.identity())


def differences_of(comparison: Comparison, metric: str) -> Differences | None:
    """Where they differ, made once for both maps; None when one of them is empty."""
    target, donor = pair_of(comparison, metric)
    if target.is_empty or donor.is_empty:
        return None
    kept = _KEPT.get(donor)
    if kept is None or kept[0]() is not target:
        kept = _KEPT[donor] = (weakref.ref(target), _made(target, donor))
    return kept[1]


def _made(target: GridMap, donor: GridMap) -> Differences:
    import cv2

    x0, y0, x1, y1 = target.bounds_cells()
    unit_m = target.resolution_m
    margin = math.ceil(DISPLACED_M / unit_m) + 1
    first, shape = (x0 - margin, y0 - margin), (y1 - y0 + 2 * margin, x1 - x0 + 2 * margin)
    seen, drawn = target.dense_over(first, shape).classes, donor.dense_over(first, shape).classes
    to_robot, to_plan = _to_walls(seen, unit_m), _to_walls(drawn, unit_m)
    around = cv2.dilate((seen == FREE).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    walls = drawn == OCCUPIED
    same_m = max(SAME_M, 1.5 * unit_m)
    plan = np.zeros(shape, np.uint8)
    plan[walls & (to_robot <= same_m)] = AGREES
    plan[walls & (to_robot > same_m) & (to_robot <= DISPLACED_M) & around] = DISPLACED
    plan[walls & (to_robot > DISPLACED_M) & (seen == FREE)] = MISSING
    # behind a wall that stands as drawn, or elsewhere, lies the other face of it: nobody can have seen that
    robot = np.zeros(shape, np.uint8)
    mine = seen == OCCUPIED
    robot[mine & (to_plan <= DISPLACED_M)] = AGREES
    robot[mine & (to_plan > DISPLACED_M) & (drawn != UNKNOWN)] = ADDED
    off = np.where(plan == DISPLACED, to_robot, 0.0).astype(np.float32)
    corner = target.lattice.corner_m(*first)
    return Differences(thinned_lines(plan), thinned_lines(robot), off, unit_m, corner)


def thinned_lines(kinds: Kinds) -> Kinds:
    """The kinds without the thickness of walls: of each run of cells side by side across a wall one is left."""
    walls = kinds > 0
    across_x = np.zeros_like(walls)
    across_x[:, 1:] = walls[:, :-1]
    across_y = np.zeros_like(walls)
    across_y[1:] = walls[:-1]
    corner = np.zeros_like(walls)
    corner[1:, 1:] = walls[:-1, :-1]
    out = kinds.copy()
    out[across_x & across_y & corner] = 0
    return out


def _to_walls(classes: Classes, unit_m: float) -> NDArray[np.float32]:
    import cv2

    walls = classes == OCCUPIED
    if not walls.any():
        return np.full(classes.shape, np.inf, np.float32)
    away = cv2.distanceTransform((~walls).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away * np.float32(unit_m), np.float32)
