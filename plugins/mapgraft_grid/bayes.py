"""The log Bayes factor of a placement: do two grids see the same cells, or unrelated ones?"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Transform
from mapgraft_grid.kernels.meeting import meeting
from mapgraft_grid.prepared import Prepared

P_FREE: Final = 0.0005
P_OCCUPIED: Final = 0.995
P_BESIDE: Final = 0.3  # free and touching an occupied cell: walls are blurred by a cell
P_BEHIND: Final = 0.86  # unknown and touching one: nobody looks through a wall
LEAST_PRIOR: Final = 0.02
MOST_PRIOR: Final = 0.5

_OF_MARKS: Final = np.array([P_FREE, P_OCCUPIED, P_BESIDE, P_BEHIND])

Factors = NDArray[np.float64]  # (5, 5) log BF in nats, rows the target's mark, columns the source's


def occupancy_prior(target: Prepared, source: Prepared) -> float:
    """The mean occupancy of what the two grids know, walls and what touches them included: what two unrelated cells of
    such maps have in common by chance."""
    counts = (target.mark_counts + source.mark_counts)[1:]
    mean = float(counts @ _OF_MARKS) / float(counts.sum())
    return min(max(mean, LEAST_PRIOR), MOST_PRIOR)


def log_bayes_factors(prior: float) -> Factors:
    """What one cell tells when mark i of the target meets mark j of the source, in nats.

    BF = p₁p₂/π + (1 − p₁)(1 − p₂)/(1 − π), with the marks of ``prepared`` read as occupancies; unknown ones say π, so
    that they tell nothing.
    """
    p = np.concatenate(([prior], _OF_MARKS))
    out: Factors = np.log(np.outer(p, p) / prior + np.outer(1.0 - p, 1.0 - p) / (1.0 - prior))
    out[0] = out[:, 0] = 0.0
    return out


class Meeting(NamedTuple):
    """How two grids meet under a placement, in cells of their common resolution."""

    log_bayes_factor: float
    agreement: int
    disagreement: int
    occupied_agreement: int  # occupied on occupied
    near_agreement: int  # occupied on occupied or on a cell that touches one

    @property
    def overlap(self) -> int:
        return self.agreement + self.disagreement


def log_bayes_factor(target: Prepared, source: Prepared, T_target_source: Transform) -> float:
    """L = Σ log BF over the cells of the source, in nats: positive where both grids see the same, negative else.

    H₁: both grids observe the same cells. H₀: they observe unrelated cells of worlds with as much wall as these two
    have (``occupancy_prior``). Both grids must have been prepared at one resolution.
    """
    return meet(target, source, T_target_source).log_bayes_factor


def meet(target: Prepared, source: Prepared, T_target_source: Transform, factors: Factors | None = None) -> Meeting:
    """All counts of a placement, and its log Bayes factor; ``factors`` are the pair's, where they are at hand."""
    table = meeting_table(target, source, T_target_source)
    rows = table.tolist()
    free = rows[1][1] + rows[1][3] + rows[3][1] + rows[3][3]
    against = rows[2][1] + rows[2][3] + rows[1][2] + rows[3][2]
    near = rows[2][2] + rows[3][2] + rows[4][2]
    if factors is None:
        factors = log_bayes_factors(occupancy_prior(target, source))
    total = math.fsum((table * factors).ravel().tolist())
    return Meeting(total, free + rows[2][2], against, rows[2][2], near)


def meeting_table(target: Prepared, source: Prepared, T: Transform) -> NDArray[np.int64]:
    """The (5, 5) counts of (target mark, source mark) under ``T_target_source``; both at one resolution."""
    ratio = source.unit_m / target.unit_m
    cosine, sine = ratio * math.cos(T.yaw_rad), ratio * math.sin(T.yaw_rad)
    shift = (T.apply(source.origin_m[None])[0] - target.origin_m) / target.unit_m
    cells, marks = source.marked_cells
    out: NDArray[np.int64] = meeting(target.marks, cells, marks, cosine, sine, shift[0], shift[1])
    return out
