"""From messages that tell poses to pose records, one reader per message type."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mapgraft.contracts.sources import CARMEN_LASER_SCAN, CARMEN_ODOMETRY, TUM_POSE
from mapgraft.errors import RecordingError
from mapgraft.recording.decoding.names import bare_frame
from mapgraft.recording.decoding.records import PoseRecord, planar_record
from mapgraft.recording.decoding.scan_fields import stamp_ns

PoseReader = Callable[[Any], tuple[PoseRecord, ...]]

CARMEN_MAP, CARMEN_ODOM, CARMEN_BASE = "map", "odom", "base_link"
"""Frame names for CARMEN logs, which have none: corrected poses are in the map, raw odometry is in its own frame."""


def transforms(message: Any) -> tuple[PoseRecord, ...]:
    """``tf2_msgs/TFMessage`` and ``tf/tfMessage``: one record per transform."""
    return tuple(map(_transform, message.transforms))


def transform_stamped(message: Any) -> tuple[PoseRecord, ...]:
    """``geometry_msgs/TransformStamped``."""
    return (_transform(message),)


def odometry(message: Any) -> tuple[PoseRecord, ...]:
    """``nav_msgs/Odometry``: the pose, with its covariance, of the child frame."""
    return (_stamped(message.header, bare_frame(message.child_frame_id), message.pose.pose, message.pose.covariance),)


def pose_stamped(message: Any) -> tuple[PoseRecord, ...]:
    """``geometry_msgs/PoseStamped``."""
    return (_stamped(message.header, "", message.pose, None),)


def pose_with_covariance(message: Any) -> tuple[PoseRecord, ...]:
    """``geometry_msgs/PoseWithCovarianceStamped``."""
    return (_stamped(message.header, "", message.pose.pose, message.pose.covariance),)


def path(message: Any) -> tuple[PoseRecord, ...]:
    """``nav_msgs/Path``: one record per pose; poses without a frame of their own are in the path's frame."""
    frame = bare_frame(message.header.frame_id)
    records = (_stamped(pose.header, "", pose.pose, None) for pose in message.poses)
    return tuple(record if record.frame else record._replace(frame=frame) for record in records)


def foxglove_transform(message: Any) -> tuple[PoseRecord, ...]:
    """``foxglove.FrameTransform``."""
    frame, child = bare_frame(message.parent_frame_id), bare_frame(message.child_frame_id)
    return (_record(stamp_ns(message.timestamp), frame, child, message.translation, message.rotation, None),)


def foxglove_transforms(message: Any) -> tuple[PoseRecord, ...]:
    """``foxglove.FrameTransforms``: one record per transform."""
    return tuple(record for transform in message.transforms for record in foxglove_transform(transform))


def foxglove_pose(message: Any) -> tuple[PoseRecord, ...]:
    """``foxglove.PoseInFrame``."""
    pose, frame = message.pose, bare_frame(message.frame_id)
    return (_record(stamp_ns(message.timestamp), frame, "", pose.position, pose.orientation, None),)


def carmen_scan(message: Any) -> tuple[PoseRecord, ...]:
    """A CARMEN scan: where its laser was (the corrected pose), and where odometry had the robot."""
    return (
        planar_record(message.stamp_ns, CARMEN_MAP, message.laser, message.laser_pose),
        planar_record(message.stamp_ns, CARMEN_ODOM, CARMEN_BASE, message.robot_pose),
    )


def carmen_odometry(message: Any) -> tuple[PoseRecord, ...]:
    """A CARMEN odometry line, or the true pose of a simulator."""
    return (planar_record(message.stamp_ns, message.frame, CARMEN_BASE, message.pose),)


def tum_pose(message: Any) -> tuple[PoseRecord, ...]:
    """A line of a TUM trajectory, which is a record already."""
    return (message,)


POSE_READERS: dict[str, PoseReader] = {
    "tf2_msgs/msg/TFMessage": transforms,
    "tf/msg/tfMessage": transforms,
    "geometry_msgs/msg/TransformStamped": transform_stamped,
    "nav_msgs/msg/Odometry": odometry,
    "geometry_msgs/msg/PoseStamped": pose_stamped,
    "geometry_msgs/msg/PoseWithCovarianceStamped": pose_with_covariance,
    "nav_msgs/msg/Path": path,
    "foxglove/msg/FrameTransform": foxglove_transform,
    "foxglove/msg/FrameTransforms": foxglove_transforms,
    "foxglove/msg/PoseInFrame": foxglove_pose,
    CARMEN_LASER_SCAN: carmen_scan,
    CARMEN_ODOMETRY: carmen_odometry,
    TUM_POSE: tum_pose,
}
"""Message type → the function that reads the poses out of a decoded message."""


def poses_of(message_type: str, message: object) -> tuple[PoseRecord, ...]:
    """The poses in a decoded message of one of ``POSE_READERS``.

    Records may hold numbers that are not finite (``PoseRecord.valid``). Raises RecordingError when the message lacks
    the fields of its type.
    """
    try:
        return POSE_READERS[message_type](message)
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise RecordingError(
            f"a message of type {message_type} does not have the fields of its type ({error})"
        ) from error


def _transform(message: Any) -> PoseRecord:
    moved = message.transform
    frame, child = bare_frame(message.header.frame_id), bare_frame(message.child_frame_id)
    return _record(stamp_ns(message.header.stamp), frame, child, moved.translation, moved.rotation, None)


def _stamped(header: Any, child: str, pose: Any, covariance: Any) -> PoseRecord:
    stamp, frame = stamp_ns(header.stamp), bare_frame(header.frame_id)
    return _record(stamp, frame, child, pose.position, pose.orientation, covariance)


def _record(stamp: int, frame: str, child: str, p: Any, q: Any, covariance: Any) -> PoseRecord:
    xyz_m = (float(p.x), float(p.y), float(p.z))
    xyzw = (float(q.x), float(q.y), float(q.z), float(q.w))
    numbers = None if covariance is None else tuple(np.asarray(covariance, np.float64).tolist())
    return PoseRecord(stamp, frame, child, xyz_m, xyzw, numbers)
