"""ROS 2 bag folders: one recording split over storage files, with a metadata.yaml that may be missing."""

from __future__ import annotations

import heapq
import tempfile
import weakref
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from mapgraft.contracts.sources import Channel, RawMessage, ReadFaults, RecordedScan, ScanMessage, SchemaText, Source
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.bag_metadata import BagLayout, read_layout
from mapgraft.recording.containers.limits import DEFAULT_LIMITS, ReadLimits
from mapgraft.recording.containers.mcap_file import McapSource
from mapgraft.recording.containers.scanning import scans_of
from mapgraft.recording.containers.sqlite_file import SqliteSource
from mapgraft.recording.containers.zstd_files import Unpacking, unpack_message
from mapgraft.recording.decoding.codecs import DEFAULT_TYPESTORE

T = TypeVar("T", RawMessage, RecordedScan)


class BagFolderSource:
    """The folder of one ROS 2 bag. Raises RecordingError when it holds no bag, or none of its parts can be read.

    Its parts are merged by log time. A part that is missing or unreadable is a fault as long as another one is left.
    """

    container = "rosbag2"

    def __init__(self, path: Path, *, typestore: str = DEFAULT_TYPESTORE, limits: ReadLimits = DEFAULT_LIMITS) -> None:
        self.path = path
        self._limits = limits
        self._own_faults = ReadFaults()
        layout = read_layout(path, self._own_faults)
        self._workspace = tempfile.TemporaryDirectory() if layout.compression == "file" else None
        if self._workspace is not None:
            weakref.finalize(self, self._workspace.cleanup)
        self._packed_messages = layout.compression == "message"
        self._parts = self._open(layout, typestore)
        self.channels, self._merged_id = _merged([part.channels for part in self._parts])
        self._first = {
            self._merged_id[n, channel.id]: (n, channel)  # the first part that has the channel decodes it
            for n, part in reversed(list(enumerate(self._parts)))
            for channel in reversed(part.channels)
        }
        self.start_ns = min((part.start_ns for part in self._parts if part.start_ns is not None), default=None)
        self.end_ns = max((part.end_ns for part in self._parts if part.end_ns is not None), default=None)

    def _open(self, layout: BagLayout, typestore: str) -> list[Source]:
        parts: list[Source] = []
        problems: list[RecordingError] = []
        unpacking = None
        if self._workspace is not None:
            packed_bytes = sum(file.stat().st_size for file in layout.files)
            unpacking = Unpacking(Path(self._workspace.name), packed_bytes, self._limits)
        for file in layout.files:
            try:
                stored = file if unpacking is None else unpacking.unpack(file)
                parts.append(_open_storage(stored, typestore, self._limits))
            except RecordingError as error:
                problems.append(error)
                self._own_faults.add("part_unreadable", str(error), place=len(problems))
        if not parts:
            raise problems[0]
        return parts

    @property
    def faults(self) -> ReadFaults:
        """The faults of the folder and of all its parts."""
        together = ReadFaults()
        for faults in (self._own_faults, *(part.faults for part in self._parts)):
            together.extend(faults)
        return together

    def schema(self, channel: Channel) -> SchemaText | None:
        """See ``Source.schema``."""
        part, found = self._first[channel.id]
        return self._parts[part].schema(found)

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """See ``Source.messages``."""
        return _merged_in_order([self._messages(n, topics, start_ns, end_ns) for n in range(len(self._parts))])

    def _messages(
        self, part: int, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[RawMessage]:
        for channel, log_ns, data in self._parts[part].messages(topics, start_ns, end_ns):
            plain: bytes | memoryview | None = data
            if self._packed_messages:
                plain = unpack_message(data, self._own_faults, channel.topic, log_ns, self._limits)
            if plain is not None:
                yield RawMessage(self.channels[self._merged_id[part, channel.id]], log_ns, plain)

    def scans(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedScan]:
        """See ``Source.scans``."""
        if self._packed_messages:
            return scans_of(self, topics, start_ns, end_ns, self._own_faults)
        return _merged_in_order([self._scans(n, topics, start_ns, end_ns) for n in range(len(self._parts))])

    def _scans(
        self, part: int, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
    ) -> Iterator[RecordedScan]:
        for channel, log_ns, scan in self._parts[part].scans(topics, start_ns, end_ns):
            yield RecordedScan(self.channels[self._merged_id[part, channel.id]], log_ns, scan)

    def decode(self, message: RawMessage) -> object:
        """See ``Source.decode``."""
        part, channel = self._first[message.channel.id]
        return self._parts[part].decode(message._replace(channel=channel))

    def decode_scan(self, message: RawMessage) -> ScanMessage:
        """See ``Source.decode_scan``."""
        part, channel = self._first[message.channel.id]
        return self._parts[part].decode_scan(message._replace(channel=channel))

    def close(self) -> None:
        """See ``Source.close``."""
        for part in self._parts:
            part.close()
        if self._workspace is not None:
            self._workspace.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _merged_in_order(parts: Sequence[Iterator[T]]) -> Iterator[T]:
    return parts[0] if len(parts) == 1 else heapq.merge(*parts, key=attrgetter("log_ns"))


def _open_storage(file: Path, typestore: str, limits: ReadLimits) -> Source:
    if file.suffix == ".db3":
        return SqliteSource(file, typestore=typestore, limits=limits)
    return McapSource(file, typestore=typestore, limits=limits)


def _merged(parts: Sequence[Sequence[Channel]]) -> tuple[tuple[Channel, ...], dict[tuple[int, int], int]]:
    """The channels of all parts, equal ones once; and (part, channel id there) → index among them."""
    merged: list[Channel] = []
    index: dict[tuple[str, str, str, bool], int] = {}
    ids: dict[tuple[int, int], int] = {}
    for part, channels in enumerate(parts):
        for channel in channels:
            key = (channel.topic, channel.message_type, channel.encoding, channel.decodable)
            at = index.setdefault(key, len(merged))
            ids[part, channel.id] = at
            if at == len(merged):
                merged.append(replace(channel, id=at))
            else:
                known = merged[at]
                count = None if known.count is None or channel.count is None else known.count + channel.count
                merged[at] = replace(known, count=count, latched=known.latched or channel.latched)
    return tuple(merged), ids
