"""Simulated missions for the scripts beside this one: random floors, robots that drive about, lidars of their own."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import SCAN, Observation, Scan, Transform
from mapgraft_grid.grid_map import DenseGrid, GridMap
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_recordings.simulator import cast_fan, distance_to_walls, unit_vectors

Segments = NDArray[np.float64]  # (m, 4) x_a, y_a, x_b, y_b in metres


def floor_plan(rng: np.random.Generator) -> Segments:
    """A rectangle of rooms with doors and furniture."""
    width, height = 24.0, 16.0
    thickness = rng.uniform(0.08, 0.2)
    boxes: list[NDArray[np.float64]] = [
        _box(0, 0, width, thickness),
        _box(0, height - thickness, width, thickness),
        _box(0, 0, thickness, height),
        _box(width - thickness, 0, thickness, height),
    ]
    rooms = [(0.0, 0.0, width, height)]
    while rooms:
        x, y, w, h = rooms.pop()
        if max(w, h) < 5.0 or (max(w, h) < 9.0 and rng.random() < 0.3):
            boxes += _furniture(x, y, w, h, rng)
            continue
        cut = rng.uniform(0.35, 0.65) * max(w, h)
        boxes += _wall(x, y, w, h, cut, thickness, rng)
        if w > h:
            rooms += [(x, y, cut, h), (x + cut, y, w - cut, h)]
        else:
            rooms += [(x, y, w, cut), (x, y + cut, w, h - cut)]
    return np.vstack([np.hstack((box, np.roll(box, -1, axis=0))) for box in boxes])


def _box(x: float, y: float, w: float, h: float) -> NDArray[np.float64]:
    return np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]])


def _wall(
    x: float, y: float, w: float, h: float, cut: float, thickness: float, rng: np.random.Generator
) -> list[NDArray[np.float64]]:
    """A wall across the longer side with one or two doors, as the boxes between them."""
    length = h if w > h else w
    doors = np.sort(rng.uniform(0.3, length - 1.5, rng.integers(1, 3)))
    starts, ends = np.append(0.0, doors + rng.uniform(0.9, 1.2)), np.append(doors, length)
    pieces = [(a, b) for a, b in zip(starts, ends, strict=True) if b > a]
    if w > h:
        return [_box(x + cut, y + a, thickness, b - a) for a, b in pieces]
    return [_box(x + a, y + cut, b - a, thickness) for a, b in pieces]


def _furniture(x: float, y: float, w: float, h: float, rng: np.random.Generator) -> list[NDArray[np.float64]]:
    out = []
    for _ in range(rng.integers(0, 6)):
        size = rng.uniform(0.05, 0.5, 2)
        corners = int(rng.choice([4, 12]))
        bearing = 2 * math.pi * np.arange(corners) / corners + rng.choice([math.pi / 4, rng.uniform(0, math.pi)])
        middle = np.array([rng.uniform(x + 0.5, x + w - 0.5), rng.uniform(y + 0.5, y + h - 0.5)])
        out.append(middle + size * np.stack((np.cos(bearing), np.sin(bearing)), axis=1))
    return out


def missions(rng: np.random.Generator, count: int = 1, scans: int = 100) -> list[list[Observation]]:
    """Robots that drive about on one floor, all in one map frame, turned at random; their poses are true."""
    segments = floor_plan(rng)
    turn = Transform.planar(0.0, 0.0, rng.uniform(0.0, 2.0 * math.pi))
    return [in_frame(turn, _mission(segments, rng, scans)) for _ in range(count)]


def in_frame(T_map_world: Transform, observations: Iterable[Observation]) -> list[Observation]:
    """The same observations with poses in another map frame."""
    return [
        dataclasses.replace(o, T_map_sensor=T_map_world @ o.T_map_sensor, T_map_base=T_map_world @ o.T_map_base)
        for o in observations
    ]


def _mission(segments: Segments, rng: np.random.Generator, scans: int) -> Iterator[Observation]:
    """A robot that starts somewhere and drives to and fro, with a lidar of its own."""
    beams, view = int(rng.choice([180, 360])), math.radians(float(rng.choice([180, 270])))
    reach_m = float(rng.choice([8.0, 20.0]))
    angles = np.linspace(-view / 2, view / 2, beams)
    directions = unit_vectors(angles)
    for number, (x, y, yaw) in enumerate(_drive(segments, rng, scans)):
        ranges = _look(segments, x, y, yaw, angles, reach_m)
        hits = np.isfinite(ranges)
        ranges = np.where(hits, ranges + rng.normal(0.0, 0.01, beams), reach_m).astype(np.float32)
        pose = Transform.planar(x, y, yaw)
        yield Observation("r", number, number, "scan", SCAN, Scan(directions, ranges, hits), pose, pose)


def _look(
    segments: Segments, x: float, y: float, yaw: float, angles: NDArray[np.float64], reach_m: float
) -> NDArray[np.float64]:
    bearings = yaw + angles
    return cast_fan(x, y, float(bearings[0]), float(angles[1] - angles[0]), unit_vectors(bearings), segments, reach_m)


def _drive(segments: Segments, rng: np.random.Generator, scans: int) -> Iterator[tuple[float, float, float]]:
    """Poses 0.25 m apart along straight ways; long open directions are taken more often."""
    around = np.linspace(-math.pi, math.pi, 72, endpoint=False)
    x, y = _start(segments, rng)
    left = scans
    while left:
        free = np.nan_to_num(_look(segments, x, y, 0.0, around, 30.0), posinf=0.0)
        room = np.clip(np.minimum(free, np.roll(free, 1)) - 0.6, 0.0, 8.0) ** 2 + 1e-9
        yaw = float(rng.choice(around, p=room / room.sum()))
        for _ in range(int(rng.uniform(3, 25))):
            ahead = np.array([[x + 0.25 * math.cos(yaw), y + 0.25 * math.sin(yaw)]])
            if not left or distance_to_walls(ahead, segments)[0] < 0.35:
                break
            x, y = ahead[0].tolist()
            left -= 1
            yield x, y, yaw


def _start(segments: Segments, rng: np.random.Generator) -> tuple[float, float]:
    """A place in the middle half of the floor, away from walls and with a view: not inside a piece of furniture."""
    low, high = segments.reshape(-1, 2).min(axis=0), segments.reshape(-1, 2).max(axis=0)
    while True:
        x, y = (low + (high - low) * rng.uniform(0.25, 0.75, 2)).tolist()
        sight = _look(segments, x, y, 0.0, np.linspace(-math.pi, math.pi, 36, endpoint=False), 30.0)
        if distance_to_walls(np.array([[x, y]]), segments)[0] >= 0.4 and sight.max() > 3.0:
            return x, y


def map_of(observations: Iterable[Observation], resolution_m: float) -> tuple[OccupancyGrid, GridLayer, GridMap]:
    grids = OccupancyGrid(resolution_m=resolution_m)
    layer = grids.new_layer()
    for observation in observations:
        grids.integrate(layer, observation)
    return grids, layer, grids.view(layer)


def grid_of(observations: Iterable[Observation], resolution_m: float) -> DenseGrid:
    return map_of(observations, resolution_m)[2].dense()
