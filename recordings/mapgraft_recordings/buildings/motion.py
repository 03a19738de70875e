"""How a robot moves through a building: where it goes next, along which line, and how it turns."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft_recordings.buildings.planning import Ground, largest_part, way_to, ways_from

Poses = NDArray[np.float64]  # (n, 3) x, y in metres, yaw in radians

_STEP_M = 0.1
_TURN_STEP_RAD = math.radians(3.0)
_SIGHT_M = 35.0
_CANDIDATES = 12
_SHORTEST_M = 2.5
_NEAR_M = 4.0  # places nearer to where the robot stopped before are not new
_TIGHT_M = 0.16  # a smoothed way must stay that far from everything


@dataclass(frozen=True, slots=True)
class Habits:
    """How one robot is driven: ``hop_m`` is how far it likes to go at once, ``looks`` the share of stops at which it
    turns on the spot, ``returns`` how readily it goes back to where it was.
    """

    robot_m: float
    hop_m: float
    looks: float
    returns: float
    sway_m: float
    smoothing_m: float


def draw_habits(rng: np.random.Generator) -> Habits:
    return Habits(
        robot_m=float(rng.uniform(0.22, 0.32)),
        hop_m=float(rng.uniform(5.0, 20.0)),
        looks=float(rng.uniform(0.05, 0.5)),
        returns=float(rng.uniform(0.01, 0.3)),
        sway_m=float(rng.uniform(0.0, 0.12)),
        smoothing_m=float(rng.uniform(0.15, 0.6)),
    )


class Wanderer:
    """A robot that goes from place to place; ``at`` is its true pose, None before it was put anywhere."""

    def __init__(self, rooms: list[NDArray[np.float64]], habits: Habits, rng: np.random.Generator) -> None:
        self.at: tuple[float, float, float] | None = None
        self._rooms = rooms
        self._habits = habits
        self._rng = rng
        self._been: list[tuple[float, float]] = []

    def start(self, floor: Ground) -> bool:
        """Put the robot on the largest drivable piece of ground; False where there is none."""
        cells = np.argwhere(largest_part(floor))
        if len(cells) < 10:
            return False
        x, y = floor.places(cells[self._rng.integers(len(cells), size=1)])[0].tolist()
        self.at = (x, y, float(self._rng.uniform(-math.pi, math.pi)))
        return True

    def fits(self, floor: Ground) -> bool:
        """Whether the robot stands on the largest drivable piece of ground: neither touched nor shut in."""
        assert self.at is not None
        cell = _nearest_open(floor, floor.cell(*self.at[:2]))
        return (
            cell is not None
            and bool(largest_part(floor)[cell])
            and bool(floor.clearance_m[floor.cell(*self.at[:2])] > _TIGHT_M)
        )

    def hop(self, floor: Ground) -> Iterator[tuple[float, float, float]]:
        """The poses on the way to the next place, and while looking around there; none where the robot is shut in."""
        assert self.at is not None
        x, y, _ = self.at
        start = _nearest_open(floor, floor.cell(x, y))
        if start is None:
            return
        cost, parents = ways_from(floor, start, _SIGHT_M)
        goal = self._goal(floor, cost)
        if goal is None:
            return
        way = floor.places(way_to(parents, goal))
        way[0] = x, y
        for pose in self._along(_smoothed(way, floor, self._habits.smoothing_m)):
            yield self._move(pose)
        self._been.append(self.at[:2])
        if self._rng.random() < self._habits.looks:
            angle = float(self._rng.choice([math.pi / 2, math.pi, 2.0 * math.pi])) * float(self._rng.uniform(0.6, 1.1))
            for pose in self._turning(self.at[2] + angle * float(self._rng.choice([-1.0, 1.0]))):
                yield self._move(pose)

    def _move(self, pose: tuple[float, float, float]) -> tuple[float, float, float]:
        self.at = pose
        return pose

    def _goal(self, floor: Ground, cost: NDArray[np.float32]) -> tuple[int, int] | None:
        """A reachable place in some room: near ones and new ones rather than others."""
        places, weights = [], []
        for k in self._rng.permutation(len(self._rooms))[: 3 * _CANDIDATES].tolist():
            room = self._rooms[k]
            low, high = room.min(axis=0), room.max(axis=0)
            x, y = self._rng.uniform(low, high).tolist()
            cell = floor.cell(x, y)
            if not math.isfinite(cost[cell]) or cost[cell] < _SHORTEST_M:
                continue
            familiar = sum(math.hypot(x - a, y - b) < _NEAR_M for a, b in self._been)
            places.append(cell)
            weights.append(math.exp(-float(cost[cell]) / self._habits.hop_m) * self._habits.returns ** min(familiar, 3))
            if len(places) == _CANDIDATES:
                break
        if not places:
            cells = np.argwhere(np.isfinite(cost) & (cost > 0.3))
            return None if not len(cells) else tuple(cells[self._rng.integers(len(cells))].tolist())
        chances = np.array(weights) + 1e-12
        return places[int(self._rng.choice(len(places), p=chances / chances.sum()))]

    def _along(self, line: NDArray[np.float64]) -> Iterator[tuple[float, float, float]]:
        """Poses along a line (n, 2), turning on the spot before it and at its sharp corners."""
        if len(line) < 2:
            return
        ahead = np.diff(line, axis=0)
        headings = np.arctan2(ahead[:, 1], ahead[:, 0])
        sway = _sway(len(headings), self._habits.sway_m, self._rng)
        for (x, y), heading, aside in zip(line[:-1].tolist(), headings.tolist(), sway.tolist(), strict=True):
            assert self.at is not None
            if abs(math.remainder(heading - self.at[2], 2.0 * math.pi)) > math.radians(25.0):
                yield from self._turning(heading)
            yield x, y, heading + aside
        yield float(line[-1, 0]), float(line[-1, 1]), float(headings[-1])

    def _turning(self, target_rad: float) -> Iterator[tuple[float, float, float]]:
        assert self.at is not None
        x, y, yaw = self.at
        turn = target_rad - yaw
        if abs(turn) < math.pi:
            turn = math.remainder(turn, 2.0 * math.pi)
        steps = max(1, math.ceil(abs(turn) / _TURN_STEP_RAD))
        for k in range(1, steps + 1):
            yield x, y, yaw + turn * k / steps


def _sway(count: int, sway_m: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Small slow deviations of the heading, radians (count,), such as steering leaves."""
    noise = rng.normal(0.0, 1.0, count + 20)
    return np.convolve(noise, np.full(21, 1.0 / math.sqrt(21.0)), mode="valid")[:count] * sway_m


