"""The search of the plan matcher: scales, rotations and shifts on coarse cells, then the best on finer ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from mapgraft.contracts import Points, Prior
from mapgraft_floorplan.directions import histogram, turns
from mapgraft_floorplan.evidence_table import FACTORS
from mapgraft_floorplan.kernels.fitting import fit
from mapgraft_floorplan.scaled import PlanGrid
from mapgraft_grid.correlation_search import Level, Sample, scored, shifts_within, spectra, unwrapped
from mapgraft_grid.gate import Gate
from mapgraft_grid.kernels.correlating import climb, fields, peaks
from mapgraft_grid.prepared import Prepared, thinned
from mapgraft_grid.refinement import Field

COARSE_M: Final = 0.25  # cells on which everything is searched
MOST_ACROSS: Final = 160  # of them across the robot's map; larger maps are searched on larger cells
FINE: Final = 2  # canonical cells across the finer level's
RING: Final = 0.4  # what a plan's wall beside a wall tells, as a share of one upon it
STEP: Final = 0.035  # of the log of the scale
PER_TURN: Final = 6  # local maxima that are kept of each rotation and scale
PER_TURN_KNOWN: Final = 40  # of each rotation, where the scale is known
KEPT: Final = 240
PER_SCALE: Final = 10
KEPT_FINE: Final = 60
PER_BAND: Final = 4
BAND: Final = 0.15  # of the log of the scale
MOST_FOUND: Final = 80
CLEAR_CELLS: Final = 0.75  # rooms this near a wall tell nothing on coarse cells
POINTS: Final = (3_000, 2_500)  # walls and room cells of the plan that are looked at
TURN_RAD: Final = math.radians(2.0)  # directions are found to about that
ALL_TURNS: Final = 90  # of half a turn, where no direction stands out

Poses = NDArray[np.float64]  # (k, 5) where the plan's centre comes to lie (m), yaw, scale, score; best first


class Effort(NamedTuple):
    """How thoroughly poses are fitted: points of each side, scales of the robust loss, steps with each."""

    points: int
    sigmas_m: tuple[float, ...]
    steps: int


QUICK: Final = Effort(250, (0.8, 0.4), 5)
THOROUGH: Final = Effort(800, (0.4, 0.2, 0.1), 8)


class Range(NamedTuple):
    """The scales that are searched, both included."""

    least: float
    most: float

    def steps(self) -> list[float]:
        count = max(1, math.ceil(math.log(self.most / self.least) / STEP) + 1) if self.most > self.least else 1
        return [float(scale) for scale in np.geomspace(self.least, self.most, count)]


def search(robot: Prepared, field: Field, plan: PlanGrid, scales: Range, prior: Prior | None = None) -> Poses:
    """The poses with the highest log likelihood ratios, some dozens, fitted; only those that were within the prior.

    A prior tells where the plan's origin lies and how it is turned; what that leaves of places for its middle depends
    on the scale.

    What is best on coarse cells at one scale need not be so at another, so of each scale some are kept. They are fitted
    to the walls before they are compared on finer cells: half a step of scale moves a far wall by more than a cell.
    """
    across = max(robot.classes.shape) * robot.unit_m
    factor = max(FINE, round(max(COARSE_M, across / MOST_ACROSS) / robot.unit_m))
    coarse, fine = _level(robot, factor), _level(robot, FINE)
    sample, yaws = _sampled(plan), rotations(robot, plan)
    steps, free = scales.steps(), scales.most > scales.least
    each = PER_SCALE if free else KEPT
    found = []
    for scale in steps:
        here = _stretched(sample, scale, robot.unit_m, CLEAR_CELLS * coarse.unit_m)
        gate = None if prior is None else Gate.of(prior, scale * plan.centre)
        poses = _at_scale(coarse, here, plan, scale, yaws, PER_TURN if free else PER_TURN_KNOWN, gate)
        found.append(_best(poses, each, coarse.unit_m, STEP))
    poses = fitted(field, plan, np.concatenate(found), QUICK, free)
    poses = _best_of_bands(_best(_scored(fine, sample, robot.unit_m, poses), len(poses), fine.unit_m, 0.5 * STEP))
    return _best(fitted(field, plan, poses, THOROUGH, free), MOST_FOUND, 0.1, 0.005)


def fitted(field: Field, plan: PlanGrid, poses: Poses, effort: Effort, free: bool) -> Poses:
    """The poses moved to where the walls of both lie on each other; their scores are those of before."""
    if not len(poses):
        return poses
    start = np.ascontiguousarray(poses[:, :4])
    start[:, :2] -= field.origin_m
    points = thinned(plan.walls - plan.centre, effort.points)
    ours = thinned(field.points, effort.points) - field.origin_m
    ranges = (field.distances_m, field.unit_m, ours, plan.field, plan.field_unit, points, plan.corner)
    made = fit(*ranges, start, np.array(effort.sigmas_m), effort.steps, free)
    made[:, :2] += field.origin_m
    return np.column_stack((made, poses[:, 4]))


def rotations(robot: Prepared, plan: PlanGrid) -> list[float]:
    """Rotations that lay the plan's walls along the robot's, half a turn left open."""
    ours = robot.kept.get("directions")
    if ours is None:
        ours = robot.kept["directions"] = histogram(robot.classes)
    found = turns(np.asarray(ours), plan.directions)
    return (np.arange(ALL_TURNS) * (math.pi / ALL_TURNS)).tolist() if found is None else found


def _level(robot: Prepared, factor: int) -> Level:
    """What walls and rooms of a plan tell on the robot's map."""
    on_wall, on_room = fields(robot.marks, factor, FACTORS[:, 2].copy(), FACTORS[:, 1].copy(), RING)
    return Level(0.0, factor * robot.unit_m, robot.origin_m, on_wall, on_room)


