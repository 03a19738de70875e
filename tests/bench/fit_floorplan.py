"""Fit the probability that a plan lies where a match puts it, on simulated buildings; and count what the matcher finds.

    python tests/bench/fit_floorplan.py [--first 1000] [--count 60] [--seconds 600]

Prints the coefficients that ``mapgraft_floorplan/metrics.py`` holds, and what the rule's limit takes of the right and
wrong hypotheses of buildings that were left out of the fit.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapgraftError, Match, Transform
from mapgraft_floorplan.evidence_table import agreement
from mapgraft_floorplan.grid_conversion import PlanToGrid
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.matcher import PlanCorrelation
from mapgraft_floorplan.metrics import COEFFICIENTS, features
from mapgraft_floorplan.plan import plan_of as as_plan
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.prepared import prepare
from mapgraft_recordings.buildings import building, drive
from mapgraft_recordings.buildings.plans import plan_of

RIGHT_M, RIGHT_RAD = 0.5, math.radians(5.0)
SCANS = (40, 80, 160, 320)
TAKEN_FROM = 0.8
FOLDS = 8
RIDGE = 3e-4


@dataclass
class Case:
    """A robot's map, a plan as a grid, and the similarity that brings the plan to the map."""

    seed: int
    kind: str
    scans: int
    robot: GridMap
    plan: GridMap
    layer: GridLayer
    turn: NDArray[np.float64]
    shift: NDArray[np.float64]
    free: bool

    def error(self, match: Match) -> tuple[float, float]:
        """Mean displacement of the robot's walls (m), and of the rotation (rad)."""
        walls = prepare(self.robot, 0.1).walls[::5]
        there = np.linalg.solve(self.turn, (walls - self.shift).T).T
        T = match.T_receiver_donor
        yaw = math.atan2(self.turn[1, 0], self.turn[0, 0])
        off = np.hypot(*(T.apply(there * match.scale) - walls).T).mean()
        return float(off), abs(math.remainder(T.yaw_rad - yaw, math.tau))


@dataclass
class Tally:
    rows: list[list[float]] = field(default_factory=list)
    right: list[bool] = field(default_factory=list)
    seeds: list[int] = field(default_factory=list)
    first: dict[bool, list[bool]] = field(default_factory=lambda: {True: [], False: []})
    took_s: list[float] = field(default_factory=list)
    names: tuple[str, ...] = ()


def case_of(seed: int, free: bool, rng: np.random.Generator) -> Case:
    """A partly mapped building and a plan of it, turned, shifted and, with ``free``, of any scale."""
    house, scans = building(seed), int(rng.choice(SCANS))
    grid = OccupancyGrid()
    layer = grid.new_layer()
    for observation in drive(house, seed + 1, scans):
        grid.integrate(layer, observation)
    drawn = plan_of(house, 0)
    yaw, scale = rng.uniform(-math.pi, math.pi), math.exp(rng.uniform(-1.0, 1.0)) if free else 1.0
    turn = scale * np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    moved = drawn.reshape(-1, 2) @ turn.T + rng.uniform(-20.0, 20.0, 2)
    plan = as_plan(moved.reshape(-1, 4), None if free else 1.0, "the plan")
    given, ends = drawn[(drawn[:, :2] != drawn[:, 2:]).any(axis=1)].reshape(-1, 2), plan.segments_m.reshape(-1, 2)
    za, zb = (points[:, 0] + 1j * points[:, 1] for points in (given, ends))
    factor = np.vdot(zb - zb.mean(), za - za.mean()) / np.vdot(zb - zb.mean(), zb - zb.mean())
    shift = za.mean() - factor * zb.mean()
    back = np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])
    as_grid = PlanToGrid().convert(
        PlanLayer(Walls.of_metres(plan.segments_m), scale_known=plan.scale_known), FloorPlanType(), grid
    )
    return Case(
        seed,
        house.kind,
        scans,
        grid.view(layer),
        grid.view(as_grid),
        as_grid,
        back,
        np.array([shift.real, shift.imag]),
        free,
    )


