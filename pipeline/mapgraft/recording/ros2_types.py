"""ROS 2 messages from our own values, and ROS 1 messages as ROS 2: what ``convert`` writes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import get_typestore
from rosbags.typesys.store import Typestore

from mapgraft.contracts.sources import LASER_SCAN, ScanMessage, SchemaText
from mapgraft.errors import RecordingError
from mapgraft.recording.decoding.codecs import DEFAULT_TYPESTORE, UNDECODABLE, known_typestore, types_of
from mapgraft.recording.decoding.names import message_type
from mapgraft.recording.decoding.records import PoseRecord

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"

_HEADER = "std_msgs/msg/Header"
_RENAMED = {"tf/msg/tfMessage": TF_MESSAGE}
_COVARIANCE = 36  # entries of a 6 × 6 matrix


class Encoded(NamedTuple):
    """A message ready to be written: little-endian CDR, and the schema it follows."""

    schema: SchemaText
    data: bytes | memoryview


@cache
def ros2_types() -> Typestore:
    """The message types that we write ourselves."""
    return get_typestore(known_typestore(DEFAULT_TYPESTORE))


@cache
def ros2_schema(name: str, typestore: str = DEFAULT_TYPESTORE) -> SchemaText:
    """The definition of one of the usual ROS 2 types, with all it refers to."""
    types = get_typestore(known_typestore(typestore))
    return SchemaText(name, "ros2msg", types.generate_msgdef(name, ros_version=2)[0].encode())


def encoded(name: str, message: object) -> Encoded:
    """Serialize a message made of ``ros2_types``."""
    return Encoded(ros2_schema(name), ros2_types().serialize_cdr(message, name, little_endian=True))


def ros1_converter(schema: SchemaText) -> tuple[SchemaText, Callable[[bytes | memoryview], memoryview]]:
    """How to write messages of a ROS 1 definition as ROS 2: the new definition, and the function for the bytes.

    Headers lose their sequence number; ``tf/tfMessage`` becomes ``tf2_msgs/TFMessage``. Raises RecordingError when the
    definition cannot be parsed; the function raises it for a message that does not fit.
    """
    store, name = types_of(schema), message_type(schema.name)
    own = Typestore()
    own.fielddefs, own.types = dict(store.fielddefs), dict(store.types)
    own.fielddefs[_HEADER], own.types[_HEADER] = ros2_types().fielddefs[_HEADER], ros2_types().types[_HEADER]
    target = _RENAMED.get(name, name)
    own.fielddefs[target], own.types[target] = own.fielddefs[name], own.types[name]
    text = SchemaText(target, "ros2msg", own.generate_msgdef(target, ros_version=2)[0].encode())

    def convert(data: bytes | memoryview) -> memoryview:
        try:
            return own.ros1_to_cdr(data, target)
        except UNDECODABLE as error:
            raise RecordingError(f"a message of type {name} cannot be converted ({error})") from error

    return text, convert


def laser_scan(scan: ScanMessage) -> Encoded:
    """``sensor_msgs/LaserScan`` of a scan."""
    types = ros2_types().types
    last_rad = scan.angle_min_rad + max(len(scan.ranges_m) - 1, 0) * scan.angle_increment_rad
    message = types[LASER_SCAN](
        header=_header(scan.stamp_ns, scan.frame_id),
        angle_min=scan.angle_min_rad,
        angle_max=last_rad,
        angle_increment=scan.angle_increment_rad,
        time_increment=scan.time_increment_s,
        scan_time=0.0,
        range_min=scan.range_min_m,
        range_max=scan.range_max_m,
        ranges=np.ascontiguousarray(scan.ranges_m),
        intensities=np.zeros(0, np.float32),
    )
    return encoded(LASER_SCAN, message)


def transforms(records: Iterable[PoseRecord]) -> Encoded:
    """``tf2_msgs/TFMessage`` of poses."""
    types = ros2_types().types
    messages = [
        types["geometry_msgs/msg/TransformStamped"](
            header=_header(record.stamp_ns, record.frame),
            child_frame_id=record.child,
            transform=types["geometry_msgs/msg/Transform"](
                translation=types["geometry_msgs/msg/Vector3"](*record.xyz_m),
                rotation=types["geometry_msgs/msg/Quaternion"](*record.xyzw),
            ),
        )
        for record in records
    ]
    return encoded(TF_MESSAGE, types[TF_MESSAGE](transforms=messages))


def odometry(record: PoseRecord) -> Encoded:
    """``nav_msgs/Odometry`` of a pose; velocities are not known and 0, covariances 0 where the record has none."""
    types = ros2_types().types
    zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    twist = types["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
    unknown = np.zeros(_COVARIANCE)
    message = types[ODOMETRY](
        header=_header(record.stamp_ns, record.frame),
        child_frame_id=record.child,
        pose=types["geometry_msgs/msg/PoseWithCovariance"](
            pose=_pose(record), covariance=np.array(record.covariance) if record.covariance else unknown
        ),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=unknown),
    )
    return encoded(ODOMETRY, message)


def pose_stamped(record: PoseRecord) -> Encoded:
    """``geometry_msgs/PoseStamped`` of a pose."""
    message = ros2_types().types[POSE_STAMPED](header=_header(record.stamp_ns, record.frame), pose=_pose(record))
    return encoded(POSE_STAMPED, message)


def _pose(record: PoseRecord) -> Any:
    types = ros2_types().types
    return types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](*record.xyz_m),
        orientation=types["geometry_msgs/msg/Quaternion"](*record.xyzw),
    )


def _header(stamp_ns: int, frame: str) -> Any:
    types = ros2_types().types
    sec, nanosec = divmod(stamp_ns, 10**9)
    if not -(2**31) <= sec < 2**31:
        raise RecordingError(f"a stamp of {sec} s does not fit a ROS 2 header")
    return types[_HEADER](stamp=types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec), frame_id=frame)
