"""ROS 1 bags (format 2.0), whole, cut or damaged."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

from mapgraft.contracts.sources import Channel, RawMessage, ReadFaults, RecordedScan, ScanMessage, SchemaText
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.bag_index import BagIndex, read_bag_index
from mapgraft.recording.containers.bag_records import (
    MAGIC,
    Connection,
    bag_content,
    bag_messages,
    bag_messages_at,
    bag_records,
    indexed_times,
    missing_counts,
)
from mapgraft.recording.containers.chunks import Place, in_log_order, note_damage, note_late, note_lost, note_strangers
from mapgraft.recording.containers.inflate import Content
from mapgraft.recording.containers.limits import DEFAULT_LIMITS, ReadLimits
from mapgraft.recording.containers.mapping import map_file
from mapgraft.recording.containers.scanning import scans_of
from mapgraft.recording.containers.selection import Wanted, places_of, wanted
from mapgraft.recording.decoding.codecs import DEFAULT_TYPESTORE, Codec, Undecodable, codec_for
from mapgraft.recording.decoding.names import message_type

OLD_MAGIC = b"#ROSRECORD V"
ANY_MAGIC = b"#ROSBAG V"


class BagSource:
    """One ROS 1 bag. Raises RecordingError for an empty, an encrypted, an old (before 2.0) or no bag at all.

    A bag with a missing or broken index is walked, and what can be read is read; ``faults`` says what was lost.
    """

    container = "rosbag1"

    def __init__(self, path: Path, *, typestore: str = DEFAULT_TYPESTORE, limits: ReadLimits = DEFAULT_LIMITS) -> None:
        self.path = path
        self.faults = ReadFaults()
        self._view = map_file(path)
        self._limits = limits
        begins = _check_head(path, self._view)
        index = read_bag_index(self._view, self.faults, limits)
        if not begins and not index.connections:
            raise RecordingError(f"{path} is not a ROS 1 bag: it does not begin like one")
        if not begins:
            self.faults.add("start_damaged", "the bag does not begin like one: it is searched for chunks")
        self._places = index.places
        self.start_ns = min((place.start_ns for place in index.places), default=None)
        self.end_ns = max((place.end_ns for place in index.places), default=None)
        self._codecs: dict[int, Codec] = {}
        self._schemas: dict[int, SchemaText] = {}
        self.channels = tuple(self._channel(found, index, typestore) for _, found in sorted(index.connections.items()))
        self._topics = {channel.id: channel.topic for channel in self.channels}
        for place, content in index.damaged:
            self._note_damage(place, content)

    def _channel(self, found: Connection, index: BagIndex, typestore: str) -> Channel:
        schema = self._schemas[found.id] = SchemaText(found.type_name, "ros1msg", found.definition)
        codec = codec_for("ros1", schema, typestore)
        if not isinstance(codec, Undecodable):
            self._codecs[found.id] = codec
        return Channel(
            found.id,
            found.topic,
            message_type(found.type_name),
            "ros1",
            index.counts.get(found.id, 0),
            found.latched,
            not isinstance(codec, Undecodable),
            codec.why_not if isinstance(codec, Undecodable) else "",
        )

    def schema(self, channel: Channel) -> SchemaText | None:
        """See ``Source.schema``."""
        return self._schemas.get(channel.id)

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """See ``Source.messages``."""
        want = wanted(self.channels, topics, start_ns, end_ns)
        late = partial(note_late, self.faults)
        return in_log_order(places_of(self._places, want), self._fetch, partial(self._parse, want), late)

    def _fetch(self, place: Place, most_bytes: int | None) -> Content:
        if not self._view:
            raise RecordingError(f"{self.path} was closed while it was still being read")
        limits = self._limits
        if most_bytes is not None and most_bytes < limits.chunk_bytes:
            limits = replace(limits, chunk_bytes=most_bytes)
        return bag_content(self._view, place.offset, place.end, limits)

    def _parse(self, want: Wanted, place: Place, content: Content) -> list[RawMessage]:
        found, broken, strangers = bag_messages(content.data, want)
        if broken and not content.damage:
            content = content._replace(damage="has a broken record")
            rescued = bag_messages_at(content.data, want, indexed_times(self._view, place.end))
            found = max(found, rescued, key=len)
        if content.damage:
            self._note_damage(place, content)
        note_strangers(self.faults, place.offset, strangers)
        return found

    def _note_damage(self, place: Place, content: Content) -> None:
        """Count a damaged chunk, and what is missing of it by topic where its index records tell."""
        note_damage(self.faults, place.offset, content)
        missing = missing_counts(content.data, indexed_times(self._view, place.end))
        for channel, count in missing.items():
            note_lost(self.faults, place.offset, self._topics.get(channel, ""), count)

    def scans(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedScan]:
        """See ``Source.scans``."""
        return scans_of(self, topics, start_ns, end_ns, self.faults)

    def decode(self, message: RawMessage) -> object:
        """See ``Source.decode``."""
        return self._codecs[message.channel.id].decode(message.data)

    def decode_scan(self, message: RawMessage) -> ScanMessage:
        """See ``Source.decode_scan``."""
        return self._codecs[message.channel.id].decode_scan(message.data)

    def close(self) -> None:
        """See ``Source.close``."""
        self._view = memoryview(b"")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _check_head(path: Path, view: memoryview) -> bool:
    """Whether the file begins like a bag; raises RecordingError for bags that cannot be read."""
    line = bytes(view[:64]).partition(b"\n")[0].decode(errors="replace")
    right = bytes(view[: len(MAGIC)]) == MAGIC
    if not right and line.startswith((OLD_MAGIC.decode(), ANY_MAGIC.decode())):
        raise RecordingError(
            f"{path} is a ROS bag of an old format ({line}): rewrite it as format 2.0 with ROS 1, "
            "'rosbag filter OLD.bag NEW.bag True'"
        )
    if not right and len(view) <= len(MAGIC):
        raise RecordingError(f"{path} is not a ROS 1 bag: it does not begin like one")
    head = next(bag_records(view, len(MAGIC), len(view)), None)
    if head is not None and head.fields.get(b"encryptor"):
        raise RecordingError(f"{path} is encrypted ({head.fields[b'encryptor'].decode(errors='replace')}): decrypt it")
    return right
