"""Moving counts to another lattice by integer arithmetic: the same bytes on every machine.

Positions are in cells with 32 binary places. ``A`` (2, 2) turns steps of the target lattice into steps of the source's,
``F`` (2, 2) the reverse; both with 32 binary places. Source counts are (n, 64, 64) uint32 in the order of ``keys`` (n,)
int64, ascending.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_grid.kernels.sketch import END_X, END_Y, HIT, START_X, START_Y, STEPS_PER_CELL, ray_of
from mapgraft_grid.kernels.tile_keys import TILE, tile_key, tile_x, tile_y

PLACES = 32

CountTiles = NDArray[np.uint32]


@njit(cache=True)
def _number(keys: NDArray[np.int64], key: int) -> int:
    """Which of the ascending keys this is, -1 when it is none of them."""
    low, high = 0, keys.size
    while low < high:
        middle = (low + high) >> 1
        if keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    if low < keys.size and keys[low] == key:
        return low
    return -1


@njit(cache=True)
def nearest(
    keys: NDArray[np.int64],
    hits: CountTiles,
    misses: CountTiles,
    A: NDArray[np.int64],
    starts: NDArray[np.int64],
    out_hits: CountTiles,
    out_misses: CountTiles,
) -> None:
    """Every target cell takes the counts of the source cell in which its centre lies.

    ``starts`` (k, 2) is where the centre of the first cell of each target tile lies in the source; the results are
    (k, 64, 64).
    """
    for i in range(starts.shape[0]):
        last, number = -1, -1
        for row in range(TILE):
            for column in range(TILE):
                x = (starts[i, 0] + A[0, 0] * column + A[0, 1] * row) >> PLACES
                y = (starts[i, 1] + A[1, 0] * column + A[1, 1] * row) >> PLACES
                key = tile_key(x >> 6, y >> 6)
                if key != last:
                    last, number = key, _number(keys, key)
                if number >= 0:
                    out_hits[i, row, column] = hits[number, y & 63, x & 63]
                    out_misses[i, row, column] = misses[number, y & 63, x & 63]
                else:
                    out_hits[i, row, column] = 0
                    out_misses[i, row, column] = 0


@njit(cache=True)
def _gather(
    keys: NDArray[np.int64],
    hits: CountTiles,
    misses: CountTiles,
    model: tuple[int, int, int],
    F: NDArray[np.int64],
    first: NDArray[np.int64],
    place: NDArray[np.int64],
    size: NDArray[np.int64],
    sums: NDArray[np.int64],
    strongest: NDArray[np.int64],
) -> None:
    """Let every source cell of a rectangle report to the target cell in which its centre lies.

    ``first`` (2,) is the first source cell, ``place`` (2,) where its centre lies in the target tile, ``size`` (2,) how
    many cells there are in x and y. ``sums`` (64, 64, 4): cells, cells with counts, their hits, their misses.
    ``strongest`` (64, 64, 2): hits and misses of the occupied cell with most hits, then with fewest misses.
    """
    l_hit, l_miss, occupied = model
    last, number = -1, -1
    for j in range(size[1]):
        y = first[1] + j
        for i in range(size[0]):
            column = (place[0] + F[0, 0] * i + F[0, 1] * j) >> PLACES
            row = (place[1] + F[1, 0] * i + F[1, 1] * j) >> PLACES
            if not (0 <= column < TILE and 0 <= row < TILE):
                continue
            x = first[0] + i
            key = tile_key(x >> 6, y >> 6)
            if key != last:
                last, number = key, _number(keys, key)
            sums[row, column, 0] += 1
            if number < 0:
                continue
            h, m = np.int64(hits[number, y & 63, x & 63]), np.int64(misses[number, y & 63, x & 63])
            if h + m > 0:
                sums[row, column, 1] += 1
                sums[row, column, 2] += h
                sums[row, column, 3] += m
            best = strongest[row, column]
            if h * l_hit + m * l_miss >= occupied and (h > best[0] or (h == best[0] and m < best[1])):
                best[0], best[1] = h, m


@njit(cache=True)
def centres(
    keys: NDArray[np.int64],
    hits: CountTiles,
    misses: CountTiles,
    model: tuple[int, int, int],
    F: NDArray[np.int64],
    firsts: NDArray[np.int64],
    places: NDArray[np.int64],
    size: NDArray[np.int64],
    out_hits: CountTiles,
    out_misses: CountTiles,
) -> None:
    """Every source cell goes to the target cell in which its centre lies; for targets coarser than the source.

    A target cell takes the counts of its strongest occupied source cell (``model``: l_hit, l_miss and the log-odds from
    which a cell is occupied). Without one, where at least half of its source cells have counts, it takes their mean:
    hits rounded down, misses up, so that what was free stays free and nothing becomes occupied. ``out_hits`` and
    ``out_misses`` (k, 64, 64) hold the result of ``nearest`` before: it stands where no centre lies in the cell, and
    where it is occupied and none of the centres is, so that walls keep together.
    """
    l_hit, l_miss, occupied = model
    sums = np.empty((TILE, TILE, 4), np.int64)
    strongest = np.empty((TILE, TILE, 2), np.int64)
    for i in range(firsts.shape[0]):
        sums[:] = 0
        strongest[:] = 0
        _gather(keys, hits, misses, model, F, firsts[i], places[i], size, sums, strongest)
        for row in range(TILE):
            for column in range(TILE):
                cells, touched = sums[row, column, 0], sums[row, column, 1]
                h, m = np.int64(out_hits[i, row, column]), np.int64(out_misses[i, row, column])
                if strongest[row, column, 0] > 0:
                    h, m = strongest[row, column, 0], strongest[row, column, 1]
                elif cells > 0 and h * l_hit + m * l_miss < occupied:
                    h, m = np.int64(0), np.int64(0)
                    if 2 * touched >= cells and touched > 0:
                        h = sums[row, column, 2] // touched
                        m = (sums[row, column, 3] + touched - 1) // touched
                out_hits[i, row, column] = h
                out_misses[i, row, column] = m


@njit(cache=True)
def move_rays(
    keys: NDArray[np.int64], rows: NDArray[np.int32], F: NDArray[np.float64], shift: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Rays (n, 5) that end in tiles ``keys`` (n,), moved to the target's cells: p ← F · p + shift.

    Sums and products only, so that it rounds alike everywhere.
    """
    out_keys = np.empty_like(keys)
    out = np.empty_like(rows)
    for i in range(keys.size):
        left, low = tile_x(keys[i]) * TILE, tile_y(keys[i]) * TILE
        ex = left + (rows[i, END_X] + 0.5) / STEPS_PER_CELL
        ey = low + (rows[i, END_Y] + 0.5) / STEPS_PER_CELL
        sx = left + (rows[i, START_X] + 0.5) / STEPS_PER_CELL
        sy = low + (rows[i, START_Y] + 0.5) / STEPS_PER_CELL
        out_keys[i] = ray_of(
            F[0, 0] * sx + F[0, 1] * sy + shift[0],
            F[1, 0] * sx + F[1, 1] * sy + shift[1],
            F[0, 0] * ex + F[0, 1] * ey + shift[0],
            F[1, 0] * ex + F[1, 1] * ey + shift[1],
            rows[i, HIT] > 0,
            out[i],
        )
    return out_keys, out
