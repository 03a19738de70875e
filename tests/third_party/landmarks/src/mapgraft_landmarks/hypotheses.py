"""Rigid hypotheses between two sets of points: proposed by equal distances, refined by least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Points

Indices = NDArray[np.intp]
Poses = NDArray[np.float64]  # (n, 3) x, y (m), yaw (rad) of T_target_source

_YAW_BIN_RAD = np.radians(4.0)
_SHIFT_BIN_M = 0.5
_ROUNDS = 5  # of pairing and least squares; the pairs hardly ever change after the third


@dataclass(frozen=True, slots=True, eq=False)
class Pairing:
    """A pose and the landmarks it brings together: ``target`` and ``source`` (k,) indices, ``residuals_m`` (k,)."""

    pose: NDArray[np.float64]
    target: Indices
    source: Indices
    residuals_m: NDArray[np.float64]


def propose(target: Points, source: Points, tolerance_m: float, pair_min_m: float, most: int) -> Poses:
    """Poses that bring two landmarks of the source onto two of the target, those first that most pairs agree on.

    Every pair of the source is laid on every pair of the target of equal length (within ``tolerance_m``), both ways
    round. Dedeoglu and Sukhatme (2000) count agreeing landmarks for each; here equal poses vote, in bins of 4 degrees
    and half a metre at the source's centre. At most ``most`` poses (n, 3), one per bin.
    """
    i, j = _both_ways(target, pair_min_m)
    k, m = (side[: len(side) // 2] for side in _both_ways(source, pair_min_m))
    lengths = np.hypot(*(target[j] - target[i]).T)
    order = np.argsort(lengths, kind="stable")
    wanted = np.hypot(*(source[m] - source[k]).T)
    low = np.searchsorted(lengths[order], wanted - tolerance_m)
    high = np.searchsorted(lengths[order], wanted + tolerance_m, side="right")
    of_source = np.repeat(np.arange(len(wanted)), high - low)
    first = np.repeat(low - np.concatenate(([0], np.cumsum(high - low)[:-1])), high - low)
    of_target = order[first + np.arange(len(of_source))]
    poses = _laid_on(target[i[of_target]], target[j[of_target]], source[k[of_source]], source[m[of_source]])
    return poses[_elected(poses, source.mean(axis=0), most)]


def refine(target: Points, source: Points, pose: NDArray[np.float64], tolerance_m: float) -> Pairing:
    """The least-squares pose of mutually nearest landmarks within ``tolerance_m``, starting at twice that."""
    reach, before = 2.0 * tolerance_m, np.empty(0, np.intp)
    for _ in range(_ROUNDS):
        a, b, _distances = mutual_pairs(target, moved(source, pose), reach)
        pairs = a * len(source) + b
        if len(a) < 2 or np.array_equal(pairs, before):
            break
        pose, reach, before = fitted(target[a], source[b]), tolerance_m, pairs
    a, b, distances = mutual_pairs(target, moved(source, pose), tolerance_m)
    return Pairing(pose, a, b, distances)


def moved(points: Points, pose: NDArray[np.float64]) -> Points:
    """The points (n, 2) after a pose (x, y, yaw)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turned: Points = np.stack((c * points[:, 0] - s * points[:, 1], s * points[:, 0] + c * points[:, 1]), axis=1)
    return turned + pose[:2]


def fitted(target: Points, source: Points) -> NDArray[np.float64]:
    """The pose (x, y, yaw) that brings the source nearest to the target in the sense of least squares."""
    p, q = target - target.mean(axis=0), source - source.mean(axis=0)
    yaw = np.arctan2((q[:, 0] * p[:, 1] - q[:, 1] * p[:, 0]).sum(), (q * p).sum())
    turned = moved(source.mean(axis=0)[None], np.array([0.0, 0.0, yaw]))[0]
    return np.array([*(target.mean(axis=0) - turned), yaw])


def mutual_pairs(a: Points, b: Points, reach_m: float) -> tuple[Indices, Indices, NDArray[np.float64]]:
    """Indices into a and b, and distances, of points that are each other's nearest and at most ``reach_m`` apart."""
    if not len(a) or not len(b):
        return np.empty(0, np.intp), np.empty(0, np.intp), np.empty(0)
    distances = np.hypot(a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1])
    to_b, to_a = distances.argmin(axis=1), distances.argmin(axis=0)
    rows = np.arange(len(a))
    kept = (to_a[to_b] == rows) & (distances[rows, to_b] <= reach_m)
    return rows[kept], to_b[kept], distances[rows, to_b][kept]


def _both_ways(points: Points, pair_min_m: float) -> tuple[Indices, Indices]:
    """All pairs of points at least that far apart: one way round first, then the other."""
    i, j = np.triu_indices(len(points), k=1)
    far = np.hypot(*(points[j] - points[i]).T) >= pair_min_m
    i, j = i[far], j[far]
    return np.concatenate((i, j)), np.concatenate((j, i))


def _laid_on(a: Points, b: Points, c: Points, d: Points) -> Poses:
    """Poses (n, 3) that turn c→d into the direction of a→b and bring their middles together."""
    ab, cd = b - a, d - c
    yaw = np.arctan2(cd[:, 0] * ab[:, 1] - cd[:, 1] * ab[:, 0], (cd * ab).sum(axis=1))
    middle = (c + d) / 2.0
    cos, sin = np.cos(yaw), np.sin(yaw)
    x = (a[:, 0] + b[:, 0]) / 2.0 - (cos * middle[:, 0] - sin * middle[:, 1])
    y = (a[:, 1] + b[:, 1]) / 2.0 - (sin * middle[:, 0] + cos * middle[:, 1])
    return np.stack((x, y, yaw), axis=1)


def _elected(poses: Poses, centre: NDArray[np.float64], most: int) -> Indices:
    """The first pose of each of the fullest bins, fullest first; of equals, the bin that comes first."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = cos * centre[0] - sin * centre[1] + poses[:, 0]
    y = sin * centre[0] + cos * centre[1] + poses[:, 1]
    turns = round(2.0 * np.pi / _YAW_BIN_RAD)
    bins = np.stack(
        (np.floor(poses[:, 2] / _YAW_BIN_RAD) % turns, np.floor(x / _SHIFT_BIN_M), np.floor(y / _SHIFT_BIN_M)), axis=1
    )
    _, first, votes = np.unique(bins, axis=0, return_index=True, return_counts=True)
    return first[np.argsort(-votes, kind="stable")[:most]]
