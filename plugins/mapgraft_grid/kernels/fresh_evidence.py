"""What beams that were not there when a donor was placed say of its place, block by block."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

NO_BEAM, HIT_END = 0, 2  # as in kernels.rays

# What a cell is: bits of one number
DONOR = 3  # the donor says: 0 nothing, 1 free and no wall near, 2 a wall is near, 3 occupied
FREE, NEAR, WALL = 1, 2, 3
KNOWN = 4  # the receiver knew it, or a wall near it, when the donor was placed
AWAY, FARTHEST = 3, 31  # from this bit on: how many cells the donor's next wall is away, at most so many

AGREED, AGAINST, PLACES = 0, 1, 2  # of a vote, of a block, of the tally

PATCH = 4  # blocks: the side of a patch
FOLLOWED = 5  # one beam in so many, because neighbours see the same
STEP = 0.75  # cells


@njit(cache=True)
def _cast(
    votes: NDArray[np.int32],
    places: NDArray[np.int32],
    tally: NDArray[np.int64],
    y: int,
    x: int,
    which: int,
    block: int,
    least: int,
) -> None:
    """Count one vote in the block of a cell, and what the block says now in the tally."""
    row, column = y // block, x // block
    before = _says(votes[row, column, AGREED], votes[row, column, AGAINST], least)
    votes[row, column, which] += 1
    now = _says(votes[row, column, AGREED], votes[row, column, AGAINST], least)
    if now == before:
        return
    row, column = row // PATCH, column // PATCH
    if before >= 0:
        tally[before] -= 1
    tally[now] += 1
    if before == AGAINST:
        places[row, column] -= 1
        tally[PLACES] -= places[row, column] == 0
    if now == AGAINST:
        tally[PLACES] += places[row, column] == 0
        places[row, column] += 1


@njit(cache=True)
def _says(agreed: int, against: int, least: int) -> int:
    """What a block says with so many votes: AGREED, AGAINST (also when they are equal), or -1 with too few."""
    if agreed + against < least:
        return -1
    return AGREED if agreed > against else AGAINST


@njit(cache=True)
def hear(
    cells: NDArray[np.uint8],
    votes: NDArray[np.int32],
    places: NDArray[np.int32],
    tally: NDArray[np.int64],
    beams: NDArray[np.float64],
    kinds: NDArray[np.uint8],
    where: tuple[int, int, int, int, int, int],
) -> None:
    """Let the beams of some scans vote in the blocks of a window.

    ``cells`` (h, w) are what the window's cells are; ``votes`` (⌈h / block⌉, ⌈w / block⌉, 2) for and against,
    ``places`` how many blocks of each patch are against, ``tally`` (3,) the blocks for, those against, and the patches
    with such a one. ``beams`` (n, 4) and ``kinds`` (n,) in cells of the lattice. ``where``: how many of these make one
    cell of the window, the cell (x, y) of the window's element [0, 0], the side of a block in cells, how many votes
    decide it, and how many cells are near.

    A beam that ends in a cell unknown before votes for the donor when a wall of the donor is near, against it when the
    donor has free space there; the cell is known then. Of the other beams, those that do not end in a known cell, some
    are followed: one votes against the donor at a wall of it, unknown before, that it goes through.
    """
    ratio, first_x, first_y, block, least, near = where
    height, width = cells.shape
    scale = 1.0 / ratio
    for i in range(kinds.size):
        if kinds[i] == NO_BEAM:
            continue
        x1, y1 = scale * beams[i, 2] - first_x, scale * beams[i, 3] - first_y
        if 0.0 <= x1 < width and 0.0 <= y1 < height:
            x, y = int(x1), int(y1)
            cell = cells[y, x]
            if cell & KNOWN:
                continue
            if kinds[i] == HIT_END:
                donor = cell & DONOR
                if donor:
                    which = AGAINST if donor == FREE else AGREED
                    _cast(votes, places, tally, y, x, which, block, least)
                    cells[y, x] |= KNOWN
        if _is_followed(beams[i, 2], beams[i, 3]):
            x0, y0 = scale * beams[i, 0] - first_x, scale * beams[i, 1] - first_y
            wall = _gone_through(cells, x0, y0, x1, y1, near)
            if wall >= 0:
                _cast(votes, places, tally, wall // width, wall % width, AGAINST, block, least)
                cells[wall // width, wall % width] |= KNOWN


@njit(cache=True)
def _is_followed(x: float, y: float) -> bool:
    """One beam in FOLLOWED, by a hash of where it ends: the same whatever other beams there are."""
    bits = np.uint64(np.int64(x * 64.0)) * np.uint64(0x9E3779B97F4A7C15) ^ np.uint64(np.int64(y * 64.0))
    return bool((bits * np.uint64(0xBF58476D1CE4E5B9)) >> np.uint64(32) < np.uint64((1 << 32) // FOLLOWED))


@njit(cache=True)
def _gone_through(cells: NDArray[np.uint8], x0: float, y0: float, x1: float, y1: float, near: int) -> int:
    """The first wall of the donor, unknown before, that a beam goes through, as row · width + column; -1 if none.

    It must be clear of all walls by ``near`` cells before and after: one that grazes a wall never is. Where walls are
    far the beam is followed in leaps.
    """
    height, width = cells.shape
    dx, dy = x1 - x0, y1 - y0
    length = math.hypot(dx, dy)
    begin, end = _inside(x0, y0, dx, dy, width, height)
    if length <= near or begin >= end:
        return -1
    dx, dy = dx / length, dy / length
    at, stop = begin * length, min(end * length, length - near)
    clear, wall = False, -1
    while at < stop:
        x, y = int(x0 + dx * at), int(y0 + dy * at)
        if x < 0 or y < 0 or x >= width or y >= height:
            at += STEP
            continue
        cell = cells[y, x]
        gap = np.int64(cell >> AWAY) - near
        if gap > 0:
            if wall >= 0:
                return wall
            clear = cell & DONOR == FREE
            at += max(STEP, gap - 1.0)
            continue
        if cell & DONOR == WALL:
            if clear and cell & KNOWN == 0:
                wall = y * width + x
            clear = False
        at += STEP
    return -1


@njit(cache=True)
def _inside(x: float, y: float, dx: float, dy: float, width: int, height: int) -> tuple[float, float]:
    """Between which shares of its length a line from (x, y) along (dx, dy) lies in a window (Liang and Barsky 1984)."""
    begin, end = 0.0, 1.0
    for start, step, size in ((x, dx, float(width)), (y, dy, float(height))):
        if step == 0.0:
            if start < 0.0 or start >= size:
                return 1.0, 0.0
            continue
        a, b = (0.0 - start) / step, (size - start) / step
        begin, end = max(begin, min(a, b)), min(end, max(a, b))
    return begin, end


@njit(cache=True)
def compare(
    cells: NDArray[np.uint8],
    fresh: NDArray[np.bool_],
    own: NDArray[np.uint8],
    own_near: NDArray[np.bool_],
    votes: NDArray[np.int32],
    places: NDArray[np.int32],
    tally: NDArray[np.int64],
    block: int,
    least: int,
) -> None:
    """Let the cells vote that one of the two has newly come to know (``fresh``) and the receiver knows (``own``).

    ``own`` (h, w) are the receiver's classes, ``own_near`` (h, w) says where a wall of it is near; the others as in
    ``hear``.
    """
    height, width = cells.shape
    for y in range(height):
        for x in range(width):
            if not fresh[y, x] or own[y, x] == 0:
                continue
            donor = cells[y, x] & DONOR
            if (own[y, x] == 2 and donor >= NEAR) or (donor == WALL and own_near[y, x]):
                _cast(votes, places, tally, y, x, AGREED, block, least)
            elif (own[y, x] == 2 and donor == FREE) or donor == WALL:
                _cast(votes, places, tally, y, x, AGAINST, block, least)
