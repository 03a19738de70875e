"""What one cell of a robot's map tells about a plan placed upon it: log likelihood ratios, measured."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft_floorplan.outline import beyond
from mapgraft_grid.bayes import meeting_table
from mapgraft_grid.prepared import Prepared

# How much more often a pair of marks meets at the right place than at wrong ones (natural log), on cells of 0.1 m: 30
# simulated buildings and plans of them with wrong walls (recordings, buildings/plans.py). What the command
# tests/bench/fit_floorplan.py --table 100 30 counts, rounded, the greatest costs a little less: within 0.2 of it.
# Rows: what the robot knows (unknown, free, wall, free beside a wall, unknown beside a wall); columns the same of the
# plan, where a room is free. What the plan leaves open tells nothing. Furniture and door leaves are among what was
# counted: a wall where the plan has a room costs 1.1, a plan's wall in free space 2.7.
FACTORS: Final = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.25, -2.7, -1.1, -2.8],
        [0.0, -1.1, 1.2, 0.6, 0.4],
        [0.0, -0.55, 0.3, 1.4, -0.75],
        [0.0, -0.8, 0.85, 0.7, 0.7],
    ]
)
FACTORS.setflags(write=False)
# What a robot has mapped beyond everything that is drawn costs what the same free space in a room tells: cells outside
# stand and fall together, when a plan shows a part of a building, so that single ones weigh little. On 72 simulated
# buildings (tests/bench/fit_floorplan.py) whole plans are placed equally well with 0 to 0.25.
OUTSIDE: Final = 0.25
LEAST_NATS: Final = 20.0  # of a score that a lead is a share of


class Agreement(NamedTuple):
    """How a placed plan and a robot's map meet, in cells of the robot's."""

    log_ratio: float
    agreeing: int  # walls on walls or beside one, free cells in rooms
    missing: int  # walls of the plan in free space
    added: int  # walls of the robot in rooms
    common: int  # walls of the plan on a wall of the robot or beside one
    outside: int  # free cells and walls of the robot beyond everything that is drawn
    table: NDArray[np.int64]  # (5, 5) of all the robot's marked cells, by its mark and the plan's


def share_of(ahead: float, score: float) -> float:
    """How far a score lies ahead of another, as a share of it, in [-1, 1]."""
    return max(-1.0, min(1.0, ahead / max(abs(score), LEAST_NATS)))


def agreement(robot: Prepared, plan: Prepared, T: Transform, *, any_scale: bool = False) -> Agreement:
    """All counts of a placement, in cells of the robot's grid whatever the size of the plan's.

    With ``any_scale`` free space in rooms tells no more than walls on walls do: all of a robot's map fits into one
    room, if only the plan is drawn large enough.
    """
    table = meeting_table(plan, robot, T.inverse()).T.copy()
    table[:, 0] += np.append(0, robot.mark_counts[1:]) - np.append(0, table[1:].sum(axis=1))  # beside the plan's grid
    rows = table.tolist()
    common = rows[2][2] + rows[3][2] + rows[4][2]
    free = rows[1][1] + rows[1][3] + rows[3][1] + rows[3][3]
    beside = rows[2][3] + rows[2][4]
    told = table * FACTORS
    rooms = float(told[1, 1])
    for_it = float(told[told > 0.0].sum()) - rooms
    outside = int(beyond(robot, plan, T)[1:4].sum())
    log_ratio = float(told.sum()) - (max(0.0, rooms - for_it) if any_scale else 0.0) - OUTSIDE * outside
    return Agreement(log_ratio, free + common + beside, rows[1][2], rows[2][1], common, outside, table)
