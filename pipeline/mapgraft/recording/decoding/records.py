"""Small frozen records of what pose messages say, whatever their type and container."""

from __future__ import annotations

import math
from typing import NamedTuple

from mapgraft.contracts.geometry import Transform


class PoseRecord(NamedTuple):
    """Where ``child`` was in ``frame`` at ``stamp_ns``, as a message says it: one transform ``T_frame_child``.

    Frame names have no leading slash; ``child`` is empty where the message does not name it. Metres; the quaternion
    (xyzw) is as recorded, not normalised. ``covariance`` is the message's row-major (6 × 6) of x, y, z, roll, pitch,
    yaw, or None where the message has none.
    """

    stamp_ns: int
    frame: str
    child: str
    xyz_m: tuple[float, float, float]
    xyzw: tuple[float, float, float, float]
    covariance: tuple[float, ...] | None = None

    @property
    def valid(self) -> bool:
        """Whether all numbers are finite and the quaternion has a length."""
        norm = math.hypot(*self.xyzw)
        return math.isfinite(norm) and norm >= 1e-6 and all(map(math.isfinite, self.xyz_m))

    def transform(self) -> Transform:
        """``T_frame_child``; raises TransformError when the record is not valid."""
        return Transform.from_quaternion(self.xyz_m, self.xyzw)


def planar_record(stamp_ns: int, frame: str, child: str, pose: tuple[float, float, float]) -> PoseRecord:
    """The record of a planar pose (x m, y m, yaw rad)."""
    x_m, y_m, yaw_rad = pose
    turn = (0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)) if math.isfinite(yaw_rad) else (math.nan,) * 4
    return PoseRecord(stamp_ns, frame, child, (x_m, y_m, 0.0), (turn[0], turn[1], turn[2], turn[3]))
