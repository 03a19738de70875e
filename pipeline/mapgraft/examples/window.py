"""Two maps on each other under a hypothesis: where they overlap, and what both say there, cell by cell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from mapgraft.contracts import Transform
from mapgraft.outputs.report.rasters import OCCUPIED, UNKNOWN, Canvas, Cells, Raster

LARGEST_PX: Final = 128  # of the window's longer side
_LOOKED_PX: Final = 256  # so finely both maps are laid on each other to see where they overlap
_MARGIN: Final = 0.15  # of the overlap's longer side: so much of its surroundings is in the window
_LEAST_M: Final = 2.0  # of the surroundings


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Both maps around their overlap, in the receiver's frame, and ``overlap``, the share of the smaller one in both.

    ``own`` and ``donor`` are (rows, columns) classes; ``fine_own`` and ``fine_donor`` the same in cells half as large.
    """

    canvas: Canvas
    own: Cells
    donor: Cells
    fine_own: Cells
    fine_donor: Cells
    overlap: float


def window_of(own: Raster, donor: Raster, T_receiver_donor: Transform, scale: float = 1.0) -> Window:
    """The window around what both maps know under a transform; around all of both where they know nothing in common."""
    whole = _around(own, donor, T_receiver_donor, scale)
    mine, theirs = whole.cells_of(own), placed(donor, whole, T_receiver_donor, scale)
    joint = (mine != UNKNOWN) & (theirs != UNKNOWN)
    smaller = min(int(np.count_nonzero(mine)), int(np.count_nonzero(theirs)))
    seen = joint if joint.any() else (mine != UNKNOWN) | (theirs != UNKNOWN)
    canvas = _canvas(_bounds_m(seen, whole), least_m=min(own.cell_m, scale * donor.cell_m))
    fine = Canvas(canvas.x_m, canvas.y_m, canvas.cell_m / 2.0, 2 * canvas.rows, 2 * canvas.columns)
    fine_own, fine_donor = fine.cells_of(own), placed(donor, fine, T_receiver_donor, scale)
    overlap = int(np.count_nonzero(joint)) / max(1, smaller)
    return Window(canvas, _halved(fine_own), _halved(fine_donor), fine_own, fine_donor, overlap)


def _halved(cells: Cells) -> Cells:
    """In cells twice as large: where several fall into one, the wall shows."""
    rows, columns = cells.shape
    out: Cells = cells.reshape(rows // 2, 2, columns // 2, 2).max(axis=(1, 3))
    return out


def placed(raster: Raster, canvas: Canvas, T_canvas_raster: Transform, scale: float = 1.0) -> Cells:
    """What a map says in every cell of a canvas in another frame.

    Each cell is what lies under its middle; and every wall shows, however small its cells are.
    """
    c, s = math.cos(T_canvas_raster.yaw_rad), math.sin(T_canvas_raster.yaw_rad)
    turn = np.array([[c, -s], [s, c]])
    shift = np.array([T_canvas_raster.x_m, T_canvas_raster.y_m])
    x_m = canvas.x_m + (np.arange(canvas.columns) + 0.5) * canvas.cell_m
    y_m = canvas.y_m + (np.arange(canvas.rows) + 0.5) * canvas.cell_m
    middles = np.stack(np.meshgrid(x_m, y_m), axis=-1).reshape(-1, 2)
    there = (middles - shift) @ turn / scale  # turns back from the right
    column, row = np.floor((there - (raster.x_m, raster.y_m)) / raster.cell_m).astype(np.intp).T
    h, w = raster.cells.shape
    inside = (row >= 0) & (row < h) & (column >= 0) & (column < w)
    out = np.zeros(canvas.rows * canvas.columns, np.uint8)
    out[inside] = raster.cells[row[inside], column[inside]]
    cells: Cells = out.reshape(canvas.rows, canvas.columns)
    wall_row, wall_column = np.nonzero(raster.cells == OCCUPIED)
    walls = np.stack((wall_column + 0.5, wall_row + 0.5), axis=1) * raster.cell_m + (raster.x_m, raster.y_m)
    column, row = (
        np.floor((scale * walls @ turn.T + shift - (canvas.x_m, canvas.y_m)) / canvas.cell_m).astype(np.intp).T
    )
    inside = (row >= 0) & (row < canvas.rows) & (column >= 0) & (column < canvas.columns)
    cells[row[inside], column[inside]] = OCCUPIED
    return cells


def _around(own: Raster, donor: Raster, T: Transform, scale: float) -> Canvas:
    """A canvas around both maps."""
    x0, y0, x1, y1 = donor.bounds_m
    corners = scale * np.array([(x0, y0, 0.0), (x1, y0, 0.0), (x0, y1, 0.0), (x1, y1, 0.0)])
    there = T.apply(corners)[:, :2]
    x0, y0, x1, y1 = own.bounds_m
    points = np.concatenate((there, [(x0, y0), (x1, y1)]))
    low, high = points.min(axis=0), points.max(axis=0)
    cell_m = max(float((high - low).max()) / _LOOKED_PX, own.cell_m, scale * donor.cell_m)
    columns, rows = (np.floor((high - low) / cell_m).astype(int) + 1).tolist()
    return Canvas(float(low[0]), float(low[1]), cell_m, rows, columns)


def _bounds_m(mask: Cells | np.ndarray[tuple[int, ...], np.dtype[np.bool_]], canvas: Canvas) -> tuple[float, ...]:
    """x_min, y_min, x_max, y_max of the cells of a mask, with their surroundings."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    x0, x1 = canvas.x_m + columns[0] * canvas.cell_m, canvas.x_m + (columns[-1] + 1) * canvas.cell_m
    y0, y1 = canvas.y_m + rows[0] * canvas.cell_m, canvas.y_m + (rows[-1] + 1) * canvas.cell_m
    edge_m = max(_LEAST_M, _MARGIN * max(x1 - x0, y1 - y0))
    return float(x0 - edge_m), float(y0 - edge_m), float(x1 + edge_m), float(y1 + edge_m)


def _canvas(bounds_m: tuple[float, ...], least_m: float) -> Canvas:
    """A canvas with as many cells as a window has at most, or cells of ``least_m``."""
    x0, y0, x1, y1 = bounds_m
    cell_m = max(least_m, max(x1 - x0, y1 - y0) / LARGEST_PX)
    columns, rows = (max(1, min(LARGEST_PX, math.ceil(side / cell_m - 1e-9))) for side in (x1 - x0, y1 - y0))
    return Canvas(x0, y0, cell_m, rows, columns)
