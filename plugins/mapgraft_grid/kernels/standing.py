"""How the walls of two grids stand to each other, and what beams and paths run into."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

OURS, THEIRS = 0, 1
WALL, NEAR, AGAINST = 0, 1, 2  # of the walls of a side: all, those near the other's, those in the other's free space
STOOD, FREE_END, THROUGH = 0, 1, 2  # of beams: ended at a wall, in free space, went through one
_START_M = 0.15  # a beam begins inside its robot


@njit(cache=True)
def walls(
    own: NDArray[np.uint8],
    donor: NDArray[np.uint8],
    to_own_m: NDArray[np.float32],
    to_donor_m: NDArray[np.float32],
    tolerance_m: float,
    block: int,
    patch: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Count cells, blocks and patches where both grids know something.

    ``own`` and ``donor`` (h, w) classes of one window (0 unknown, 1 free, 2 occupied), ``to_own_m`` and ``to_donor_m``
    (h, w) how far the next wall of either is; ``block`` and ``patch`` are sides in cells. Returns the (2, 2) counts of
    (own, donor) classes, free first; (2, 3) numbers of blocks in which walls of ours, theirs are at all, near a wall of
    the other, in free space of the other and not near; (2,) patches with clearly more walls near than against, and
    with more against than near.
    """
    height, width = own.shape
    table = np.zeros((2, 2), np.int64)
    across = width // block + 1
    seen = np.zeros((2, 3, (height // block + 1) * across), np.uint8)
    patches_across = width // patch + 1
    votes = np.zeros(((height // patch + 1) * patches_across, 2), np.int64)
    for y in range(height):
        for x in range(width):
            a, b = own[y, x], donor[y, x]
            if a == 0 or b == 0:
                continue
            table[a - 1, b - 1] += 1
            if a == 1 and b == 1:
                continue
            k = (y // block) * across + x // block
            p = (y // patch) * patches_across + x // patch
            if a == 2:
                _vote(seen, votes, OURS, k, p, b, to_donor_m[y, x] <= tolerance_m)
            if b == 2:
                _vote(seen, votes, THEIRS, k, p, a, to_own_m[y, x] <= tolerance_m)
    blocks = np.zeros((2, 3), np.int64)
    for side in range(2):
        for what in range(3):
            blocks[side, what] = np.count_nonzero(seen[side, what])
    patches = np.zeros(2, np.int64)
    for p in range(votes.shape[0]):
        if votes[p, 0] > 2 * votes[p, 1]:
            patches[0] += 1
        elif votes[p, 1] > votes[p, 0]:
            patches[1] += 1
    return table, blocks, patches


@njit(cache=True)
def _vote(
    seen: NDArray[np.uint8], votes: NDArray[np.int64], side: int, block: int, patch: int, other: int, near: bool
) -> None:
    """Note one occupied cell of a side, given the other's class there."""
    seen[side, WALL, block] = 1
    if near:
        seen[side, NEAR, block] = 1
        votes[patch, 0] += 1
    elif other == 1:
        seen[side, AGAINST, block] = 1
        votes[patch, 1] += 1


@njit(cache=True)
def beams(
    classes: NDArray[np.uint8],
    to_wall_m: NDArray[np.float32],
    origins: NDArray[np.float64],
    ends: NDArray[np.float64],
    hits: NDArray[np.bool_],
    unit_m: float,
    tolerance_m: float,
) -> NDArray[np.int64]:
    """How many beams of one side end at a wall of the other grid, end in its free space, go through its walls (3,).

    ``classes`` and ``to_wall_m`` (h, w) are the other's; ``origins`` and ``ends`` (n, 2) in its cells, ``hits`` (n,).
    A beam goes through a wall when it was clear of all walls by the tolerance, meets an occupied cell and is clear
    again before its end: one that grazes a wall is never clear of it on both sides.
    """
    height, width = classes.shape
    out = np.zeros(3, np.int64)
    for i in range(ends.shape[0]):
        dx, dy = ends[i, 0] - origins[i, 0], ends[i, 1] - origins[i, 1]
        length = math.hypot(dx, dy)
        if length * unit_m <= _START_M:
            continue
        dx, dy = dx / length, dy / length
        state, at = 0, _START_M / unit_m
        stop = length - tolerance_m / unit_m
        while at < stop and state < 3:
            x, y = math.floor(origins[i, 0] + dx * at), math.floor(origins[i, 1] + dy * at)
            at += 0.5
            if not (0 <= x < width and 0 <= y < height):
                continue
            if classes[y, x] == 2:
                state = 2 if state == 1 else state
            elif to_wall_m[y, x] > tolerance_m:
                if state == 2:
                    state = 3
                elif classes[y, x] == 1:
                    state = 1
        if state == 3:
            out[THROUGH] += 1
        if not hits[i]:
            continue
        x, y = math.floor(ends[i, 0]), math.floor(ends[i, 1])
        if 0 <= x < width and 0 <= y < height:
            if to_wall_m[y, x] <= tolerance_m:
                out[STOOD] += 1
            elif classes[y, x] == 1:
                out[FREE_END] += 1
    return out


@njit(cache=True)
def steps(classes: NDArray[np.uint8], path: NDArray[np.float64], longest: float) -> NDArray[np.int64]:
    """How many occupied cells a path goes through, and how many cells that the grid knows (2,).

    ``path`` (n, 2) in the grid's cells, in the order driven; where two poses lie more than ``longest`` cells apart
    nobody knows what was between.
    """
    height, width = classes.shape
    out = np.zeros(2, np.int64)
    last_x, last_y = -1, -1
    for i in range(path.shape[0] - 1):
        dx, dy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        length = math.hypot(dx, dy)
        if length > longest:
            continue
        pieces = math.ceil(2.0 * length) + 1
        for k in range(pieces):
            x, y = math.floor(path[i, 0] + dx * k / pieces), math.floor(path[i, 1] + dy * k / pieces)
            if (x == last_x and y == last_y) or not (0 <= x < width and 0 <= y < height):
                continue
            last_x, last_y = x, y
            out[0] += classes[y, x] == 2
            out[1] += classes[y, x] != 0
    return out
