"""Landmark evidence in another frame, in integers and exact rounding only, so that it comes out the same everywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Transform
from mapgraft_landmarks.cells import (
    COLUMNS,
    LOOKS,
    POSITION_STEP_M,
    SIGHTINGS,
    SUM_X,
    SUM_Y,
    Cells,
    keys_at,
    pack,
    unpack,
)

RESAMPLER = "mean_sighting_nearest_look_1"
_TURN_BITS = 24  # fixed point of a rotation entry
_PLANAR_TOLERANCE = 1e-6
_SUM_LIMIT = 2**62  # every intermediate sum stays below

Steps = NDArray[np.int64]  # (n, 2) in POSITION_STEP_M


@dataclass(frozen=True, slots=True)
class _Similarity:
    """A scaled rotation in fixed point and a shift in position steps."""

    turn: NDArray[np.int64]  # (2, 2) over 2**_TURN_BITS, scale included
    shift: NDArray[np.int64]  # (2,)

    def turned(self, steps: Steps) -> Steps:
        """The steps turned and scaled, not shifted, rounded half up; raises MapError where int64 would overflow."""
        if steps.size and int(np.abs(steps).max()) * int(np.abs(self.turn).max()) >= _SUM_LIMIT // 2:
            raise MapError("a landmark map is too large, or too often sighted, to be placed: check poses and scale")
        return (steps @ self.turn.T + (1 << (_TURN_BITS - 1))) >> _TURN_BITS


def place_cells(
    cells: Cells, cell_m: float, T_receiver_donor: Transform, scale: float, receiver_cell_m: float
) -> Cells:
    """The evidence in the receiver's frame and cells; ``T_receiver_donor`` in fixed point (``Transform.snapped``).

    Each cell's sightings go, all together, to where their mean position comes to lie. Each of the receiver's cells gets
    the looks of the donor's cell at its own centre, so that turning leaves no holes. Raises MapError when the transform
    tilts the plane, the scale is no positive number, or the numbers would not fit.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise MapError(f"the scale of a landmark map must be positive, found {scale}")
    matrix = T_receiver_donor.matrix
    if abs(matrix[2, 2] - 1.0) > _PLANAR_TOLERANCE:
        raise MapError(f"a landmark map lies in a plane and cannot be tilted, found a tilting {T_receiver_donor!r}")
    shift = _whole(matrix[:2, 3] / POSITION_STEP_M)
    forward = _Similarity(_whole(matrix[:2, :2] * scale * 2**_TURN_BITS), shift)
    back = _Similarity(_whole(matrix[:2, :2].T / scale * 2**_TURN_BITS), shift)
    sighted = cells.counts[cells.counts[:, SIGHTINGS] > 0]
    looked = _candidates(cells, cell_m, forward, receiver_cell_m, scale)
    return _gathered_looks(cells, cell_m, back, receiver_cell_m, looked).plus(
        _moved_sightings(sighted, forward, receiver_cell_m)
    )


def _moved_sightings(counts: NDArray[np.int64], forward: _Similarity, receiver_cell_m: float) -> Cells:
    sightings = counts[:, SIGHTINGS]
    sums = forward.turned(counts[:, [SUM_X, SUM_Y]]) + sightings[:, None] * forward.shift
    keys = keys_at(sums * POSITION_STEP_M / sightings[:, None], receiver_cell_m)
    moved = np.zeros((len(counts), COLUMNS), np.int64)
    moved[:, SIGHTINGS] = sightings
    moved[:, [SUM_X, SUM_Y]] = sums
    return Cells.summed(keys, moved)


def _candidates(
    cells: Cells, cell_m: float, forward: _Similarity, receiver_cell_m: float, scale: float
) -> NDArray[np.int64]:
    """Keys of all receiver's cells whose centre can lie in one of the donor's cells."""
    centres = forward.turned(_centres(cells.keys, cell_m)) + forward.shift
    ix, iy = unpack(keys_at(centres * POSITION_STEP_M, receiver_cell_m))
    reach = math.floor(0.5 + math.sqrt(0.5) * cell_m * scale / receiver_cell_m + 0.01)  # half a diagonal, and rounding
    steps = np.arange(-reach, reach + 1)
    near = pack(ix[:, None, None] + steps[:, None], iy[:, None, None] + steps)
    return np.unique(near)


def _gathered_looks(
    cells: Cells, cell_m: float, back: _Similarity, receiver_cell_m: float, keys: NDArray[np.int64]
) -> Cells:
    sources = back.turned(_centres(keys, receiver_cell_m) - back.shift) * POSITION_STEP_M
    counts = np.zeros((len(keys), COLUMNS), np.int64)
    counts[:, LOOKS] = cells.at(keys_at(sources, cell_m))[:, LOOKS]
    seen = counts[:, LOOKS] > 0
    return Cells(keys[seen], counts[seen])


def _centres(keys: NDArray[np.int64], cell_m: float) -> Steps:
    index = np.stack(unpack(keys), axis=1)
    return _whole((index + 0.5) * (cell_m / POSITION_STEP_M))


def _whole(values: NDArray[np.floating]) -> NDArray[np.int64]:
    return np.round(values).astype(np.int64)
