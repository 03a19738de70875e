"""Which messages become observations and which tell poses, and how to open them, whatever container they come from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from mapgraft.config import LimitsConfig
from mapgraft.contracts import (
    GRID_MESSAGE,
    SCAN,
    GridMessage,
    MapgraftError,
    RecordingError,
    Transform,
    TransformError,
)
from mapgraft.contracts.sources import CARMEN_LASER_SCAN, SCAN_TYPES, RawMessage, RecordedScan, ScanMessage, Source
from mapgraft.recording.decoding.grids import grid_payload
from mapgraft.recording.decoding.names import bare_frame
from mapgraft.recording.decoding.poses import POSE_READERS, poses_of
from mapgraft.recording.decoding.records import PoseRecord
from mapgraft.recording.decoding.scan_fields import sensor_pose, stamp_ns
from mapgraft.recording.decoding.scans import scan_payload
from mapgraft.recording.poses.lookup import Placed
from mapgraft.recording.poses.quick_tf import QUICK_TYPES, transforms
from mapgraft.recording.poses.rigid import pose7

GRID_TYPES = frozenset({"nav_msgs/msg/OccupancyGrid"})
TF_TYPES = frozenset(
    {
        "tf2_msgs/msg/TFMessage",
        "tf/msg/tfMessage",
        "geometry_msgs/msg/TransformStamped",
        "foxglove/msg/FrameTransform",
        "foxglove/msg/FrameTransforms",
    }
)
"""Message types whose transforms name both of their frames."""

POSE_TYPES = frozenset(POSE_READERS) - TF_TYPES
"""Message types that tell the pose of one body; scans of CARMEN logs among them."""

_NONSENSE_S = 3600.0  # no sweep takes an hour
_MOST_TOPICS = 20  # of one robot, on average

Read = RawMessage | RecordedScan
Decoder = Callable[[Any], object]


class Opened(NamedTuple):
    """A payload's message as far as its pose needs it: when, in which frame, and how long the sweep took.

    ``sweep_ns`` is the time from the first to the last of ``beams``, negative where they are fired in reverse order.
    ``T_frame_sensor`` is where the sensor sits in its frame (None: in its origin); ``placed`` is the pose that the
    message itself brings along, as CARMEN's scans do.
    """

    stamp_ns: int
    frame: str
    sweep_ns: int
    beams: int
    T_frame_sensor: Transform | None
    placed: Placed | None
    content: Callable[[], object]


class Payloads:
    """The registry of payload types: scans and ready grids, and what plugins' decoders add.

    ``kinds`` maps further message types to (kind of payload, how to get its decoder); a decoder is fetched when the
    first message of its type is turned into a payload.
    """

    def __init__(
        self,
        kinds: Mapping[str, tuple[str, Callable[[], Decoder]]] | None = None,
        limits: LimitsConfig | None = None,
    ) -> None:
        self._kinds = dict(kinds or {})
        self._limits = limits or LimitsConfig()
        self._decoders: dict[str, Decoder] = {}

    def kind_of(self, message_type: str) -> str | None:
        """The kind of payload that messages of this type give, None where nobody can decode them."""
        if message_type in SCAN_TYPES:
            return SCAN
        if message_type in GRID_TYPES:
            return GRID_MESSAGE
        return self._kinds[message_type][0] if message_type in self._kinds else None

    def check_topics(self, path: Path, count: int) -> None:
        """Raise RecordingError when a file has more topics of payloads and poses than the limits' robots can have."""
        if count > _MOST_TOPICS * self._limits.robots:
            raise RecordingError(
                f"{path} has {count:,} topics of scans, maps and poses, more than {_MOST_TOPICS} for each of "
                f"{self._limits.robots:,} robots: raise limits.robots if it is meant so"
            )

    def open(self, source: Source, read: Read) -> Opened:
        """Look into a payload's message; raises RecordingError when the bytes do not fit their type."""
        if isinstance(read, RecordedScan):
            return self._opened_scan(read.scan, None)
        message_type = read.channel.message_type
        if message_type in SCAN_TYPES:
            placed = _own_place(source, read) if message_type == CARMEN_LASER_SCAN else None
            return self._opened_scan(source.decode_scan(read), placed)
        message: Any = source.decode(read)
        stamp, frame, T_frame_sensor = _head(message, message_type)
        decode = self._grid if message_type in GRID_TYPES else self._decoder(message_type)
        return Opened(stamp, frame, 0, 0, T_frame_sensor, None, partial(_decoded, decode, message, message_type))

    def _opened_scan(self, scan: ScanMessage, placed: Placed | None) -> Opened:
        if len(scan.ranges_m) > self._limits.beams:
            raise RecordingError(
                f"a scan has {len(scan.ranges_m):,} beams, more than any lidar: raise limits.beams "
                f"({self._limits.beams:,}) if it is meant so"
            )
        return _opened_scan(scan, placed)

    def _grid(self, message: Any) -> GridMessage:
        return checked_size(grid_payload(message), self._limits, "a map")

    def _decoder(self, message_type: str) -> Decoder:
        if message_type not in self._decoders:
            self._decoders[message_type] = self._kinds[message_type][1]()
        return self._decoders[message_type]


