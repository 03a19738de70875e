"""Where the robot was and where its beams ended: a bounded sample that travels with the layer."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Points, Rays, Transform
from mapgraft_grid.kernels import sketch
from mapgraft_grid.kernels.tile_keys import TILE, tile_key, tile_x, tile_y
from mapgraft_grid.parameters import CELL_LIMIT, Lattice, TraceLimits
from mapgraft_grid.tiles import TileIndex, TileKeys, enlarged

YAW_STEPS_PER_RAD: Final = 1 << 20
_SIDE: Final = TILE * sketch.STEPS_PER_CELL  # of a tile, in steps

Path = NDArray[np.float64]  # (n, 3) x, y (m), yaw (rad) of the body in the layer's frame, in the order driven
RayRows = NDArray[np.int32]  # (n, 5) columns as in kernels.sketch


class Pose(NamedTuple):
    """One kept pose: the observation it belongs to, position in 1/256 cell, yaw in 2⁻²⁰ rad."""

    number: int
    x: int
    y: int
    yaw: int


class Traces:
    """The path and the ray end points of one layer.

    Each tile keeps at most ``limits.rays_per_tile`` rays and ``limits.poses_per_tile`` poses, those with the lowest
    hash, so that memory grows with the explored area and not with time.
    """

    __slots__ = ("_highest", "_index", "_kept", "_poses", "_ranks", "_rays", "last", "limits")

    def __init__(self, limits: TraceLimits) -> None:
        self.limits = limits
        self.last: Pose | None = None  # the newest pose, against which the next is measured
        self._index = TileIndex()
        self._poses: dict[int, list[Pose]] = {}
        self._kept = np.zeros(0, np.int32)
        self._highest = np.zeros(0, np.uint64)
        self._ranks = np.zeros((0, limits.rays_per_tile), np.uint64)
        self._rays = np.zeros((0, limits.rays_per_tile, 5), np.int32)

    def add_pose(self, T_map_base: Transform, number: int, lattice: Lattice) -> None:
        """Note where the body was at observation ``number``, unless it has hardly moved since the last pose kept.

        Raises MapError when it was nowhere.
        """
        if not self.limits.poses_per_tile:
            return
        steps = sketch.STEPS_PER_CELL / lattice.resolution_m
        matrix = T_map_base.matrix
        if not abs(matrix.item(0, 3)) + abs(matrix.item(1, 3)) < CELL_LIMIT * lattice.resolution_m:
            raise MapError(f"a robot was at {T_map_base}, beyond ±{CELL_LIMIT} cells or not finite: check its pose")
        x = math.floor((matrix.item(0, 3) - lattice.anchor_m[0]) * steps)
        y = math.floor((matrix.item(1, 3) - lattice.anchor_m[1]) * steps)
        yaw = round(math.atan2(matrix.item(1, 0), matrix.item(0, 0)) * YAW_STEPS_PER_RAD)
        if self.last is not None:
            turned = math.remainder((yaw - self.last.yaw) / YAW_STEPS_PER_RAD, math.tau)
            moved = math.hypot(x - self.last.x, y - self.last.y)
            if moved < self.limits.path_step_m * steps and abs(turned) < self.limits.path_step_rad:
                return
        self.last = Pose(number, x, y, yaw)
        self.insert_pose(self.last)

    def insert_pose(self, pose: Pose) -> None:
        """Keep one pose, or drop the one of highest rank when its tile is full."""
        here = self._poses.setdefault(tile_key(pose.x // _SIDE, pose.y // _SIDE), [])
        here.append(pose)
        if len(here) > self.limits.poses_per_tile:
            here.remove(max(here, key=_rank))

    def insert_rays(self, keys: TileKeys, rays: RayRows) -> None:
        """Offer rays (n, 5) that end in the tiles ``keys`` (n,)."""
        slots = self._index.claim(keys)
        if self._index.capacity > self._kept.size:
            self._grow(self._index.capacity)
        sketch.keep(keys, slots, rays, self._kept, self._highest, self._ranks, self._rays)

    @property
    def has_rays(self) -> bool:
        return bool(self._kept.any())

    def poses(self) -> list[Pose]:
        """All kept poses in the order driven."""
        return sorted(pose for here in self._poses.values() for pose in here)

    def ray_rows(self) -> tuple[TileKeys, RayRows]:
        """All kept rays, by tile and then by content: their tiles' keys (n,) and rows (n, 5)."""
        slots = np.repeat(np.arange(len(self._index)), self._kept[: len(self._index)])
        keys = self._index.keys[slots]
        rows = np.concatenate([self._rays[s, : self._kept[s]] for s in range(len(self._index))] or [_NO_RAYS])
        order = np.lexsort((*rows.T[::-1], keys))
        return keys[order], rows[order]

    def path(self, lattice: Lattice) -> Path:
        steps = np.array(self.poses(), np.int64).reshape(-1, 4)
        return np.column_stack((_metres(steps[:, 1:3], lattice), steps[:, 3] / YAW_STEPS_PER_RAD))

    def rays(self, lattice: Lattice) -> Rays:
        """The kept rays in metres: origins (n, 2), ends (n, 2), hits (n,)."""
        keys, rows = self.ray_rows()
        corners = np.array([(tile_x(key), tile_y(key)) for key in keys.tolist()], np.int64).reshape(-1, 2) * _SIDE
        ends = _metres(corners + rows[:, :2], lattice)
        origins = _metres(corners + rows[:, 2:4], lattice)
        return Rays(origins, ends, rows[:, sketch.HIT] > 0)

    def _grow(self, capacity: int) -> None:
        self._kept = enlarged(self._kept, capacity)
        self._highest = enlarged(self._highest, capacity)
        self._ranks = enlarged(self._ranks, capacity)
        self._rays = enlarged(self._rays, capacity)


_NO_RAYS: Final = np.empty((0, 5), np.int32)


def _metres(steps: NDArray[np.int64], lattice: Lattice) -> Points:
    """The middle of steps (n, 2) of 1/256 cell, in metres."""
    metres: Points = (steps + 0.5) * (lattice.resolution_m / sketch.STEPS_PER_CELL) + np.array(lattice.anchor_m)
    return metres


def _rank(pose: Pose) -> int:
    """A hash of the observation's number, so that what stays is spread over time (Knuth's multiplicative hash)."""
    return (pose.number * 0x9E3779B97F4A7C15) & 0xFFFFFFFFFFFFFFFF
