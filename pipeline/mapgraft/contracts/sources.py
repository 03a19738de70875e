"""The seam between files and everything above them: a source gives raw messages in time order and decodes them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts.geometry import Transform

LASER_SCAN = "sensor_msgs/msg/LaserScan"
FOXGLOVE_LASER_SCAN = "foxglove/msg/LaserScan"
FOXGLOVE_ROS_LASER_SCAN = "foxglove_msgs/msg/LaserScan"
CARMEN_LASER_SCAN = "carmen/msg/LaserScan"
CARMEN_ODOMETRY = "carmen/msg/Odometry"
TUM_POSE = "tum/msg/Pose"
SCAN_TYPES = frozenset({LASER_SCAN, FOXGLOVE_LASER_SCAN, FOXGLOVE_ROS_LASER_SCAN, CARMEN_LASER_SCAN})
"""Message types that ``Source.decode_scan`` understands."""


@dataclass(frozen=True, slots=True)
class Channel:
    """One stream of messages of one type on one topic; a topic may have several channels in one file.

    ``message_type`` is always spelt ``package/msg/Name``, for ROS 1, ROS 2, ``foxglove.Name`` and our own text formats.
    ``encoding`` is ``cdr``, ``ros1``, ``protobuf``, ``json``, ``carmen`` or ``tum``. ``count`` is None where only
    reading the file could tell. ``latched`` channels hold for all later time (``/tf_static``, maps). Where
    ``decodable`` is False, ``why_not`` is a clause that says what is missing.
    """

    id: int
    topic: str
    message_type: str
    encoding: str
    count: int | None = None
    latched: bool = False
    decodable: bool = True
    why_not: str = ""


class SchemaText(NamedTuple):
    """How a file describes a message type: ``encoding`` is ``ros2msg``, ``ros2idl``, ``ros1msg``, ``protobuf``, …

    ``name`` is as the file spells it; ``data`` is empty where the file names the type and no more.
    """

    name: str
    encoding: str
    data: bytes


class RawMessage(NamedTuple):
    """One recorded message, not yet decoded.

    ``log_ns`` is when it was recorded. ``data`` may be a view into a decompressed chunk: it stays valid as long as it
    is kept, and keeps its whole chunk (about 1 MiB) in memory, so copy what is kept for long.
    """

    channel: Channel
    log_ns: int
    data: bytes | memoryview


class ScanMessage(NamedTuple):
    """A laser scan as its message gives it, before its numbers are interpreted.

    ``stamp_ns`` is the header's stamp. Beam *i* points to ``angle_min_rad + i * angle_increment_rad`` in the frame
    ``frame_id`` (leading slash stripped). ``time_increment_s`` is the time between two beams, 0 where unknown.
    ``ranges_m`` (n,) float32 is read-only and may be an unaligned view into a chunk. ``T_frame_sensor`` is where the
    lidar sits in that frame, None where it sits in its origin (only ``foxglove.LaserScan`` can say otherwise).
    """

    stamp_ns: int
    frame_id: str
    angle_min_rad: float
    angle_increment_rad: float
    time_increment_s: float
    range_min_m: float
    range_max_m: float
    ranges_m: NDArray[np.float32]
    T_frame_sensor: Transform | None = None


class RecordedScan(NamedTuple):
    """A laser scan with the channel and log time of its message."""

    channel: Channel
    log_ns: int
    scan: ScanMessage


@dataclass(frozen=True, slots=True)
class Fault:
    """Something lost or odd, met ``count`` times on ``topic`` (empty: the file as a whole).

    ``cause`` is a short word for machines (``chunk_damaged``), ``sentence`` tells a person what the first one was.
    """

    cause: str
    topic: str
    count: int
    sentence: str

    @property
    def text(self) -> str:
        """The sentence with its topic, where it does not name it itself, and how often that was."""
        named = not self.topic or self.topic in self.sentence
        times = f" ({self.count:,} times)" if self.count > 1 else ""
        return f"{'' if named else f'{self.topic}: '}{self.sentence}{times}"


class ReadFaults:
    """What was lost or odd while reading, counted per cause and topic.

    A fault added with a ``place`` (a byte offset, a line number) counts once, however often the file is read.
    """

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str], int] = {}
        self._sentences: dict[tuple[str, str], str] = {}
        self._places: set[tuple[str, str, int]] = set()

    def add(self, cause: str, sentence: str, *, topic: str = "", place: int | None = None, count: int = 1) -> None:
        """Count a fault; ``sentence`` is kept of the first one of its cause and topic."""
        if place is not None:
            if (cause, topic, place) in self._places:
                return
            self._places.add((cause, topic, place))
        key = (cause, topic)
        self._counts[key] = self._counts.get(key, 0) + count
        self._sentences.setdefault(key, sentence)

    def extend(self, other: ReadFaults) -> None:
        """Add all of another's counts."""
        for fault in other:
            self.add(fault.cause, fault.sentence, topic=fault.topic, count=fault.count)

    def count(self, cause: str) -> int:
        """How many faults of one cause there were, over all topics."""
        return sum(n for (name, _), n in self._counts.items() if name == cause)

    def __iter__(self) -> Iterator[Fault]:
        for (cause, topic), n in sorted(self._counts.items()):
            yield Fault(cause, topic, n, self._sentences[cause, topic])

    def __len__(self) -> int:
        return len(self._counts)


@runtime_checkable
class Source(Protocol):
    """One recording: a file, or the folder of a ROS 2 bag.

    ``container`` is ``mcap``, ``rosbag1``, ``rosbag2``, ``carmen``, ``tum``, or a plugin reader's own word.
    ``start_ns`` and ``end_ns`` are the first and last log time, None where nothing was recorded or only reading the
    file could tell. ``faults`` grows while the file is read.
    """

    @property
    def path(self) -> Path: ...
    @property
    def container(self) -> str: ...
    @property
    def channels(self) -> tuple[Channel, ...]: ...
    @property
    def start_ns(self) -> int | None: ...
    @property
    def end_ns(self) -> int | None: ...
    @property
    def faults(self) -> ReadFaults: ...

    def schema(self, channel: Channel) -> SchemaText | None:
        """The definition of a channel's messages; None where the container has none (text formats)."""
        ...

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """The messages of these topics (None: all) with ``start_ns <= log_ns <= end_ns``, in order of log time.

        May be called again for another pass, also while another pass is under way. Memory is bounded by a few chunks.
        Channels that are not decodable are left out. Raises RecordingError when the file cannot be read any more.
        """
        ...

    def decode(self, message: RawMessage) -> object:
        """The message as an object with the fields of its type; sequences of numbers are read-only numpy arrays.

        Raises RecordingError when the bytes do not fit the type.
        """
        ...

    def decode_scan(self, message: RawMessage) -> ScanMessage:
        """The laser scan in a message whose type is one of ``SCAN_TYPES``; the fast way for scans.

        Raises RecordingError when the bytes do not fit the type.
        """
        ...

    def scans(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedScan]:
        """The laser scans among the messages, decoded: the fastest way through a file when only scans are wanted.

        Equal to ``decode_scan`` over ``messages`` of the channels whose type is in ``SCAN_TYPES``, but a message that
        cannot be decoded is left out and counted in ``faults`` as ``scan_undecodable``.
        """
        ...

    def close(self) -> None:
        """Let go of the file; views into it that are still held stay valid."""
        ...

    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
