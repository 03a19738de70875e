"""Where a robot and its sensor were when a scan began and ended: from the tree of frames, or from the scan itself."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.recording.poses.rigid import IDENTITY, Pose7, compose, inverse, yaw_of
from mapgraft.recording.poses.tf import Missing, TransformBuffer

NEGLIGIBLE_M = 0.002
NEGLIGIBLE_RAD = 0.001
"""A sensor that moves less than both of these while it sweeps counts as standing still: 1 mrad is 1 cm at 10 m."""


class Placed(NamedTuple):
    """``T_map_base`` and ``T_map_sensor`` at one stamp."""

    T_map_base: Pose7
    T_map_sensor: Pose7


class TreePoses:
    """Poses of one robot from a tree of frames.

    ``map_frame`` and ``base_frame`` are the robot's; ``max_gap_ns`` is how far the samples around a stamp may lie
    apart.
    """

    __slots__ = ("base_frame", "buffer", "map_frame", "max_gap_ns")

    def __init__(self, buffer: TransformBuffer, map_frame: str, base_frame: str, max_gap_ns: int) -> None:
        self.buffer = buffer
        self.map_frame = map_frame
        self.base_frame = base_frame
        self.max_gap_ns = max_gap_ns

    def settled(self, frame: str, stamp_ns: int) -> bool:
        """Whether poses from before and after the stamp are there, so that waiting would not tell more."""
        to_base = self.buffer.chain(self.map_frame, self.base_frame)
        mount = self.buffer.chain(self.base_frame, frame)
        if isinstance(to_base, Missing) or isinstance(mount, Missing):
            return False
        return to_base.covers(stamp_ns) and mount.covers(stamp_ns)

    def at(self, frame: str, stamp_ns: int) -> Placed | Missing:
        """Where the base and the sensor with this frame were, or why nobody knows."""
        to_base = self.buffer.chain(self.map_frame, self.base_frame)
        mount = self.buffer.chain(self.base_frame, frame)
        if isinstance(to_base, Missing):
            return to_base
        if isinstance(mount, Missing):
            return mount
        T_map_base = to_base.at(stamp_ns, self.max_gap_ns)
        if isinstance(T_map_base, Missing):
            return T_map_base
        T_base_sensor = mount.at(stamp_ns, self.max_gap_ns)
        if isinstance(T_base_sensor, Missing):
            return T_base_sensor
        if T_base_sensor is IDENTITY:
            return Placed(T_map_base, T_map_base)
        return Placed(T_map_base, compose(T_map_base, T_base_sensor))


def beams_in_motion(T_map_first: Pose7, T_map_last: Pose7, n: int) -> NDArray[np.float64] | None:
    """Where the sensor was at each of ``n`` beams fired at even intervals, seen from where it was at the first.

    The arguments are ``T_map_sensor`` at the first and at the last beam; between them the sensor is taken to move
    evenly. Returns (n, 3) x (m), y (m), yaw (rad) in the sensor frame, or None when the motion does not matter.
    """
    T_first_last = compose(inverse(T_map_first), T_map_last)
    x_m, y_m, yaw_rad = T_first_last[0], T_first_last[1], yaw_of(T_first_last)
    if n < 2 or (math.hypot(x_m, y_m) < NEGLIGIBLE_M and abs(yaw_rad) < NEGLIGIBLE_RAD):
        return None
    moved: NDArray[np.float64] = np.multiply.outer(_fractions(n), (x_m, y_m, yaw_rad))
    return moved


@lru_cache(maxsize=16)
def _fractions(n: int) -> NDArray[np.float64]:
    fractions = np.linspace(0.0, 1.0, n)
    fractions.setflags(write=False)
    return fractions
