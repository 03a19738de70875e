"""The search of the correlation matcher: all rotations and shifts on coarse cells, then the best on ever finer ones."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from mapgraft.contracts import Points
from mapgraft_grid.bayes import WEIGHTS
from mapgraft_grid.kernels.correlating import climb, fields, multiply, peaks, splat
from mapgraft_grid.prepared import Prepared

COARSE_M: Final = 0.4
CELLS_ACROSS: Final = 260  # of both maps together on the coarse level, about
STEP_CELLS: Final = 2.0  # coarse cells by which a step of rotation moves the farthest point
RING: Final = 0.5
KEPT: Final = (400, 100, 40)
PER_YAW: Final = 12
COARSE_FREE: Final = 4000
FINE_FREE: Final = 1200
FINE_WALLS: Final = 1200
BATCH: Final = 8

Poses = NDArray[np.float64]  # (k, 4) where the source's centre lies (x, y in m from the target's corner), yaw, score


class Level(NamedTuple):
    """The target's fields on cells of one size."""

    unit_m: float
    on_wall: NDArray[np.float32]
    on_free: NDArray[np.float32]


def level(target: Prepared, factor: int) -> Level:
    key = ("level", factor)
    if key not in target.kept:
        on = fields(
            target.marks, factor, np.ascontiguousarray(WEIGHTS[:, 2]), np.ascontiguousarray(WEIGHTS[:, 1]), RING
        )
        target.kept[key] = Level(factor * target.unit_m, *on)
    found = target.kept[key]
    assert isinstance(found, Level)
    return found


def thinned(points: Points, most: int) -> tuple[Points, float]:
    """About ``most`` of the points at most, evenly, and how many each stands for."""
    step = max(1, -(-len(points) // most))
    some = np.ascontiguousarray(points[step // 2 :: step])
    return some, len(points) / max(1, len(some))


def coarse_factor(target: Prepared, source: Prepared) -> int:
    across = max(target.classes.shape) * target.unit_m + 2.0 * source.radius_m
    finest = max(COARSE_M, across / CELLS_ACROSS)
    return int(2 ** round(math.log2(finest / target.unit_m)))


def search(target: Prepared, source: Prepared) -> Poses:
    factor = coarse_factor(target, source)
    poses, step = everywhere(target, source, factor)
    kept = list(KEPT)
    walls, wall_weight = thinned(source.walls - source.centre_m, FINE_WALLS)
    free, weight = thinned(source.free - source.centre_m, FINE_FREE)
    while factor > 1:
        poses = poses[: kept[0]] if len(kept) else poses[:40]
        kept = kept[1:]
        factor //= 2
        step /= 2
        fine = level(target, factor)
        poses = climb(
            fine.on_wall, fine.on_free, fine.unit_m, walls, free, weight / wall_weight, poses[:, :3].copy(), step, 1, 1
        )
        poses = distinct(poses[np.argsort(-poses[:, 3], kind="stable")], fine.unit_m, step)
    return poses[: kept[0]] if kept else poses[:40]


def everywhere(target: Prepared, source: Prepared, factor: int) -> tuple[Poses, float]:
    coarse = level(target, factor)
    unit = coarse.unit_m
    reach = math.ceil(source.radius_m / unit) + 1
    height, width = (scipy.fft.next_fast_len(n + 2 * reach, real=True) for n in coarse.on_wall.shape)
    quarter = max(8, math.ceil(math.pi * source.radius_m / (STEP_CELLS * unit)))
    yaws = math.pi / quarter * np.arange(quarter)
    walls, _ = thinned(source.walls - source.centre_m, 4000)
    free, weight = thinned(source.free - source.centre_m, COARSE_FREE)
    still = scipy.fft.rfft2(np.stack((coarse.on_wall, coarse.on_free)), (height, width))
    found: list[NDArray[np.float64]] = []
    for first in range(0, quarter, BATCH):
        part = yaws[first : first + BATCH]
        grids = np.zeros((2, part.size, height, width), np.float32)
        splat(walls, 1.0, part, unit, grids[0])
        splat(free, weight, part, unit, grids[1])
        turned = scipy.fft.rfft2(grids)
        cross = np.empty_like(turned)
        multiply(still, turned, cross)
        scores = scipy.fft.irfft2(cross, (height, width))
        for half in range(2):
            for k in range(part.size):
                places, values = peaks(scores[half, k], PER_YAW, 0.0)
                n = len(values)
                if n:
                    y = np.where(places[:, 0] >= coarse.on_wall.shape[0] + reach, places[:, 0] - height, places[:, 0])
                    x = np.where(places[:, 1] >= coarse.on_wall.shape[1] + reach, places[:, 1] - width, places[:, 1])
                    found.append(
                        np.column_stack(
                            ((x + 0.5) * unit, (y + 0.5) * unit, np.full(n, part[k] + half * math.pi), values)
                        )
                    )
    poses = np.concatenate(found)
    poses = poses[np.argsort(-poses[:, 3], kind="stable")]
    return poses, math.pi / quarter


def distinct(poses: Poses, apart_m: float, apart_rad: float) -> Poses:
    """The poses, best first, without those that repeat a better one."""
    cells = np.round(poses[:, :3] / np.array([apart_m, apart_m, apart_rad])).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return poses[np.sort(first)]