def checked_size(grid: GridMessage, limits: LimitsConfig, what: str) -> GridMessage:
    """The grid; raises RecordingError when it has more cells than the limits allow."""
    if grid.cells.size > limits.grid_cells:
        raise RecordingError(
            f"{what} has {grid.cells.size:,} cells: raise limits.grid_cells ({limits.grid_cells:,}) if it is meant so"
        )
    return grid


def poses_in(source: Source, read: Read) -> Sequence[PoseRecord]:
    """The poses in a message of one of TF_TYPES or POSE_TYPES; raises RecordingError when it cannot be decoded."""
    if isinstance(read, RecordedScan):
        return ()
    if read.channel.message_type in QUICK_TYPES:
        quick = transforms(read.channel.encoding, read.data)
        if quick is not None:
            return quick
    return poses_of(read.channel.message_type, source.decode(read))


def _head(message: Any, message_type: str) -> tuple[int, str, Transform | None]:
    """When and in which frame a message was made, from its header, or as Foxglove's messages have it: with a pose."""
    try:
        if hasattr(message, "header"):
            return stamp_ns(message.header.stamp), bare_frame(message.header.frame_id), None
        place = sensor_pose(getattr(message, "pose", None))
        return stamp_ns(message.timestamp), bare_frame(message.frame_id), place
    except (AttributeError, TypeError, ValueError, TransformError) as error:
        raise RecordingError(f"a message of type {message_type} has no header ({error})") from error


def _opened_scan(scan: ScanMessage, placed: Placed | None) -> Opened:
    beams = len(scan.ranges_m)
    sweep_s = scan.time_increment_s * (beams - 1)
    sweep_ns = round(sweep_s * 1e9) if abs(sweep_s) < _NONSENSE_S else round(_NONSENSE_S * 1e9)  # NaN is nonsense too
    content = partial(scan_payload, scan)
    return Opened(scan.stamp_ns, scan.frame_id, sweep_ns, beams, scan.T_frame_sensor, placed, content)


def _own_place(source: Source, read: RawMessage) -> Placed | None:
    """Where a CARMEN scan says its laser was, which stands for the robot: its body is told in another frame."""
    record = poses_in(source, read)[0]
    if not record.valid:
        return None
    T_map_sensor = pose7(record.xyz_m, record.xyzw)
    return Placed(T_map_sensor, T_map_sensor)


def _decoded(decode: Decoder, message: object, message_type: str) -> object:
    try:
        return decode(message)
    except MapgraftError:
        raise
    except Exception as error:  # a stranger's decoder may fail in any way
        raise RecordingError(
            f"a message of type {message_type} cannot be decoded ({type(error).__name__}: {error})"
        ) from error
