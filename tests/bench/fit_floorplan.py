"""Fit the probability that a plan lies where a match puts it, on simulated buildings, and judge it on others.

    python tests/bench/fit_floorplan.py [--fit 1000 72] [--judge 3000 71] [--processes 1] [--rows ROWS.npz]
    python tests/bench/fit_floorplan.py --table 100 30

Of each building a robot has mapped a part. Its plan, with wrong walls, is given with its scale and without, whole and,
of every fourth building, with a part cut off. Prints the coefficients of the greatest likelihood on the first
buildings; how many right and wrong hypotheses would be taken from each limit on, of the first buildings by coefficients
fitted to the others (eight folds, whole buildings), of the buildings to judge by with the coefficients just fitted and
with those that ``mapgraft_floorplan/metrics.py`` holds; and how many first hypotheses are right, also with other costs
of what lies beyond all that is drawn. Rows that were written are read again. The second form counts the table of log
likelihood ratios of ``mapgraft_floorplan/evidence_table.py`` anew.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapgraftError, Match, Transform
from mapgraft_floorplan.evidence_table import FACTORS, OUTSIDE, agreement
from mapgraft_floorplan.grid_conversion import PlanToGrid
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.matcher import PlanCorrelation
from mapgraft_floorplan.metrics import COEFFICIENTS, INTERCEPT, LEAD, features
from mapgraft_floorplan.plan import plan_of as as_plan
from mapgraft_grid.bayes import meeting_table
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.prepared import prepare
from mapgraft_recordings.buildings import building, drive
from mapgraft_recordings.buildings.plans import plan_of

RIGHT_M, RIGHT_RAD = 0.5, math.radians(5.0)
SCANS = (40, 80, 160, 320)
LIMITS = (0.5, 0.7, 0.8, 0.9, 0.95)
COSTS = (0.0, 0.1, 0.25, 0.4, 1.0)
RIDGE = 3e-5
FOLDS = 8
TABLE_SCANS, WRONG_PLACES = 80, 6


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
    cut: bool = False

    @property
    def name(self) -> str:
        return f"{'any' if self.free else 'known'} scale, {'cut' if self.cut else 'whole'}"

    def error(self, match: Match) -> tuple[float, float]:
        """Mean displacement of the robot's walls (m), and of the rotation (rad)."""
        walls = prepare(self.robot, 0.1).walls[::5]
        there = np.linalg.solve(self.turn, (walls - self.shift).T).T
        T = match.T_receiver_donor
        yaw = math.atan2(self.turn[1, 0], self.turn[0, 0])
        off = np.hypot(*(T.apply(there * match.scale) - walls).T).mean()
        return float(off), abs(math.remainder(T.yaw_rad - yaw, math.tau))


@dataclass
class Row:
    """A hypothesis, and what is known of it."""

    seed: int
    name: str
    right: bool
    log_ratio: float
    outside: int
    known: dict[str, float]


def cases_of(seed: int) -> Iterator[Case]:
    """A partly mapped building and plans of it, turned, shifted and, where nobody tells, of any scale."""
    rng, house = np.random.default_rng([5, seed]), building(seed)
    for free in (False, True):
        grid, scans = OccupancyGrid(), int(rng.choice(SCANS))
        layer = grid.new_layer()
        for observation in drive(house, seed + 1, scans):
            grid.integrate(layer, observation)
        drawn = plan_of(house, 0)
        yaw, scale = rng.uniform(-math.pi, math.pi), math.exp(rng.uniform(-1.0, 1.0)) if free else 1.0
        turn = scale * np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        moved = drawn.reshape(-1, 2) @ turn.T + rng.uniform(-20.0, 20.0, 2)
        plan = as_plan(moved.reshape(-1, 4), None if free else 1.0, "the plan").segments_m
        given, ends = drawn[(drawn[:, :2] != drawn[:, 2:]).any(axis=1)].reshape(-1, 2), plan.reshape(-1, 2)
        za, zb = (points[:, 0] + 1j * points[:, 1] for points in (given, ends))
        factor = np.vdot(zb - zb.mean(), za - za.mean()) / np.vdot(zb - zb.mean(), zb - zb.mean())
        shift = za.mean() - factor * zb.mean()
        back = np.array([[factor.real, -factor.imag], [factor.imag, factor.real]])
        as_grid = _as_grid(plan, free)
        known = np.array([shift.real, shift.imag])
        case = Case(seed, house.kind, scans, grid.view(layer), grid.view(as_grid), as_grid, back, known, free)
        yield case
        if seed % 4 == 0:
            as_grid = _as_grid(_cut(plan, np.random.default_rng([9, seed])), free)
            yield replace(case, plan=grid.view(as_grid), layer=as_grid, cut=True)


