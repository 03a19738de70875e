"""Placing walls in another frame, by exact arithmetic."""

from __future__ import annotations

from typing import Final

import numpy as np

from mapgraft.contracts import ROTATION_STEP, EmptyMapError, MapError, Transform
from mapgraft_floorplan.layer import FARTHEST, STEP_M, PlanLayer, Walls

RESAMPLER: Final = "ends/1"  # both ends of a piece are moved and rounded
_SCALE_STEP: Final = 2.0**-24
_MOST_SCALE: Final = 128.0


def place(layer: PlanLayer, T_receiver_donor: Transform, scale: float) -> PlanLayer:
    """The walls stretched by ``scale`` about their origin and then moved; their ends are rounded once each.

    Raises EmptyMapError when there are none, MapError when they leave the plane of fixed point.
    """
    told = layer.told
    if not len(told.rows):
        raise EmptyMapError("the donor's floor plan is empty: there is nothing to place")
    if not 1.0 / _MOST_SCALE <= scale <= _MOST_SCALE:
        raise MapError(f"a floor plan is placed with a scale from 1/{_MOST_SCALE:g} to {_MOST_SCALE:g}, found {scale}")
    ends = told.rows.astype(np.int64)
    if scale != 1.0:
        stretched = ends * round(scale / _SCALE_STEP)
        ends = (stretched + (1 << 23)) >> 24
        if np.abs(ends).max() > FARTHEST:
            raise MapError(f"a floor plan stretched by {scale:g} reaches beyond ±{FARTHEST * STEP_M:.0f} m")
    T = T_receiver_donor.snapped().matrix
    rotation = np.round(T[:2, :2] / ROTATION_STEP).astype(np.int64)
    shift = [round(float(T[k, 3]) / STEP_M * 2**24) for k in (0, 1)]
    out = np.empty_like(ends)
    for k in (0, 1):
        for end in (0, 2):
            moved = rotation[k, 0] * ends[:, end] + rotation[k, 1] * ends[:, end + 1] + shift[k]
            out[:, end + k] = (moved + (1 << 23)) >> 24
    known = layer.scale_known or scale != 1.0
    return PlanLayer(Walls.of_steps(out), None, known, layer.observations, layer.sensors)
