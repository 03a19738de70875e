"""Laser scans from decoded message objects, field by field: the general way."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts.geometry import Transform
from mapgraft.contracts.sources import (
    FOXGLOVE_LASER_SCAN,
    FOXGLOVE_ROS_LASER_SCAN,
    LASER_SCAN,
    ScanMessage,
)
from mapgraft.recording.decoding.names import bare_frame

_TIME_FIELDS = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"), ("secs", "nsecs"))


def stamp_ns(time: Any) -> int:
    """Nanoseconds of a time as ROS 1, ROS 2, protobuf and JSON spell its fields; raises ValueError for others."""
    for seconds, nanoseconds in _TIME_FIELDS:
        if hasattr(time, seconds) and hasattr(time, nanoseconds):
            return int(getattr(time, seconds)) * 10**9 + int(getattr(time, nanoseconds))
    raise ValueError(f"a time must have seconds and nanoseconds, found {time!r}")


def ros_scan(message: Any) -> ScanMessage:
    """The scan in a ``sensor_msgs/LaserScan`` object."""
    return ScanMessage(
        stamp_ns(message.header.stamp),
        bare_frame(message.header.frame_id),
        float(message.angle_min),
        float(message.angle_increment),
        float(message.time_increment),
        float(message.range_min),
        float(message.range_max),
        _ranges(message.ranges),
    )


def foxglove_scan(message: Any) -> ScanMessage:
    """The scan in a ``foxglove.LaserScan`` object; it knows no range limits and spreads its beams evenly."""
    ranges = _ranges(message.ranges)
    start, end = float(message.start_angle), float(message.end_angle)
    step = (end - start) / (len(ranges) - 1) if len(ranges) > 1 else 0.0
    return ScanMessage(
        stamp_ns(message.timestamp),
        bare_frame(message.frame_id),
        start,
        step,
        0.0,
        0.0,
        math.inf,
        ranges,
        sensor_pose(getattr(message, "pose", None)),
    )


SCAN_READERS: dict[str, Callable[[Any], ScanMessage]] = {
    LASER_SCAN: ros_scan,
    FOXGLOVE_LASER_SCAN: foxglove_scan,
    FOXGLOVE_ROS_LASER_SCAN: foxglove_scan,
}


def _ranges(values: Any) -> NDArray[np.float32]:
    if not isinstance(values, np.ndarray):
        values = np.array([math.nan if value is None else float(value) for value in values])
    with np.errstate(over="ignore"):
        ranges: NDArray[np.float32] = values.astype(np.float32, copy=False)
    ranges.setflags(write=False)
    return ranges


def sensor_pose(pose: Any) -> Transform | None:
    """Where a sensor sits in its frame as Foxglove's messages tell it; None in the frame's origin."""
    if pose is None:
        return None
    p, q = pose.position, pose.orientation
    xyzw = (float(q.x), float(q.y), float(q.z), float(q.w))
    xyz_m = (float(p.x), float(p.y), float(p.z))
    if xyz_m == (0.0, 0.0, 0.0) and xyzw in ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)):
        return None  # left out, or said to be the frame itself
    return Transform.from_quaternion(xyz_m, xyzw)
