"""How what a contribution says enters a map of line segments: so many times, or as a prior."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Final

import numpy as np

from mapgraft.contracts import Contribution, MapError
from mapgraft_lines.kernels import joining
from mapgraft_lines.kernels.chopping import UNIT, UNIT_M
from mapgraft_lines.layer import LOOKS, NAME, Evidence, LineLayer, W, as_layer
from mapgraft_lines.placing import reweighed
from mapgraft_lines.segments import COARSEST_SIGMA_M, FINEST_SIGMA_M
from mapgraft_lines.table import Table
from mapgraft_lines.walls import half_lengths_m, piece_rows

MOST: Final = 3  # applications of one donor
PRIOR: Final = "prior"


@dataclass(frozen=True, slots=True)
class Bounds:
    """How far a prior may speak in any cell: as one look, ``sigma_m`` unsure across the wall.

    What no robot has observed (a plan, say) enters so, however often its walls are drawn and in however many parts: a
    few looks through it override it. Raises MapError unless it is a standard deviation that segments can have.
    """

    sigma_m: float = 0.1

    def __post_init__(self) -> None:
        if not FINEST_SIGMA_M <= self.sigma_m <= COARSEST_SIGMA_M:
            raise MapError(
                f"a prior of {NAME} is {FINEST_SIGMA_M:g} … {COARSEST_SIGMA_M:g} m unsure, found {self.sigma_m} m"
            )


def as_prior(contribution: Contribution, bounds: Bounds | None = None) -> Contribution:
    """The contribution with the role ``prior``: of its evidence no more enters the fused map than the bounds allow."""
    summary = {"prior": 1.0, **contribution.summary}
    return dataclasses.replace(contribution, weights=bounds or Bounds(), role=PRIOR, summary=summary)


def entering(contribution: Contribution) -> Evidence:
    """What a contribution adds to the fused map, all weighed.

    Raises MapError when it is of another type, when it is weighted by anything but a whole number from 1 to 3 or, as a
    prior, by ``Bounds``.
    """
    layer, weights = as_layer(contribution.layer), contribution.weights
    if contribution.role == PRIOR:
        if not isinstance(weights, Bounds):
            raise MapError(f"a prior in {NAME} is weighted by its Bounds, found {weights!r}: make it with as_prior")
        return bounded(layer, weights)
    if isinstance(weights, bool) or not isinstance(weights, int) or not 1 <= weights <= MOST:
        raise MapError(f"a contribution to {NAME} is weighted by a whole number from 1 to {MOST}, found {weights!r}")
    return layer.all() if weights == 1 else Evidence().plus(layer.all(), weights)


def bounded(layer: LineLayer, bounds: Bounds) -> Evidence:
    """A layer's evidence, all of it as one look.

    Pieces of one cell that run alike are one; its information is at most that of one straight line through them.
    """
    evidence = layer.all()
    space = Table(evidence.space.keys, np.minimum(evidence.space.counts, 1))
    pieces = evidence.pieces
    joined = Table.summed(pieces.keys[joining.heads(pieces.keys, pieces.counts[:, W])], pieces.counts)
    rows = piece_rows(joined, layer.cell_m)
    most = UNIT * (UNIT_M / bounds.sigma_m) ** 2 * 2.0 * half_lengths_m(rows) / layer.cell_m
    counts = reweighed(joined.counts, np.minimum(most / joined.counts[:, W], 1.0))
    counts[:, LOOKS] = 1
    return Evidence(Table(joined.keys, counts), space)
