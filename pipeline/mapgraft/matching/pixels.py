"""Where the pixels of map images lie, and transforms between them: x to the right, y down, (0, 0) a pixel's centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Pictured, Points, Transform

Similarity = NDArray[np.float64]  # (3, 3) homogeneous, of the plane: a rotation, a shift and one scale


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """An image of ``width`` × ``height`` pixels; ``M_map_px`` takes pixels to metres in the map frame."""

    width: int
    height: int
    resolution_m: float
    M_map_px: Similarity


def frame_of(payload: object) -> Frame | None:
    """The frame of the image that a ready-made map was read from, or would be written to: its top row first.

    None where the payload has none.
    """
    if not isinstance(payload, Pictured) or payload.shape_px is None:
        return None
    height, width = payload.shape_px
    r = payload.resolution_m
    turn = np.array([[r, 0.0, 0.5 * r], [0.0, -r, (height - 0.5) * r], [0.0, 0.0, 1.0]])
    return Frame(width, height, r, planar(payload.T_map_origin) @ turn)


def planar(T: Transform, scale: float = 1.0) -> Similarity:
    """A transform and the scale of its source as a similarity of the plane; height, roll and pitch are left out."""
    out = np.eye(3)
    out[:2, :2], out[:2, 2] = scale * T.matrix[:2, :2], T.matrix[:2, 3]
    return out


def in_pixels(a: Frame, b: Frame, T_a_b: Similarity) -> Similarity:
    """The pixels of b as pixels of a, for a similarity between the map frames in metres."""
    return np.asarray(np.linalg.solve(a.M_map_px, T_a_b @ b.M_map_px), np.float64)


def in_metres(a: Frame, b: Frame, T_px_a_b: Similarity) -> Similarity:
    """The inverse of ``in_pixels``: the similarity between the map frames for one between their pixels."""
    return np.asarray(a.M_map_px @ T_px_a_b @ np.linalg.inv(b.M_map_px), np.float64)


def moved(S: Similarity, points: Points) -> Points:
    """Points (n, 2) moved by a similarity."""
    return np.asarray(points[:, :2] @ S[:2, :2].T + S[:2, 2], np.float64)


def scale_of(S: Similarity) -> float:
    """How much larger the source becomes."""
    return float(np.sqrt(abs(np.linalg.det(S[:2, :2]))))


def yaw_of(S: Similarity) -> float:
    """The rotation in radians, counter-clockwise where y points up."""
    return float(np.arctan2(S[1, 0], S[0, 0]))


def rigid(S: Similarity) -> Transform:
    """The rotation and shift of a similarity, without its scale."""
    return Transform.planar(float(S[0, 2]), float(S[1, 2]), yaw_of(S))
