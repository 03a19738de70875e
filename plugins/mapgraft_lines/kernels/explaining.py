"""How much of the walls of one map those of another explain, and how much stands in its free space."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

STEP_M = 0.1  # walls are looked at in pieces about as long
LONG_M = 2.0  # of one wall: what is much longer tells little more
_SLACK_M = 0.1  # a wall explains a little beyond its ends
FREE = 1  # of ``deep``: free, and all around
EXPLAINED, FULL, AGAINST, SQUARES, LENGTH = range(5)


@njit(cache=True)
def _distances(
    x0: float,
    y0: float,
    c: float,
    s: float,
    length: float,
    faced: bool,
    others: NDArray[np.float64],
    others_faced: NDArray[np.bool_],
    across_m: float,
    turn_cosine: float,
    best: NDArray[np.float64],
) -> None:
    """How far each piece of one wall is from the nearest other wall that runs as it does: ``best`` (pieces,), at most
    ``across_m``.
    """
    best[:] = across_m
    step = length / best.size
    for j in range(others.shape[0]):
        ax, ay = others[j, 0] - x0, others[j, 1] - y0
        bx, by = others[j, 2] - x0, others[j, 3] - y0
        qa, qb = c * ay - s * ax, c * by - s * bx
        if min(qa, qb) > across_m or max(qa, qb) < -across_m:
            continue
        ta, tb = c * ax + s * ay, c * bx + s * by
        low, high = max(min(ta, tb) - _SLACK_M, 0.0), min(max(ta, tb) + _SLACK_M, length)
        if high <= low:
            continue
        reach = math.hypot(bx - ax, by - ay)
        dot = (tb - ta) / reach if reach > 0.0 else 0.0
        if (dot if faced and others_faced[j] else abs(dot)) < turn_cosine:
            continue
        slope = (qb - qa) / (tb - ta)
        for k in range(max(0, math.ceil(low / step - 0.5)), min(best.size, math.floor(high / step - 0.5) + 1)):
            best[k] = min(best[k], abs(qa + ((k + 0.5) * step - ta) * slope))


@njit(cache=True)
def _pieces(length: float) -> int:
    return max(1, round(length / STEP_M))


@njit(cache=True)
def explained(
    walls: NDArray[np.float64],
    faced: NDArray[np.bool_],
    others: NDArray[np.float64],
    others_faced: NDArray[np.bool_],
    deep: NDArray[np.uint8],
    origin: NDArray[np.float64],
    cell_m: float,
    across_m: float,
    turn_cosine: float,
) -> NDArray[np.float64]:
    """What becomes of ``walls`` (n, 4) among ``others`` (m, 4) of the same frame: (5,) in metres.

    ``FULL`` is every piece within ``across_m`` of a wall that runs as it does, the same side seen where both know it;
    ``EXPLAINED`` the same, each piece less the more it is off, and each wall less the longer it is: of the length l it
    counts 2 m · log(1 + l / 2 m), because one long line agrees with another as easily as a short one does; ``AGAINST``
    what lies in the other map's free space (``deep`` (h, w), ``origin`` its corner in cells) and near no such wall;
    ``SQUARES`` Σ distance² · length of what is explained (m³); ``LENGTH`` all.
    """
    out = np.zeros(5)
    height, width = deep.shape
    room = np.empty(16)
    for i in range(walls.shape[0]):
        x0, y0 = walls[i, 0], walls[i, 1]
        length = math.hypot(walls[i, 2] - x0, walls[i, 3] - y0)
        if length <= 0.0:
            continue
        c, s = (walls[i, 2] - x0) / length, (walls[i, 3] - y0) / length
        pieces = _pieces(length)
        step = length / pieces
        if room.size < pieces:
            room = np.empty(2 * pieces)
        best = room[:pieces]
        _distances(x0, y0, c, s, length, faced[i], others, others_faced, across_m, turn_cosine, best)
        told = 0.0
        for k in range(pieces):
            if best[k] < across_m:
                share = best[k] / across_m
                told += step * (1.0 - share * share)
                out[FULL] += step
                out[SQUARES] += step * best[k] * best[k]
            else:
                x = math.floor((x0 + (k + 0.5) * step * c) / cell_m - origin[0])
                y = math.floor((y0 + (k + 0.5) * step * s) / cell_m - origin[1])
                if 0 <= x < width and 0 <= y < height and deep[y, x] == FREE:
                    out[AGAINST] += step
        out[EXPLAINED] += LONG_M * math.log1p(told / LONG_M)
        out[LENGTH] += length
    return out


@njit(cache=True)
def judged(
    walls: NDArray[np.float64],
    faced: NDArray[np.bool_],
    others: NDArray[np.float64],
    others_faced: NDArray[np.bool_],
    deep: NDArray[np.uint8],
    origin: NDArray[np.float64],
    cell_m: float,
    across_m: float,
    turn_cosine: float,
) -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    """Each piece of ``walls``, wall by wall: its middle (k, 2), and 1 where it is explained, -1 where it is against,
    0 where nobody can tell; as ``explained``.
    """
    height, width = deep.shape
    total = 0
    for i in range(walls.shape[0]):
        total += _pieces(math.hypot(walls[i, 2] - walls[i, 0], walls[i, 3] - walls[i, 1]))
    points, verdicts = np.empty((total, 2)), np.zeros(total, np.int8)
    n = 0
    for i in range(walls.shape[0]):
        x0, y0 = walls[i, 0], walls[i, 1]
        length = math.hypot(walls[i, 2] - x0, walls[i, 3] - y0)
        pieces = _pieces(length)
        best = np.full(pieces, across_m)
        c, s = 0.0, 0.0
        if length > 0.0:
            c, s = (walls[i, 2] - x0) / length, (walls[i, 3] - y0) / length
            _distances(x0, y0, c, s, length, faced[i], others, others_faced, across_m, turn_cosine, best)
        for k in range(pieces):
            t = (k + 0.5) * length / pieces
            points[n, 0], points[n, 1] = x0 + t * c, y0 + t * s
            x, y = math.floor(points[n, 0] / cell_m - origin[0]), math.floor(points[n, 1] / cell_m - origin[1])
            if best[k] < across_m:
                verdicts[n] = 1
            elif 0 <= x < width and 0 <= y < height and deep[y, x] == FREE:
                verdicts[n] = -1
            n += 1
    return points, verdicts


@njit(cache=True)
def moved(walls: NDArray[np.float64], c: float, s: float, x: float, y: float) -> NDArray[np.float64]:
    """Walls (n, 4) turned by (c, s) and then shifted."""
    out = np.empty_like(walls)
    for i in range(walls.shape[0]):
        for end in (0, 2):
            out[i, end] = c * walls[i, end] - s * walls[i, end + 1] + x
            out[i, end + 1] = s * walls[i, end] + c * walls[i, end + 1] + y
    return out


@njit(cache=True)
def both_ways(
    target: NDArray[np.float64],
    target_faced: NDArray[np.bool_],
    target_deep: NDArray[np.uint8],
    target_origin: NDArray[np.float64],
    target_cell_m: float,
    source: NDArray[np.float64],
    source_faced: NDArray[np.bool_],
    source_deep: NDArray[np.uint8],
    source_origin: NDArray[np.float64],
    source_cell_m: float,
    poses: NDArray[np.float64],
    across_m: float,
    turn_cosine: float,
) -> NDArray[np.float64]:
    """``explained`` of the target's and of the source's walls, (k, 2, 5), for poses (k, 3) of T_target_source."""
    out = np.empty((poses.shape[0], 2, 5))
    for k in range(poses.shape[0]):
        x, y, c, s = poses[k, 0], poses[k, 1], math.cos(poses[k, 2]), math.sin(poses[k, 2])
        back = moved(target, c, -s, -(c * x + s * y), s * x - c * y)
        out[k, 0] = explained(
            back, target_faced, source, source_faced, source_deep, source_origin, source_cell_m, across_m, turn_cosine
        )
        there = moved(source, c, s, x, y)
        out[k, 1] = explained(
            there, source_faced, target, target_faced, target_deep, target_origin, target_cell_m, across_m, turn_cosine
        )
    return out


@njit(cache=True)
def deep_free(classes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Where cells (h, w) and all their eight neighbours are free: 1, elsewhere 0.

    At the edge of what beams went through there may be a wall that nobody has made out, as along a corridor.
    """
    height, width = classes.shape
    out = np.zeros((height, width), np.uint8)
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            free = True
            for j in range(y - 1, y + 2):
                for i in range(x - 1, x + 2):
                    free = free and classes[j, i] == FREE
            out[y, x] = FREE if free else 0
    return out