def _nearest_open(floor: Ground, cell: tuple[int, int]) -> tuple[int, int] | None:
    """The cell itself, or the nearest within 0.6 m that is open to drive: a robot may stand closer than it drives."""
    if floor.open_to_drive[cell]:
        return cell
    row, column = cell
    around = np.argwhere(floor.open_to_drive[max(row - 6, 0) : row + 7, max(column - 6, 0) : column + 7])
    if not len(around):
        return None
    around += (max(row - 6, 0), max(column - 6, 0))
    nearest = around[int(np.argmin(np.hypot(*(around - cell).T)))]
    return int(nearest[0]), int(nearest[1])


def _smoothed(way: NDArray[np.float64], floor: Ground, sigma_m: float) -> NDArray[np.float64]:
    """The way without the stairs of its cells, resampled every 0.1 m; as smooth as the walls allow."""
    for sigma in (sigma_m, sigma_m / 2, 0.1):
        line = _resampled(_averaged(way, sigma))
        if floor.clearance_at(line[3:-3]).min(initial=np.inf) > _TIGHT_M:
            return line
    return _resampled(way)


def _averaged(way: NDArray[np.float64], sigma_m: float) -> NDArray[np.float64]:
    reach = max(1, round(3.0 * sigma_m / _STEP_M))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * _STEP_M / sigma_m) ** 2)
    kernel /= kernel.sum()
    padded = np.pad(way, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd") if len(way) > reach else None
    if padded is None:
        return way
    return np.stack([np.convolve(padded[:, i], kernel, mode="valid") for i in range(2)], axis=1)


def _resampled(way: NDArray[np.float64]) -> NDArray[np.float64]:
    done = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))))
    keep = np.concatenate(([True], np.diff(done) > 1e-9))
    way, done = way[keep], done[keep]
    at = np.arange(0.0, done[-1], _STEP_M) if len(done) > 1 else np.zeros(1)
    return np.stack([np.interp(at, done, way[:, i]) for i in range(2)], axis=1)
