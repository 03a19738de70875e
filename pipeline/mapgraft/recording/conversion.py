"""What each message of a recording becomes in a ROS 2 recording."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from mapgraft.contracts.sources import Channel, RawMessage, SchemaText, Source
from mapgraft.errors import RecordingError
from mapgraft.recording import ros2_types
from mapgraft.recording.containers.carmen_lines import CarmenOdometry, CarmenScan
from mapgraft.recording.decoding.poses import CARMEN_BASE, CARMEN_MAP, carmen_odometry, carmen_scan
from mapgraft.recording.decoding.records import PoseRecord, planar_record
from mapgraft.recording.ros2_types import Encoded

TF, TF_STATIC = "/tf", "/tf_static"
_PRIMARY_LASERS = ("FLASER", "LASER_READING", "ROBOTLASER1")
_CARMEN_TOPICS = {"ODOM": "/odom", "TRUEPOS": "/true_pose"}


class Output(NamedTuple):
    """One message for the new recording."""

    topic: str
    latched: bool
    message: Encoded


class Untold(NamedTuple):
    """Why a channel cannot be written as ROS 2, as a clause."""

    why_not: str


Convert = Callable[[RawMessage], list[Output]]
"""Raises RecordingError for a message whose bytes do not fit its type."""


def converters(source: Source, typestore: str) -> dict[int, Convert | Untold]:
    """How to convert the messages of each channel of a source, by the channel's id.

    ``typestore`` is the one that the source was opened with. ROS 2 messages are kept byte for byte; ROS 1 messages are
    rewritten; CARMEN logs become laser scans, transforms and odometry, trajectories become poses.
    """
    carmen = _Carmen(source)
    return {channel.id: _converter(source, channel, typestore, carmen) for channel in source.channels}


def _converter(source: Source, channel: Channel, typestore: str, carmen: _Carmen) -> Convert | Untold:
    if not channel.decodable:
        return Untold(channel.why_not)
    if channel.encoding == "cdr":
        return _cdr(source.schema(channel), channel, typestore)
    if channel.encoding == "ros1":
        return _ros1(source.schema(channel), channel)
    if channel.encoding == "carmen":
        return carmen.convert
    if channel.encoding == "tum":
        return partial(_tum, source)
    return Untold(f"{channel.encoding} messages are not converted")


def _cdr(schema: SchemaText | None, channel: Channel, typestore: str) -> Convert:
    kept = schema if schema is not None and schema.data else ros2_types.ros2_schema(channel.message_type, typestore)
    return lambda raw: [Output(channel.topic, channel.latched, Encoded(kept, raw.data))]


def _ros1(schema: SchemaText | None, channel: Channel) -> Convert | Untold:
    if schema is None or not schema.data:
        return Untold("its definition is not in the recording")
    try:
        target, rewrite = ros2_types.ros1_converter(schema)
    except RecordingError as error:
        return Untold(str(error))
    return lambda raw: [Output(channel.topic, channel.latched, Encoded(target, rewrite(raw.data)))]


def _tum(source: Source, raw: RawMessage) -> list[Output]:
    record = source.decode(raw)
    if not isinstance(record, PoseRecord) or not record.valid:
        raise RecordingError("a pose of the trajectory is not finite")
    return [Output("/trajectory", False, ros2_types.pose_stamped(record._replace(frame=CARMEN_MAP)))]


class _Carmen:
    """Converts the lines of one CARMEN log.

    A log has the pose of each laser and no frames. The first laser makes the robot's body, ``base_link``, which is the
    laser itself because nothing is known of where it is mounted; further lasers get frames of their own in the map.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        topics = [channel.topic for channel in source.channels]
        self._primary = next((keyword for keyword in _PRIMARY_LASERS if keyword in topics), "")
        self._mounted = False

    def convert(self, raw: RawMessage) -> list[Output]:
        message = self._source.decode(raw)
        if isinstance(message, CarmenOdometry):
            (record,) = _valid(carmen_odometry(message))
            return [Output(_CARMEN_TOPICS[raw.channel.topic], False, ros2_types.odometry(record))]
        if not isinstance(message, CarmenScan):
            raise RecordingError(f"a {raw.channel.topic} line is neither a scan nor odometry")
        record, _ = _valid(carmen_scan(message))
        scan = ros2_types.laser_scan(self._source.decode_scan(raw))
        if raw.channel.topic != self._primary:
            moved = ros2_types.transforms([record])
            return [Output(TF, False, moved), Output(f"/scan_{message.laser}", False, scan)]
        moved = ros2_types.transforms([record._replace(child=CARMEN_BASE)])
        return [*self._mount(message), Output(TF, False, moved), Output("/scan", False, scan)]

    def _mount(self, message: CarmenScan) -> list[Output]:
        """The static transform of the first laser, once."""
        if self._mounted:
            return []
        self._mounted = True
        record = planar_record(message.stamp_ns, CARMEN_BASE, message.laser, (0.0, 0.0, 0.0))
        return [Output(TF_STATIC, True, ros2_types.transforms([record]))]


def _valid(records: tuple[PoseRecord, ...]) -> tuple[PoseRecord, ...]:
    if not all(record.valid for record in records):
        raise RecordingError("a pose of the log is not finite")
    return records
