"""Votes of pairs of walls for how one map lies in the other.

At a given rotation, two walls that run alike say how far the maps are shifted across them, and along them they overlap
the more the nearer their middles are. Each pair votes for all shifts under which they lie on each other, with the
length over which they then do; shifts that many pairs agree on, of walls in more than one direction, collect the most.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

_BLUR = (0.25, 0.5, 0.25)  # of a vote, across the wall, in cells of the table


@njit(cache=True)
def directions(
    angles: NDArray[np.float64], lengths: NDArray[np.float64], faced: NDArray[np.bool_], bins: int
) -> NDArray[np.float64]:
    """The length of wall (bins,) by direction over the full circle; half of a wall of unknown side either way."""
    out = np.zeros(bins)
    for i in range(angles.size):
        place = angles[i] / (2.0 * math.pi) * bins
        low = math.floor(place)
        share = place - low
        for half in range(1 if faced[i] else 2):
            k = (low + half * (bins // 2)) % bins
            weight = lengths[i] if faced[i] else 0.5 * lengths[i]
            out[k] += weight * (1.0 - share)
            out[(k + 1) % bins] += weight * share
    return out


@njit(cache=True)
def vote(
    target: NDArray[np.float64],
    target_faced: NDArray[np.bool_],
    source: NDArray[np.float64],
    source_faced: NDArray[np.bool_],
    c: float,
    s: float,
    turn_cosine: float,
    origin: NDArray[np.float64],
    cell_m: float,
    votes: NDArray[np.float64],
) -> None:
    """Add the votes of all pairs to ``votes`` (h, w), whose element [0, 0] stands for the shift ``origin`` (x, y).

    ``target`` (n, 4), ``source`` (m, 4), turned by (c, s) before it is shifted.
    """
    for j in range(source.shape[0]):
        sx0, sy0 = c * source[j, 0] - s * source[j, 1], s * source[j, 0] + c * source[j, 1]
        sx1, sy1 = c * source[j, 2] - s * source[j, 3], s * source[j, 2] + c * source[j, 3]
        length_s = math.hypot(sx1 - sx0, sy1 - sy0)
        ux, uy = (sx1 - sx0) / length_s, (sy1 - sy0) / length_s
        for i in range(target.shape[0]):
            dx, dy = target[i, 2] - target[i, 0], target[i, 3] - target[i, 1]
            length_t = math.hypot(dx, dy)
            vx, vy = dx / length_t, dy / length_t
            dot = ux * vx + uy * vy
            if (dot if source_faced[j] and target_faced[i] else abs(dot)) < turn_cosine:
                continue
            # the shift that brings middle onto middle, and how far along the wall the two still overlap
            x = 0.5 * (target[i, 0] + target[i, 2] - sx0 - sx1) - origin[0]
            y = 0.5 * (target[i, 1] + target[i, 3] - sy0 - sy1) - origin[1]
            _draw(votes, x / cell_m, y / cell_m, vx, vy, length_s / cell_m, length_t / cell_m, cell_m)


@njit(cache=True)
def _draw(
    votes: NDArray[np.float64], x: float, y: float, vx: float, vy: float, long: float, other: float, cell_m: float
) -> None:
    """Add one pair's overlap, in metres, along the line through (x, y); positions and lengths in cells."""
    height, width = votes.shape
    reach = 0.5 * (long + other)
    flat = abs(vx) >= abs(vy)
    slope = vy / vx if flat else vx / vy
    main = abs(vx) if flat else abs(vy)
    here, side = (x, y) if flat else (y, x)
    size, other_size = (width, height) if flat else (height, width)
    for k in range(max(0, math.ceil(here - reach * main)), min(size, math.floor(here + reach * main) + 1)):
        overlap = min(reach - abs(k - here) / main, long, other) * cell_m
        if overlap <= 0.0:
            continue
        across = side + (k - here) * slope
        low = math.floor(across)
        share = across - low
        for n in range(-1, 3):
            place = low + n
            if not 0 <= place < other_size:
                continue
            weight = 0.0
            for b in range(3):
                if n == b - 1:
                    weight += _BLUR[b] * (1.0 - share)
                elif n == b:
                    weight += _BLUR[b] * share
            if flat:
                votes[place, k] += overlap * weight
            else:
                votes[k, place] += overlap * weight


@njit(cache=True)
def peaks(votes: NDArray[np.float64], radius: int, most: int) -> NDArray[np.int64]:
    """The places (k, 2) row, column of the highest votes, best first, further than ``radius`` cells from each other.

    Only places as high as their eight neighbours; of equals the first by row and column.
    """
    height, width = votes.shape
    found = np.empty((0, 2), np.int64)
    tops = np.zeros(votes.size, np.int64)
    count = 0
    for y in range(height):
        for x in range(width):
            v = votes[y, x]
            if v <= 0.0:
                continue
            top = True
            for j in range(max(y - 1, 0), min(y + 2, height)):
                for i in range(max(x - 1, 0), min(x + 2, width)):
                    top = top and votes[j, i] <= v
            if top:
                tops[count] = y * width + x
                count += 1
    values = np.empty(count)
    for k in range(count):
        values[k] = -votes[tops[k] // width, tops[k] % width]
    order = np.argsort(values, kind="mergesort")
    found = np.empty((most, 2), np.int64)
    kept = 0
    for k in order:
        y, x = tops[k] // width, tops[k] % width
        near = False
        for m in range(kept):
            near = near or (abs(found[m, 0] - y) <= radius and abs(found[m, 1] - x) <= radius)
        if not near:
            found[kept, 0], found[kept, 1] = y, x
            kept += 1
            if kept == most:
                break
    return found[:kept]
