"""Little rooms without symmetry, and what a sensor sees in them: ready observations to try laws on."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Cloud, GridMessage, Points, Scan, Transform

BEAMS: Final = 180
REACH_M: Final = 12.0
GRID_M: Final = 0.1
_MARGIN: Final = 5  # cells around a ready-made map
_POST_CORNERS: Final = 8
_STEP: Final = 0.5  # of the width
_ABOVE_THE_STEP, _BY_THE_STEP = (30, 48), (46, 48)  # hundredths of the width
_LOWER_M: Final = 2.2  # a flight of stairs: the height of a person above it lies below the upper floor
_SLOPES: Final = (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)  # of the rings of a spinning lidar, up per way
_FLOOR_M, _CEILING_M = -1.0, 2.0  # seen from it


@dataclass(frozen=True, slots=True)
class Room:
    """An L-shaped room, its corner in the origin, with an inner wall and round posts; lengths in metres.

    ``wide`` × ``deep`` without the corner ``notch`` (across, up) at the upper right. ``posts`` (x, y, radius). Beyond
    ``step_x`` the floor lies ``lower`` deeper; walls and posts reach down to it.
    """

    wide: float
    deep: float
    notch: tuple[float, float]
    posts: tuple[tuple[float, float, float], ...]
    lower: float = 0.0

    def __str__(self) -> str:
        levels = f", a part of it {self.lower:g} m lower" if self.lower else ""
        return f"a room of {self.wide:g} × {self.deep:g} m with {len(self.posts)} posts{levels}"

    @property
    def step_x(self) -> float:
        """Where the floor steps down: right of all places from which a robot looks."""
        return _STEP * self.wide

    @property
    def corners(self) -> list[tuple[float, float]]:
        """The outline, counter-clockwise."""
        x, y = self.wide - self.notch[0], self.deep - self.notch[1]
        return [(0.0, 0.0), (self.wide, 0.0), (self.wide, y), (x, y), (x, self.deep), (0.0, self.deep)]

    def segments(self) -> NDArray[np.float64]:
        """All that stands: (n, 4) x0, y0, x1, y1."""
        ring = self.corners
        lines = [(*a, *b) for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)]
        lines.append((0.0, self.deep * 0.6, self.wide * 0.25, self.deep * 0.6))  # the inner wall
        for x, y, radius in self.posts:
            turn = np.arange(_POST_CORNERS + 1) * math.tau / _POST_CORNERS
            px, py = x + radius * np.cos(turn), y + radius * np.sin(turn)
            lines += list(zip(px[:-1], py[:-1], px[1:], py[1:], strict=True))
        return np.array(lines)

    def inside(self, points: Points) -> NDArray[np.bool_]:
        """Which points (n, 2) lie within the outline."""
        x, y = points.T
        notched = (x > self.wide - self.notch[0]) & (y > self.deep - self.notch[1])
        inner: NDArray[np.bool_] = (x > 0) & (y > 0) & (x < self.wide) & (y < self.deep) & ~notched
        return inner


def look(room: Room, x: float, y: float, yaw: float) -> Scan:
    """A full circle of beams from a pose in the room."""
    bearings = -math.pi + math.tau * np.arange(BEAMS) / BEAMS
    directions = np.stack((np.cos(bearings + yaw), np.sin(bearings + yaw)), axis=1)
    ranges = distances(room.segments(), np.array([x, y]), directions)
    hits = ranges < REACH_M
    beams = np.stack((np.cos(bearings), np.sin(bearings)), axis=1)
    return Scan(beams, np.minimum(ranges, REACH_M).astype(np.float32), hits)


def sweep(room: Room, x: float, y: float, yaw: float) -> Cloud:
    """One turn of a lidar with seven rings: walls, floor and ceiling."""
    bearings = math.tau * np.arange(BEAMS) / BEAMS
    directions = np.stack((np.cos(bearings + yaw), np.sin(bearings + yaw)), axis=1)
    away = distances(room.segments(), np.array([x, y]), directions)
    beams = np.stack((np.cos(bearings), np.sin(bearings)), axis=1)
    points = []
    for slope in _SLOPES:
        ways = np.minimum(away, np.inf if slope == 0.0 else (_CEILING_M if slope > 0 else _FLOOR_M) / slope)
        seen = ways < REACH_M
        points.append(np.column_stack((beams * ways[:, None], slope * ways))[seen])
    return Cloud(np.concatenate(points).astype(np.float32))


def distances(
    segments: NDArray[np.float64], origin: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How far each ray (m, 2) goes from the origin until it meets a segment (n, 4): (m,) metres, infinite if never."""
    start, wall = segments[:, :2] - origin, segments[:, 2:] - segments[:, :2]
    across = directions[:, None, 0] * wall[None, :, 1] - directions[:, None, 1] * wall[None, :, 0]
    across[across == 0.0] = 1e-12
    along = (start[:, 0] * wall[:, 1] - start[:, 1] * wall[:, 0])[None] / across
    share = (start[None, :, 0] * directions[:, None, 1] - start[None, :, 1] * directions[:, None, 0]) / across
    met: NDArray[np.float64] = np.where((along > 1e-6) & (share >= 0) & (share <= 1), along, np.inf).min(axis=1)
    return met


