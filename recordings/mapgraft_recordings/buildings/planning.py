"""Where a robot can drive in a building, and the best way from one place to another."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_recordings.buildings.shapes import Outline, Segments

_CELL_M = 0.1
_SUBCELL_BITS = 8
_MARGIN_M = 1.0
_COMFORT_M = 0.8  # closer to walls than this a way costs more


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A floor as cells of 0.1 m: ``clearance_m`` (h, w) to the nearest thing, ``open_to_drive`` (h, w) bool."""

    origin_m: tuple[float, float]
    clearance_m: NDArray[np.float32]
    open_to_drive: NDArray[np.bool_]

    def cell(self, x_m: float, y_m: float) -> tuple[int, int]:
        """(row, column) of a place."""
        return int((y_m - self.origin_m[1]) / _CELL_M), int((x_m - self.origin_m[0]) / _CELL_M)

    def places(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Middles (n, 2) x, y of cells (n, 2) row, column."""
        middles: NDArray[np.float64] = (cells[:, ::-1] + 0.5).astype(np.float64) * _CELL_M + np.array(self.origin_m)
        return middles

    def clearance_at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance (n,) of points (n, 2) on the floor to the nearest thing, to about a cell."""
        columns = np.clip(((points[:, 0] - self.origin_m[0]) / _CELL_M).astype(int), 0, self.clearance_m.shape[1] - 1)
        rows = np.clip(((points[:, 1] - self.origin_m[1]) / _CELL_M).astype(int), 0, self.clearance_m.shape[0] - 1)
        distances: NDArray[np.float64] = self.clearance_m[rows, columns].astype(np.float64)
        return distances


def ground(segments: Segments, rooms: Iterable[Outline], robot_m: float) -> Ground:
    """The ground between segments (m, 4) within rooms, for a robot of radius ``robot_m``."""
    outlines = list(rooms)
    corners = np.vstack(outlines)
    low, high = corners.min(axis=0) - _MARGIN_M, corners.max(axis=0) + _MARGIN_M
    width, height = np.ceil((high - low) / _CELL_M).astype(int).tolist()
    inside = np.zeros((height, width), np.uint8)
    cv2.fillPoly(inside, [_pixels(outline, low) for outline in outlines], 255, cv2.LINE_8, _SUBCELL_BITS)
    free = np.full((height, width), 255, np.uint8)
    lines = [_pixels(line, low) for line in segments.reshape(-1, 2, 2)]
    cv2.polylines(free, lines, False, 0, 1, cv2.LINE_8, _SUBCELL_BITS)
    clearance = cv2.distanceTransform(free, cv2.DIST_L2, 5) * np.float32(_CELL_M)
    return Ground((float(low[0]), float(low[1])), clearance, (clearance > robot_m) & (inside > 0))


def _pixels(points: NDArray[np.float64], low: NDArray[np.float64]) -> NDArray[np.int32]:
    scaled = ((points - low) / _CELL_M - 0.5) * (1 << _SUBCELL_BITS)
    return np.round(scaled).astype(np.int32).reshape(-1, 1, 2)


def largest_part(floor: Ground) -> NDArray[np.bool_]:
    """The largest connected piece of ground that is open to drive (h, w)."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(floor.open_to_drive.astype(np.uint8), connectivity=4)
    if len(stats) < 2:
        return np.zeros_like(floor.open_to_drive)
    largest: NDArray[np.bool_] = labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    return largest


def ways_from(floor: Ground, start: tuple[int, int], limit_m: float) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Cost (h, w) in metres of the best way from a cell to all others, inf beyond ``limit_m``, and their parents."""
    return _spread(floor.open_to_drive, floor.clearance_m, start[0], start[1], limit_m)


def way_to(parents: NDArray[np.int32], goal: tuple[int, int]) -> NDArray[np.int64]:
    """The cells (n, 2) row, column from the start to ``goal``, both included."""
    width = parents.shape[1]
    flat, found = parents.ravel(), []
    at = goal[0] * width + goal[1]
    while at >= 0:
        found.append(divmod(at, width))
        at = int(flat[at])
    return np.array(found[::-1])


@njit(cache=True)
def _spread(
    free: NDArray[np.bool_], clearance: NDArray[np.float32], row: int, column: int, limit: float
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Dijkstra's algorithm over eight neighbours; steps near walls cost up to four times their length."""
    height, width = free.shape
    cost = np.full((height, width), np.inf, np.float32)
    parent = np.full((height, width), -1, np.int32)
    cost[row, column] = 0.0
    heap = [(np.float32(0.0), np.int32(row * width + column))]
    while len(heap) > 0:
        so_far, at = heapq.heappop(heap)
        r, c = at // width, at % width
        if so_far > cost[r, c]:
            continue
        if so_far > limit:
            break
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                nr, nc = r + dr, c + dc
                if (dr == 0 and dc == 0) or nr < 0 or nc < 0 or nr >= height or nc >= width or not free[nr, nc]:
                    continue
                narrow = max(0.0, _COMFORT_M - clearance[nr, nc]) / _COMFORT_M
                step = _CELL_M * math.sqrt(float(dr * dr + dc * dc)) * (1.0 + 4.0 * narrow * narrow)
                total = np.float32(so_far + step)
                if total < cost[nr, nc]:
                    cost[nr, nc] = total
                    parent[nr, nc] = np.int32(at)
                    heapq.heappush(heap, (total, np.int32(nr * width + nc)))
    return cost, parent
