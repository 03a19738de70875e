"""What can be seen on a grid of how well it was mapped, without any truth to compare it with."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from mapgraft_grid.grid_map import FREE, OCCUPIED, DenseGrid
from mapgraft_grid.parameters import in_fixed_point

NEAR_M: Final = 0.3  # how far around a wall cell its surroundings are looked at
UNDECIDED: Final = in_fixed_point(0.4)  # evidence below this says nothing (40 % to 60 %)
SPECKLE_CELLS: Final = 3  # a group of fewer occupied cells is no wall

Share = tuple[NDArray[np.float32], NDArray[np.float32]]  # numerator and denominator per cell, summed over a window
FEATURES: Final = ("undecided", "spread_m", "interior", "speckle", "certainty", "resolution_m")


def feature_shares(grid: DenseGrid) -> dict[str, Share]:
    """Every feature but the resolution as two arrays (h, w), of which the ratio of sums over a window is the feature.

    ``undecided``: cells with evidence near a wall whose evidence contradicts itself, over all of those.
    ``spread_m``: how far the occupied cells around an occupied cell stray from a line, in metres.
    ``interior``: occupied cells that touch no free cell, over all: thick walls and walls that were smeared.
    ``speckle``: occupied cells in groups too small for a wall, over all.
    ``certainty``: the log-odds of the occupied cells, in nats.

    The last four rest on the occupied cells. See Filatov, Filatov and Krinkin 2017 for features of this kind.
    """
    occupied = (grid.classes == OCCUPIED).astype(np.uint8)
    wall = occupied.astype(np.float32)
    reach = reach_cells(grid.resolution_m)
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    near_wall = (cv2.dilate(occupied, square) > 0) & (grid.log_odds != 0)
    undecided = near_wall & (abs(grid.log_odds) < UNDECIDED)
    beside_free = cv2.dilate((grid.classes == FREE).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    spread_m = _spread_cells(wall, reach) * np.float32(grid.resolution_m)
    nats = grid.log_odds.astype(np.float32) / np.float32(in_fixed_point(1.0))
    return {
        "undecided": (undecided.astype(np.float32), near_wall.astype(np.float32)),
        "spread_m": (spread_m * wall, wall),
        "interior": (wall * ~beside_free, wall),
        "speckle": (_speckle(occupied), wall),
        "certainty": (nats * wall, wall),
    }


def reach_cells(resolution_m: float) -> int:
    """How many cells around a wall cell are looked at."""
    return max(1, round(NEAR_M / resolution_m))


def _spread_cells(wall: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Standard deviation across the best line through the occupied cells of the square around every cell."""
    offset = np.arange(-reach, reach + 1, dtype=np.float32)
    one = np.ones_like(offset)

    def moment(along_x: NDArray[np.float32], along_y: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.sepFilter2D(wall, -1, along_x, along_y, borderType=cv2.BORDER_CONSTANT), np.float32)

    count = np.maximum(moment(one, one), 1)
    x, y = moment(offset, one) / count, moment(one, offset) / count
    xx, yy = moment(offset**2, one) / count - x * x, moment(one, offset**2) / count - y * y
    xy = moment(offset, offset) / count - x * y
    smaller = (xx + yy) / 2 - np.sqrt((xx - yy) ** 2 / 4 + xy * xy)
    spread: NDArray[np.float32] = np.sqrt(np.maximum(smaller, 0))
    return spread


def _speckle(occupied: NDArray[np.uint8]) -> NDArray[np.float32]:
    _, labels, stats, _ = cv2.connectedComponentsWithStats(occupied, connectivity=8)
    small = stats[:, cv2.CC_STAT_AREA] < SPECKLE_CELLS
    small[0] = False  # the background
    return np.asarray(small[labels], np.float32)