def ready_made(room: Room, x: float, y: float, sight_m: float) -> GridMessage:
    """The part of the room's grid that lies within sight of a place: walls, free space, and unknown around it."""
    shape = (round(room.deep / GRID_M) + 2 * _MARGIN, round(room.wide / GRID_M) + 2 * _MARGIN)
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    centres = (np.stack((columns, rows), axis=-1).reshape(-1, 2) - _MARGIN + 0.5) * GRID_M
    cells = np.where(room.inside(centres), 0, -1).astype(np.int8)
    for x0, y0, x1, y1 in room.segments().tolist():
        wall = np.array([x1 - x0, y1 - y0])
        along = np.clip((centres - (x0, y0)) @ wall / max(float(wall @ wall), 1e-12), 0.0, 1.0)
        cells[np.hypot(*(centres - ((x0, y0) + along[:, None] * wall)).T) < 0.75 * GRID_M] = 100
    cells[np.hypot(centres[:, 0] - x, centres[:, 1] - y) > sight_m] = -1
    origin = Transform.planar(-_MARGIN * GRID_M, -_MARGIN * GRID_M, 0.0)
    return GridMessage(cells.reshape(shape), GRID_M, origin)


@st.composite
def rooms(draw: st.DrawFn) -> Room:
    """Rooms of 4 to 9 metres with up to six posts, none of them symmetrical."""
    wide, deep = draw(st.integers(40, 90)) / 10.0, draw(st.integers(35, 60)) / 10.0
    notch = (wide * draw(st.integers(2, 4)) / 10.0, deep * draw(st.integers(2, 4)) / 10.0)
    slots = [(0.15, 0.2), (0.7, 0.25), (0.4, 0.35), (0.3, 0.8), (0.55, 0.55), (0.85, 0.4)]
    chosen = slots[: draw(st.integers(0, 6))]
    posts = tuple((wide * u, deep * v, 0.08 + 0.03 * (n % 3)) for n, (u, v) in enumerate(chosen))
    return Room(wide, deep, notch, posts)


@st.composite
def stepped(draw: st.DrawFn) -> Room:
    """The same, in some of them a part of the floor lower than where a robot stands."""
    return dataclasses.replace(draw(rooms()), lower=draw(st.sampled_from((0.0, _LOWER_M))))


@st.composite
def poses(draw: st.DrawFn, room: Room, least: int, most: int) -> list[tuple[float, float, float]]:
    """Places in the middle of the lower part of a room, with any heading; where its floor steps down all are above the
    step, the last of them so near that one looks down it."""
    count = draw(st.integers(least, most))
    made = []
    for left in reversed(range(count)):
        first, last = (30, 65) if not room.lower else _BY_THE_STEP if left == 0 else _ABOVE_THE_STEP
        across, up, turn = st.integers(first, last), st.integers(10, 50), st.integers(-31, 31)
        made.append((room.wide * draw(across) / 100.0, room.deep * draw(up) / 100.0, draw(turn) / 10.0))
    return made
