"""Keeping a bounded sample of the beams that end in each tile, the same whatever the order they came in.

Every ray has a rank, a hash of what it is; each tile keeps the rays of lowest rank (a bottom-k sketch). Positions are
integers in steps of 1/256 cell, relative to the lowest corner of the tile in which the ray ends.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_grid.kernels.tile_keys import TILE, tile_key

STEPS_PER_CELL = 256
END_X, END_Y, START_X, START_Y, HIT = range(5)  # columns of a ray


@njit(cache=True)
def _mixed(state: np.uint64, value: int) -> np.uint64:
    """One round of splitmix64 (Steele, Lea and Flood 2014)."""
    z = state + np.uint64(0x9E3779B97F4A7C15) + np.uint64(value)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(cache=True)
def _stride(directions: NDArray[np.float64], step_rad: float) -> int:
    """How many beams make one step, from the mean angle between neighbours."""
    turned = 0.0
    for i in range(1, directions.shape[0]):
        turned += abs(directions[i - 1, 0] * directions[i, 1] - directions[i - 1, 1] * directions[i, 0])
    if turned <= 0.0:
        return 1
    return max(1, int(step_rad * (directions.shape[0] - 1) / turned + 0.5))


@njit(cache=True)
def ray_of(start_x: float, start_y: float, end_x: float, end_y: float, hit: bool, ray: NDArray[np.int32]) -> int:
    """Write one ray, given in cells, into ``ray`` (5,); returns the key of the tile in which it ends."""
    x, y = int(np.floor(end_x * STEPS_PER_CELL)), int(np.floor(end_y * STEPS_PER_CELL))
    side = TILE * STEPS_PER_CELL
    across, up = x // side, y // side
    ray[END_X], ray[END_Y] = x - across * side, y - up * side
    ray[START_X] = int(np.floor(start_x * STEPS_PER_CELL)) - across * side
    ray[START_Y] = int(np.floor(start_y * STEPS_PER_CELL)) - up * side
    ray[HIT] = 1 if hit else 0
    return tile_key(across, up)


@njit(cache=True)
def pick(
    directions: NDArray[np.float64], beams: NDArray[np.float64], kinds: NDArray[np.uint8], step_rad: float
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """About one ray per ``step_rad`` of a scan: the keys (k,) of the tiles they end in and the rays (k, 5).

    ``beams`` (n, 4) start and end in cells, ``kinds`` (n,) 0 none, 1 free, 2 hit.
    """
    stride = _stride(directions, step_rad)
    keys = np.empty(kinds.size // stride + 1, np.int64)
    rays = np.empty((keys.size, 5), np.int32)
    n = 0
    for i in range(0, kinds.size, stride):
        if kinds[i] != 0:
            keys[n] = ray_of(beams[i, 0], beams[i, 1], beams[i, 2], beams[i, 3], kinds[i] == 2, rays[n])
            n += 1
    return keys[:n], rays[:n]


@njit(cache=True)
def keep(
    keys: NDArray[np.int64],
    slots: NDArray[np.int32],
    rays: NDArray[np.int32],
    kept: NDArray[np.int32],
    highest: NDArray[np.uint64],
    ranks: NDArray[np.uint64],
    pool: NDArray[np.int32],
) -> None:
    """Offer rays (k, 5) that end in tiles ``keys`` (k,) to the sketches.

    ``kept`` (n,) rays per tile, ``highest`` (n,) the highest rank of full tiles, ``ranks`` (n, limit), ``pool``
    (n, limit, 5). A ray that is there already is not kept twice.
    """
    limit = ranks.shape[1]
    if limit == 0:
        return
    for i in range(keys.size):
        slot, rank = slots[i], _mixed(np.uint64(0), keys[i])
        for j in range(5):
            rank = _mixed(rank, rays[i, j])
        size = kept[slot]
        if size == limit and rank >= highest[slot]:
            continue
        place, twin = size, False
        for j in range(size):
            if ranks[slot, j] == rank:
                twin = True
            if size == limit and ranks[slot, j] == highest[slot]:
                place = j
        if twin:
            continue
        kept[slot] = min(size + 1, limit)
        ranks[slot, place] = rank
        for j in range(5):
            pool[slot, place, j] = rays[i, j]
        if kept[slot] == limit:
            highest[slot] = ranks[slot].max()