def _as_grid(walls: NDArray[np.float64], free: bool) -> GridLayer:
    return PlanToGrid().convert(
        PlanLayer(Walls.of_metres(walls), scale_known=not free), FloorPlanType(), OccupancyGrid()
    )


def _cut(walls: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """A plan of half to four fifths of what is drawn: the walls on one side of a line."""
    angle = rng.uniform(0.0, math.tau)
    along = walls.reshape(-1, 2, 2).mean(axis=1) @ np.array([math.cos(angle), math.sin(angle)])
    kept: NDArray[np.float64] = walls[along <= np.quantile(along, rng.uniform(0.5, 0.8))]
    return kept


def rows_of(case: Case, found: Sequence[Match]) -> list[Row]:
    """What is known of the best two."""
    grid, robot = OccupancyGrid(), prepare(case.robot, 0.1)
    rows = []
    for match in found[:2]:
        placed = grid.view(grid.place(case.layer, match.T_receiver_donor, match.scale))
        met = agreement(robot, prepare(placed, 0.1), Transform.identity())
        off_m, off_rad = case.error(match)
        right = off_m <= RIGHT_M and off_rad <= RIGHT_RAD
        rows.append(Row(case.seed, case.name, right, match.score, met.outside, dict(features(met, match))))
    return rows


def tried(seed: int) -> tuple[list[Row], list[float], list[str]]:
    """All hypotheses of a building, how long each search took (s of a processor), and a line to tell of each."""
    rows: list[Row] = []
    took_s, lines = [], []
    for case in cases_of(seed):
        began = time.process_time()
        try:
            found = PlanCorrelation(scale="unknown" if case.free else "known").match(case.robot, case.plan)
        except MapgraftError as error:
            lines.append(f"{seed} {error}")
            continue
        took_s.append(time.process_time() - began)
        rows += (made := rows_of(case, found))
        said = "right" if made and made[0].right else "wrong"
        lines.append(f"{seed} {case.kind:10} {case.scans:3} scans, {case.name:18} {said}")
    return rows, took_s, lines


def measured(seeds: Sequence[int], processes: int) -> list[Row]:
    """The rows of all buildings, told as they come, in the order of their seeds however many work."""
    rows, took_s = [], []
    with ProcessPoolExecutor(processes) as pool:
        for made, spent_s, lines in pool.map(tried, seeds):
            rows += made
            took_s += spent_s
            print("\n".join(lines), flush=True)
    print(f"matching took {np.median(took_s):.2f} s of a processor in the median, {max(took_s):.2f} s at most")
    return rows


def fit(x: NDArray[np.float64], lead: NDArray[np.float64], right: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Coefficients, intercept and that of the lead, of the greatest likelihood, with a little ridge."""
    from scipy.optimize import minimize

    def cost(w: NDArray[np.float64]) -> float:
        p = np.clip(probability(w, x, lead), 1e-9, 1.0 - 1e-9)
        return float(-np.mean(np.log(np.where(right, p, 1.0 - p))) + 0.5 * RIDGE * (w[:-2] @ w[:-2] + w[-1] ** 2))

    found: NDArray[np.float64] = minimize(cost, np.append(np.zeros(x.shape[1] + 1), 5.0), method="BFGS").x
    return found


def probability(w: NDArray[np.float64], x: NDArray[np.float64], lead: NDArray[np.float64]) -> NDArray[np.float64]:
    """As the metric has it."""
    fits, first = w[-2] + x @ w[:-2], w[-1] * lead
    p: NDArray[np.float64] = 1.0 / (1.0 + np.exp(-np.clip(fits, -30, 30))) / (1.0 + np.exp(-np.clip(first, -30, 30)))
    return p


def told(rows: list[Row]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """The features that the metric uses, the leads, and which hypotheses are right."""
    x = np.array([[row.known[name] for name in COEFFICIENTS] for row in rows])
    return x, np.array([row.known["lead"] for row in rows]), np.array([row.right for row in rows])


def cross_validated(rows: list[Row]) -> NDArray[np.float64]:
    """The probability of each hypothesis by coefficients fitted to seven eighths of the buildings, without its own."""
    x, lead, right = told(rows)
    fold = np.array([row.seed for row in rows]) % FOLDS
    p = np.empty(len(rows))
    for out in (fold == k for k in range(FOLDS)):
        if out.any():
            p[out] = probability(fit(x[~out], lead[~out], right[~out]), x[out], lead[out])
    return p


def judged(what: str, rows: list[Row], p: NDArray[np.float64]) -> None:
    """Print what is taken from each limit on."""
    right = told(rows)[2]
    print(f"{what}: {right.sum()} right hypotheses, {(~right).sum()} wrong")
    for limit in LIMITS:
        taken = p >= limit
        print(f"  from {limit} on {taken[right].sum()} right ({100 * taken[right].mean():.0f} %)", end=" ")
        print(f"and {(taken & ~right).sum()} wrong")


def counted(rows: list[Row]) -> None:
    """Print for how many the first hypothesis is right, also of the best two were the cost another."""
    asked: dict[tuple[str, int], list[Row]] = {}
    for row in rows:
        asked.setdefault((row.name, row.seed), []).append(row)
    for name in sorted({name for name, _ in asked}):
        pairs = [pair for (one, _), pair in asked.items() if one == name]
        print(f"{name}: first hypothesis right for {sum(pair[0].right for pair in pairs)} of {len(pairs)}", end="")
        for cost in COSTS:
            best = [max(pair, key=lambda row: row.log_ratio + (OUTSIDE - cost) * row.outside) for pair in pairs]
            print(f", {sum(row.right for row in best)} at {cost:g}", end="")
        print()


def table(seeds: Sequence[int]) -> NDArray[np.float64]:
    """How much more often marks (4 of the robot, 4 of the plan, none unknown) meet at the right place (natural log).

    More often than at wrong ones, that is, which lay some wall of the plan on some wall of the robot, turned by any
    angle. All buildings weigh the same.
    """
    grid, rng = OccupancyGrid(), np.random.default_rng(0)
    right, wrong = np.zeros((5, 5)), np.zeros((5, 5))
    for seed in seeds:
        house, layer = building(seed), grid.new_layer()
        for observation in drive(house, seed + 1, TABLE_SCANS):
            grid.integrate(layer, observation)
        plan = PlanLayer(Walls.of_metres(plan_of(house, 0)))
        robot = prepare(grid.view(layer), 0.1)
        drawn = prepare(grid.view(PlanToGrid().convert(plan, FloorPlanType(), grid)), 0.1)
        met = meeting_table(robot, drawn, Transform.identity())
        right += met / met.sum()
        for _ in range(WRONG_PLACES):
            yaw = rng.uniform(-math.pi, math.pi)
            seen, other = robot.walls[rng.integers(len(robot.walls))], drawn.walls[rng.integers(len(drawn.walls))]
            shift = seen - Transform.planar(0.0, 0.0, yaw).apply(other[None])[0]
            met = meeting_table(robot, drawn, Transform.planar(float(shift[0]), float(shift[1]), yaw))
            wrong += met / max(1, met.sum())
    right, wrong = right[1:, 1:], wrong[1:, 1:]
    ratios: NDArray[np.float64] = np.log(right / right.sum()) - np.log(wrong / wrong.sum())
    return ratios


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--fit", type=int, nargs=2, default=(1000, 72), metavar=("FIRST", "COUNT"))
    asked.add_argument("--judge", type=int, nargs=2, default=(3000, 71), metavar=("FIRST", "COUNT"))
    asked.add_argument("--table", type=int, nargs=2, metavar=("FIRST", "COUNT"), help="only count the table")
    asked.add_argument("--processes", type=int, default=1, help="how many work at once")
    asked.add_argument("--rows", type=Path, help="write all hypotheses to this file, or read them from it")
    options = asked.parse_args()
    if options.table:
        counted_now = table(range(options.table[0], sum(options.table)))
        print(np.array2string(counted_now, precision=2, suppress_small=True))
        print(f"at most {np.abs(counted_now - FACTORS[1:, 1:]).max():.2f} from what is shipped")
        return
    sets = [range(first, first + count) for first, count in (options.fit, options.judge)]
    if options.rows and options.rows.exists():
        kept = [Row(**row) for row in np.load(options.rows, allow_pickle=True)["rows"].tolist()]
    else:
        kept = [row for seeds in sets for row in measured(seeds, options.processes)]
        if options.rows:
            np.savez(options.rows, rows=np.array([{**_fields(row)} for row in kept], object))
    ours, others = ([row for row in kept if row.seed in seeds] for seeds in sets)
    w, shipped = fit(*told(ours)), np.array([*COEFFICIENTS.values(), INTERCEPT, LEAD])
    for what, model in (("fitted", w), ("shipped", shipped)):
        named = {name: round(float(value), 3) for name, value in zip(COEFFICIENTS, model, strict=False)}
        print(f"{what}: {named}, intercept {model[-2]:.3f}, lead {model[-1]:.3f}")
    for what, rows in (("fitted on", ours), ("judged by", others)):
        print(f"{what} {len({row.seed for row in rows})} buildings")
        counted(rows)
    judged(f"fitted on, {FOLDS} folds", ours, cross_validated(ours))
    for what, model in (("fitted", w), ("shipped", shipped)):
        x, lead, _ = told(others)
        judged(f"judged by, as {what}", others, probability(model, x, lead))


def _fields(row: Row) -> dict[str, object]:
    return {name: getattr(row, name) for name in Row.__dataclass_fields__}


if __name__ == "__main__":
    main()