class _Points(NamedTuple):
    """Some walls and room cells of a plan from its centre, these with their distances to walls.

    ``length`` and ``area`` are how much of the plan each stands for.
    """

    walls: Points
    rooms: Points
    clear: NDArray[np.float64]
    length: float
    area: float


def _sampled(plan: PlanGrid) -> _Points:
    walls = thinned(plan.walls - plan.centre, POINTS[0])
    rooms = thinned(np.column_stack((plan.rooms - plan.centre, plan.clear)), POINTS[1])
    length = len(plan.walls) * plan.unit / max(1, len(walls))
    area = len(plan.rooms) * plan.unit**2 / max(1, len(rooms))
    return _Points(walls, np.ascontiguousarray(rooms[:, :2]), rooms[:, 2], length, area)


def _stretched(points: _Points, scale: float, unit_m: float, clear_m: float) -> Sample:
    """The points at a scale, without rooms nearer to walls than that; weights in the robot's canonical cells."""
    weights = points.length * scale / unit_m, points.area * scale**2 / unit_m**2
    return Sample(points.walls * scale, points.rooms[points.clear * scale > clear_m] * scale, weights)


def _at_scale(
    coarse: Level, sample: Sample, plan: PlanGrid, scale: float, yaws: Sequence[float], count: int, gate: Gate | None
) -> Poses:
    """The best ``count`` local maxima at one scale of each of some rotations, and of half a turn more."""
    unit_m = coarse.unit_m
    reach = math.ceil(plan.radius * scale / unit_m) + 1
    height, width = (scipy.fft.next_fast_len(max(n + reach, 2 * reach + 1), real=True) for n in coarse.on_wall.shape)
    shape = (height, width)
    still = spectra(coarse, shape)
    within = None if gate is None else shifts_within(gate, coarse, reach, shape)
    out = []
    for yaw in yaws:
        turned = [yaw + half * math.pi for half in range(2)]
        admitted = [gate is None or gate.admits_yaw(value, TURN_RAD) for value in turned]
        if not any(admitted):
            continue
        scores = scored(still, sample, yaw, unit_m)
        if within is not None:
            scores *= within[..., None]  # what scores nothing is no peak, and hides none
        for half in range(2):
            if admitted[half]:
                places, values = peaks(scores, half, count, 0.0)
                rows = np.column_stack((places, np.full(len(places), turned[half]), values)).astype(np.float64)
                out.append(np.insert(unwrapped(rows, coarse, reach, shape, gate), 3, scale, axis=1))
    return np.concatenate(out) if out else np.empty((0, 5))


def _scored(fine: Level, points: _Points, unit_m: float, poses: Poses) -> Poses:
    """The poses with what they score on fine cells."""
    out = poses.copy()
    for number, pose in enumerate(poses):
        sample = _stretched(points, float(pose[3]), unit_m, CLEAR_CELLS * fine.unit_m)
        start = pose[None, :3].copy()
        start[:, :2] = (start[:, :2] - fine.origin_m) / fine.unit_m
        walls, rooms = sample.walls / fine.unit_m, sample.free / fine.unit_m
        out[number, 4] = climb(fine.on_wall, fine.on_free, walls, rooms, sample.weights, start, 0.0, 0)[0, 3]
    return out


def _best_of_bands(poses: Poses) -> Poses:
    """The best overall, and the best of each band of scales, in the order in which they come."""
    band = np.floor(np.log(poses[:, 3]) / BAND).astype(np.int64)
    rank = np.empty(len(poses), np.int64)  # within its band
    for one in np.unique(band):
        rank[band == one] = np.arange(np.count_nonzero(band == one))
    return poses[(rank < PER_BAND) | (np.arange(len(poses)) < KEPT_FINE)]


def _best(poses: Poses, count: int, apart_m: float, apart_log: float) -> Poses:
    """The best poses, of those in one small cell of x, y, yaw and scale only the best."""
    poses = poses[np.argsort(-poses[:, 4], kind="stable")]
    keys = np.column_stack((poses[:, :2] / apart_m, poses[:, 2] / 0.05, np.log(poses[:, 3]) / apart_log))
    cells = np.round(keys).astype(np.int64)
    return poses[np.sort(np.unique(cells, axis=0, return_index=True)[1])][:count]
