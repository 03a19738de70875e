"""First guesses for upright maps: walls seen from above, turned and shifted over each other in all ways."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points, Transform
from mapgraft_cloud.surface import Surface

CELL_M: Final = 0.4
TURNS: Final = 120  # 3 degrees each
_LARGEST_CELLS: Final = 512  # along one side; larger maps get larger cells
_HEIGHT_M: Final = 0.1  # in which heights are compared
_HIGHEST_M: Final = 3.0  # that the floors of two maps may differ
_SEPARATE_M: Final = 1.5  # nearer, two guesses of one turn are one
_FEWEST_WALLS: Final = 20


def guesses(target: Surface, source: Surface, most: int) -> list[Transform]:
    """The transforms under which most walls of both lie over each other, best first, none near a better one.

    Walls are counted in cells of 0.4 m seen from above (a cell counts once, however high its wall is) and correlated in
    all shifts by FFT, for every 3 degrees of yaw; the height comes from the histograms of heights. Two maps that are
    more than 200 m across together get larger cells, and cells of metres tell little. Empty where a map has hardly any
    walls.
    """
    from scipy import fft

    walls = target.points_m[target.upright], source.points_m[source.upright]
    if min(map(len, walls)) < _FEWEST_WALLS:
        return []
    middles = [(w[:, :2].min(axis=0) + w[:, :2].max(axis=0)) / 2.0 for w in walls]
    reach_m = [float(np.linalg.norm(w[:, :2] - m, axis=1).max()) for w, m in zip(walls, middles, strict=True)]
    cell_m = max(CELL_M, 2.0 * sum(reach_m) / _LARGEST_CELLS)
    side = fft.next_fast_len(math.ceil(2.0 * sum(reach_m) / cell_m) + 4, real=True)
    spectrum = fft.rfft2(_blurred(_counted(walls[0][:, :2] - middles[0], cell_m, side)))
    found: list[tuple[float, Transform]] = []
    for k in range(TURNS):
        yaw = 2.0 * math.pi * k / TURNS
        turned = Transform.planar(0.0, 0.0, yaw).apply(walls[1][:, :2] - middles[1])
        seen = _counted(turned, cell_m, side)
        score = fft.irfft2(spectrum * np.conj(fft.rfft2(seen)), s=(side, side))
        for value, row, column in _peaks(score, round(_SEPARATE_M / cell_m)):
            shift = np.array([_signed(column, side), _signed(row, side)]) * cell_m
            # p_target − middle_target = turned (p_source − middle_source) + shift
            move = middles[0] + shift - Transform.planar(0.0, 0.0, yaw).apply(middles[1][None])[0]
            found.append((value, Transform.planar(float(move[0]), float(move[1]), yaw)))
    best = _apart(found, middles[1], most)
    return [_raised(T, _rise(target.points_m, source.points_m)) for T in best]


def _counted(points: NDArray[np.float64], cell_m: float, side: int) -> NDArray[np.float32]:
    cells = np.floor(points / cell_m).astype(np.int64) + side // 2
    seen = np.zeros((side, side), np.float32)
    seen[np.clip(cells[:, 1], 0, side - 1), np.clip(cells[:, 0], 0, side - 1)] = 1.0
    return seen


def _blurred(seen: NDArray[np.float32]) -> NDArray[np.float32]:
    """Walls count in the cells beside them too, but less: turns come in steps."""
    import cv2

    near = cv2.GaussianBlur(seen, (5, 5), 0.8)
    return np.asarray(near, np.float32)


def _peaks(score: NDArray[np.float64], apart: int) -> list[tuple[float, int, int]]:
    """The three highest values that lie apart."""
    left, found = score.copy(), []
    for _ in range(3):
        row, column = np.unravel_index(int(np.argmax(left)), left.shape)
        found.append((float(left[row, column]), int(row), int(column)))
        rows = np.arange(row - apart, row + apart + 1) % left.shape[0]
        columns = np.arange(column - apart, column + apart + 1) % left.shape[1]
        left[np.ix_(rows, columns)] = -np.inf
    return found


def _signed(place: int, side: int) -> int:
    return place - side if place > side // 2 else place


def _apart(found: list[tuple[float, Transform]], middle: NDArray[np.float64], most: int) -> list[Transform]:
    kept: list[Transform] = []
    for _, T in sorted(found, key=lambda one: -one[0]):
        if len(kept) == most:
            break
        if not any(_same(T, other, middle) for other in kept):
            kept.append(T)
    return kept


def _same(T_a: Transform, T_b: Transform, middle: NDArray[np.float64]) -> bool:
    apart = T_a.apply(middle[None]) - T_b.apply(middle[None])
    return float(np.linalg.norm(apart)) < _SEPARATE_M and T_a.difference(T_b)[1] < math.radians(10.0)


def _rise(target: Points, source: Points) -> float:
    """How much higher the target lies: where the histograms of heights, floors above all, agree best."""
    low = min(float(target[:, 2].min()), float(source[:, 2].min())) - _HIGHEST_M
    high = max(float(target[:, 2].max()), float(source[:, 2].max())) + _HIGHEST_M
    edges = np.arange(low, high + _HEIGHT_M, _HEIGHT_M)
    ours, theirs = (np.sqrt(np.histogram(points[:, 2], edges)[0]) for points in (target, source))
    steps = range(-round(_HIGHEST_M / _HEIGHT_M), round(_HIGHEST_M / _HEIGHT_M) + 1)
    return max(steps, key=lambda k: (float(ours @ np.roll(theirs, k)), -abs(k))) * _HEIGHT_M


def _raised(T: Transform, rise_m: float) -> Transform:
    matrix = T.matrix.copy()
    matrix[2, 3] = rise_m
    return Transform(matrix)