def take(case: Case, tally: Tally) -> None:
    """Match, and take in what is known of the first hypotheses; ``features`` as the metric has them."""
    matcher = PlanCorrelation(scale="unknown" if case.free else "known")
    began = time.perf_counter()
    found = matcher.match(case.robot, case.plan)
    tally.took_s.append(time.perf_counter() - began)
    grid = OccupancyGrid()
    robot = prepare(case.robot, 0.1)
    for rank, match in enumerate(found[:2]):
        placed = grid.view(grid.place(case.layer, match.T_receiver_donor, match.scale))
        known = features(agreement(robot, prepare(placed, 0.1), Transform.identity()), match.margin, match.score)
        off_m, off_rad = case.error(match)
        ok = off_m <= RIGHT_M and off_rad <= RIGHT_RAD
        tally.names = tuple(known)
        tally.rows.append(list(known.values()))
        tally.right.append(ok)
        tally.seeds.append(case.seed)
        if rank == 0:
            tally.first[case.free].append(ok)
            print(f"{case.seed} {case.kind:10} {case.scans:3} scans {'any scale' if case.free else 'known':9}", end=" ")
            print(
                "right" if ok else "wrong",
                f"{off_m:.2f} m, score {match.score:.0f}, margin {match.margin:.0f}",
                flush=True,
            )
    if not found:
        tally.first[case.free].append(False)


def fit(rows: NDArray[np.float64], right: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Coefficients and intercept of a logistic regression by Newton's method, with a little ridge."""
    x = np.column_stack((rows, np.ones(len(rows))))
    w = np.zeros(x.shape[1])
    for _ in range(60):
        p = 1.0 / (1.0 + np.exp(-np.clip(x @ w, -30, 30)))
        gradient = x.T @ (p - right) + RIDGE * len(rows) * np.append(w[:-1], 0.0)
        hessian = (x.T * (p * (1 - p))) @ x + RIDGE * len(rows) * np.diag(np.append(np.ones(len(w) - 1), 1e-6))
        w = w - np.linalg.solve(hessian, gradient)
    return w


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--first", type=int, default=1000)
    asked.add_argument("--count", type=int, default=60)
    asked.add_argument("--seconds", type=float, default=math.inf, help="stop after about so long")
    asked.add_argument("--rows", help="write seed, right and the features of every hypothesis to this file")
    options = asked.parse_args()
    tally, rng = Tally(), np.random.default_rng(5)
    ends = time.monotonic() + options.seconds
    for seed in range(options.first, options.first + options.count):
        if time.monotonic() > ends:
            break
        for free in (False, True):
            try:
                case = case_of(seed, free, rng)
                take(case, tally)
            except MapgraftError as error:
                print(seed, error)
    if options.rows:
        np.savetxt(options.rows, np.column_stack((tally.seeds, tally.right, tally.rows)), header=" ".join(tally.names))
    columns = [tally.names.index(name) for name in COEFFICIENTS]
    rows, right = np.array(tally.rows)[:, columns], np.array(tally.right)
    w = fit(rows, right)
    told = {name: round(float(value), 3) for name, value in zip(COEFFICIENTS, w, strict=False)}
    print(told, "intercept", round(float(w[-1]), 3))
    fold, p = np.array(tally.seeds) % FOLDS, np.empty(len(rows))
    for k in range(FOLDS):
        out = fold == k
        if out.any():
            x = np.column_stack((rows[out], np.ones(out.sum())))
            p[out] = 1.0 / (1.0 + np.exp(-(x @ fit(rows[~out], right[~out]))))
    taken = p >= TAKEN_FROM
    print(f"cross-validated: {right.sum()} right of which {100 * taken[right].mean():.0f} % taken,", end=" ")
    print(f"{(~right).sum()} wrong of which {taken[~right].sum()} taken")
    for free, ok in tally.first.items():
        print(f"{'any scale' if free else 'known scale'}: first hypothesis right for {sum(ok)} of {len(ok)}")
    print(f"matching took {np.median(tally.took_s):.2f} s in the median, {max(tally.took_s):.2f} s at most")


if __name__ == "__main__":
    main()
