"""Trajectories in TUM format as a source of poses.

Source: the TUM RGB-D benchmark; one pose a line, ``stamp x y z qx qy qz qw``, comments begin with ``#``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from mapgraft.contracts.sources import TUM_POSE, Channel, RawMessage, ReadFaults, RecordedScan, ScanMessage, SchemaText
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.limits import DEFAULT_LIMITS, ReadLimits
from mapgraft.recording.containers.scanning import scans_of
from mapgraft.recording.containers.text_lines import lines, seconds_to_ns
from mapgraft.recording.decoding.records import PoseRecord

TOPIC = "trajectory"


class TumSource:
    """One trajectory; its only topic is ``trajectory``, and neither frame has a name.

    ``log_ns`` never falls back: a pose written out of order keeps its own stamp but takes the log time of the newest
    one before. Raises RecordingError when no line is a pose.
    """

    container = "tum"

    def __init__(self, path: Path, limits: ReadLimits = DEFAULT_LIMITS) -> None:
        self.path = path
        self.faults = ReadFaults()
        self._limits = limits
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        count = 0
        for log_ns, _ in self._poses():
            count += 1
            self.start_ns = log_ns if self.start_ns is None else self.start_ns
            self.end_ns = log_ns
        if not count:
            raise RecordingError(f"{path} holds no pose of a TUM trajectory (stamp x y z qx qy qz qw)")
        self.channels = (Channel(0, TOPIC, TUM_POSE, "tum", count),)

    def _poses(self) -> Iterator[tuple[int, bytes]]:
        """Log time and text of each line that is a pose."""
        newest_ns: int | None = None
        for line in lines(self.path, self.faults, self._limits):
            if line.text.startswith(b"#"):
                continue
            try:
                stamp_ns = pose_of(line.text).stamp_ns
            except ValueError as error:
                sentence = f"line {line.number} of {self.path.name} is no pose ({error})"
                self.faults.add("line_unreadable", sentence, place=line.number)
                continue
            if newest_ns is not None and stamp_ns < newest_ns:
                sentence = "poses were written out of order: they keep their own stamps"
                self.faults.add("lines_out_of_order", sentence, topic=TOPIC, place=line.number)
            newest_ns = stamp_ns if newest_ns is None else max(newest_ns, stamp_ns)
            yield newest_ns, line.text

    def schema(self, channel: Channel) -> SchemaText | None:
        """See ``Source.schema``."""
        return None

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """See ``Source.messages``; ``data`` is the line."""
        if topics is not None and TOPIC not in topics:
            return
        for log_ns, text in self._poses():
            if end_ns is not None and log_ns > end_ns:
                return
            if start_ns is None or log_ns >= start_ns:
                yield RawMessage(self.channels[0], log_ns, text)

    def decode(self, message: RawMessage) -> PoseRecord:
        """See ``Source.decode``."""
        try:
            return pose_of(bytes(message.data))
        except ValueError as error:
            raise RecordingError(f"a line of {self.path.name} is no pose ({error})") from error

    def decode_scan(self, message: RawMessage) -> ScanMessage:
        """A trajectory holds no scans: raises RecordingError."""
        raise RecordingError(f"{self.path} is a trajectory and holds no scans")

    def scans(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedScan]:
        """See ``Source.scans``; a trajectory holds none."""
        return scans_of(self, topics, start_ns, end_ns, self.faults)

    def close(self) -> None:
        """See ``Source.close``; a trajectory is open only while it is read."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def pose_of(text: bytes) -> PoseRecord:
    """The pose on a line; raises ValueError when it is none."""
    words = text.replace(b",", b" ").split()
    if len(words) != 8:
        raise ValueError(f"it has {len(words)} numbers instead of 8")
    x, y, z, qx, qy, qz, qw = map(float, words[1:])
    return PoseRecord(seconds_to_ns(words[0]), "", "", (x, y, z), (qx, qy, qz, qw))
