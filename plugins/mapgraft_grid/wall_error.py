"""How far the walls of a grid lie from those of a better one."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from mapgraft.contracts import EmptyMapError
from mapgraft_grid.grid_map import OCCUPIED, DenseGrid

CUT_M: Final = 1.0  # a cell farther from every wall counts as that far


def wall_error_m(grid: DenseGrid, reference: DenseGrid) -> NDArray[np.float64]:
    """The distance of every occupied cell to the nearest occupied cell of the reference, at most 1 m; 0 elsewhere.

    Both grids lie in one frame, each with its own resolution; distances are between cell centres. Shape (h, w) of
    ``grid``. Raises EmptyMapError when the reference has no occupied cell.
    """
    if not (reference.classes == OCCUPIED).any():
        raise EmptyMapError("the reference map has no occupied cell, so that no wall error can be measured")
    distance = distance_transform_edt(reference.classes != OCCUPIED) * reference.resolution_m
    rows, columns = np.nonzero(grid.classes == OCCUPIED)
    per_cell = grid.resolution_m / reference.resolution_m
    start = (np.array(grid.origin_m) - np.array(reference.origin_m)) / reference.resolution_m
    x = np.floor((columns + 0.5) * per_cell + start[0]).astype(np.int64)
    y = np.floor((rows + 0.5) * per_cell + start[1]).astype(np.int64)
    inside = (x >= 0) & (y >= 0) & (x < distance.shape[1]) & (y < distance.shape[0])
    error = np.zeros(grid.classes.shape)
    error[rows, columns] = CUT_M
    error[rows[inside], columns[inside]] = np.minimum(distance[y[inside], x[inside]], CUT_M)
    return error


def mean_wall_error_m(grid: DenseGrid, reference: DenseGrid) -> float:
    """The mean of ``wall_error_m`` over the occupied cells; raises EmptyMapError when one of them has none."""
    occupied = grid.classes == OCCUPIED
    if not occupied.any():
        raise EmptyMapError("the map has no occupied cell, so that its walls cannot be judged")
    return float(wall_error_m(grid, reference)[occupied].mean())
