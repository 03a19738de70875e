"""Walls of raster plans as straight pieces: the outlines of the dark areas."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import GridMessage, Transform
from mapgraft_floorplan.plan import Plan, Segments, plan_of

_OCCUPIED: Final = 65  # percent: what map_server calls occupied
_STRAIGHT_PX: Final = 0.75  # how far an outline may lie off the pixels' corners


def has_walls(message: GridMessage) -> bool:
    """Whether any cell of a ready-made grid is occupied."""
    return bool((message.cells >= _OCCUPIED).any())


def plan_of_grid(message: GridMessage, what: str, *, scale_known: bool = True) -> Plan:
    """The occupied cells of a ready-made grid as a plan; raises MapError, naming ``what``, when there are none.

    Where the scale is not known, ``message.resolution_m`` means nothing.
    """
    height, width = message.cells.shape
    traced = outlines(message.cells >= _OCCUPIED)
    if scale_known:
        plan = plan_of(traced, message.resolution_m, what)
        ends = message.T_map_origin.apply(plan.segments_m.reshape(-1, 2)).reshape(-1, 4)
        return Plan(ends, True, (height, width), message.resolution_m, message.T_map_origin)
    plan = plan_of(traced, None, what)
    low, high = traced.reshape(-1, 2).min(axis=0), traced.reshape(-1, 2).max(axis=0)
    side_m = float((plan.segments_m.reshape(-1, 2).max(axis=0)).max() / (high - low).max())
    origin = Transform.planar(float(-low[0] * side_m), float(-low[1] * side_m), 0.0)
    return Plan(plan.segments_m, False, (height, width), side_m, origin)


def outlines(walls: NDArray[np.bool_]) -> Segments:
    """The outlines of the True cells (h, w) as pieces (n, 4), in cells from the corner of cell (0, 0).

    A wall drawn as a line a pixel or two wide becomes two lines that close together: what reads them sees one wall.
    """
    import cv2

    height, width = walls.shape
    # twice as large, so that the outline of the pixels' areas, not of their centres, is followed
    big = np.zeros((2 * height + 2, 2 * width + 2), np.uint8)
    big[1:-1, 1:-1] = np.repeat(np.repeat(walls.astype(np.uint8), 2, axis=0), 2, axis=1)
    found, _ = cv2.findContours(big, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    pieces = []
    for contour in found:
        outline = cv2.approxPolyDP(contour, 2.0 * _STRAIGHT_PX, True).reshape(-1, 2).astype(np.float64)
        corners = (outline - 0.5) / 2.0  # centres of half-pixels, counted from the border of one
        pieces.append(np.hstack((corners, np.roll(corners, -1, axis=0))))
    return np.vstack(pieces) if pieces else np.empty((0, 4))
