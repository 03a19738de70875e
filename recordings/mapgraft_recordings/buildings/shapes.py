"""Outlines of walls and things on a floor, and how a whole floor is bent."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Outline = NDArray[np.float64]  # (k, 2) corners in metres, closed by the edge from the last to the first
Segments = NDArray[np.float64]  # (m, 4) x_a, y_a, x_b, y_b in metres

_PIECE_M = 0.7  # longest straight piece of a bent wall: 3 mm off the arc at a radius of 20 m
_CENTRE_LINE_M = 0.25


def box(x_m: float, y_m: float, length_m: float, width_m: float, yaw_rad: float = 0.0) -> Outline:
    """A box around a middle."""
    half = np.array([[-length_m, -width_m], [length_m, -width_m], [length_m, width_m], [-length_m, width_m]]) / 2
    outline: Outline = turned(half, yaw_rad) + np.array((x_m, y_m))
    return outline


def disc(x_m: float, y_m: float, radius_m: float, corners: int = 8) -> Outline:
    """A round thing as a regular polygon."""
    bearing = 2.0 * math.pi * np.arange(corners) / corners
    outline: Outline = np.stack((np.cos(bearing), np.sin(bearing)), axis=1) * radius_m + (x_m, y_m)
    return outline


def turned(points: NDArray[np.float64], yaw_rad: float) -> NDArray[np.float64]:
    """Points (n, 2) turned about the origin."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    rotated: NDArray[np.float64] = points @ np.array([[c, s], [-s, c]])
    return rotated


def edges(outlines: Iterable[Outline]) -> Segments:
    """The edges of closed outlines as (m, 4)."""
    found = [np.hstack((outline, np.roll(outline, -1, axis=0))) for outline in outlines]
    return np.ascontiguousarray(np.vstack(found)) if found else np.empty((0, 4))


def in_pieces(outline: Outline, longest_m: float = _PIECE_M) -> Outline:
    """The same outline with corners added, so that no edge is longer than ``longest_m``."""
    after = np.roll(outline, -1, axis=0)
    counts = np.maximum(1, np.ceil(np.hypot(*(after - outline).T) / longest_m).astype(int))
    pieces = [
        a + (b - a) * (np.arange(count) / count)[:, None] for a, b, count in zip(outline, after, counts, strict=True)
    ]
    return np.vstack(pieces)


@dataclass(frozen=True, slots=True, eq=False)
class Bend:
    """How a floor drawn with right angles lies in the building's frame: its x axis follows a curve, y stays across it.

    ``along_m`` (n,) are places on the drawn x axis, ``centres_m`` (n, 2) and ``headings_rad`` (n,) the curve there;
    ``lean`` shears the floor: y metres across lie ``lean * y`` further along.
    """

    along_m: NDArray[np.float64]
    centres_m: NDArray[np.float64]
    headings_rad: NDArray[np.float64]
    lean: float

    @property
    def straight(self) -> bool:
        return bool(np.ptp(self.headings_rad) < 1e-9)

    def outline(self, drawn: Outline) -> Outline:
        """A drawn outline in the building's frame."""
        return self.points(drawn if self.straight else in_pieces(drawn))

    def points(self, drawn: NDArray[np.float64]) -> NDArray[np.float64]:
        """Drawn points (n, 2) in the building's frame."""
        across = drawn[:, 1]
        along = drawn[:, 0] + self.lean * across
        place = [np.interp(along, self.along_m, self.centres_m[:, i]) for i in range(2)]
        heading = np.interp(along, self.along_m, self.headings_rad)
        return np.stack((place[0] - np.sin(heading) * across, place[1] + np.cos(heading) * across), axis=1)


def bend(
    curves: Sequence[tuple[float, float, float]], extent_m: tuple[float, float], yaw_rad: float, lean: float
) -> Bend:
    """A bend from curves (from, to, curvature in 1/m) over a floor drawn between ``extent_m`` in x."""
    low, high = extent_m[0] - 40.0, extent_m[1] + 40.0  # what stands outside is bent on
    along = np.arange(low, high + _CENTRE_LINE_M, _CENTRE_LINE_M)
    curvature = np.zeros_like(along)
    for start, end, strength in curves:
        curvature[(along >= start) & (along < end)] += strength
    heading = np.concatenate(([0.0], np.cumsum(curvature[:-1]) * _CENTRE_LINE_M)) + yaw_rad
    middle = (heading[:-1] + heading[1:]) / 2
    steps = np.stack((np.cos(middle), np.sin(middle)), axis=1) * _CENTRE_LINE_M
    return Bend(along, np.vstack(([0.0, 0.0], np.cumsum(steps, axis=0))), heading, lean)
