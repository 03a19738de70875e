"""MCAP files: any profile and encoding, whole, cut or damaged."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.records import Channel as ChannelRecord

from mapgraft.errors import RecordingError
from mapgraft.recording.containers.chunks import Place, in_log_order
from mapgraft.recording.containers.inflate import Content
from mapgraft.recording.containers.mapping import map_file
from mapgraft.recording.containers.mcap_index import McapIndex, note_damage, read_index
from mapgraft.recording.containers.mcap_messages import Wanted, messages
from mapgraft.recording.containers.mcap_records import MAGIC, chunk_content
from mapgraft.recording.containers.mcap_scans import chunk_scans, index_entries
from mapgraft.recording.containers.scanning import decoded_scan
from mapgraft.recording.decoding.codecs import DEFAULT_TYPESTORE, Codec, RosCodec, SchemaText, Undecodable, codec_for
from mapgraft.recording.decoding.names import message_type
from mapgraft.recording.source import SCAN_TYPES, Channel, RawMessage, ReadFaults, RecordedScan, ScanMessage

_TRANSIENT_LOCAL = re.compile(r"durability:\s*(1\b|transient_local\b)")


class McapSource:
    """One MCAP file. Raises RecordingError when the file is empty or no MCAP file at all.

    Chunks are found by the summary; without one, or with a damaged one, the file is walked and what can be read is
    read. ``faults`` says what was lost.
    """

    container = "mcap"

    def __init__(self, path: Path, *, typestore: str = DEFAULT_TYPESTORE) -> None:
        self.path = path
        self.faults = ReadFaults()
        self._view = map_file(path)
        if bytes(self._view[: len(MAGIC)]) != MAGIC:
            raise RecordingError(f"{path} is not an MCAP file: it does not begin like one")
        index = read_index(self._view, self.faults)
        self.start_ns, self.end_ns = index.start_ns, index.end_ns
        self._places = index.places
        self._codecs: dict[int, Codec] = {}
        self.channels = tuple(self._channel(record, index, typestore) for _, record in sorted(index.channels.items()))

    def _channel(self, record: ChannelRecord, index: McapIndex, typestore: str) -> Channel:
        schema = index.schemas.get(record.schema_id)
        text = SchemaText(schema.name, schema.encoding, schema.data) if schema is not None else None
        codec = codec_for(record.message_encoding, text, typestore)
        if not isinstance(codec, Undecodable):
            self._codecs[record.id] = codec
        return Channel(
            record.id,
            record.topic,
            message_type(schema.name) if schema is not None else "",
            record.message_encoding,
            None if index.counts is None else index.counts.get(record.id, 0),
            _is_latched(record.metadata),
            not isinstance(codec, Undecodable),
            codec.why_not if isinstance(codec, Undecodable) else "",
        )

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """See ``Source.messages``."""
        wanted = self._wanted(topics, start_ns, end_ns, self.channels)
        return in_log_order(self._places_of(wanted), self._fetch, partial(self._parse, wanted), self._note_late)

    def scans(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedScan]:
        """See ``Source.scans``."""
        wanted = self._wanted(topics, start_ns, end_ns, [c for c in self.channels if c.message_type in SCAN_TYPES])
        return in_log_order(self._places_of(wanted), self._fetch, partial(self._parse_scans, wanted), self._note_late)

    def _wanted(
        self, topics: Collection[str] | None, start_ns: int | None, end_ns: int | None, channels: Iterable[Channel]
    ) -> Wanted:
        chosen = {c.id: c for c in channels if c.decodable and (topics is None or c.topic in topics)}
        return Wanted(chosen, 0 if start_ns is None else start_ns, 2**64 if end_ns is None else end_ns)

    def _places_of(self, wanted: Wanted) -> list[Place]:
        if not wanted.channels:
            return []
        return [
            place
            for place in self._places
            if place.end_ns >= wanted.start_ns
            and place.start_ns <= wanted.end_ns
            and (place.channels is None or not wanted.channels.keys().isdisjoint(place.channels))
        ]

    def _fetch(self, place: Place) -> Content:
        return chunk_content(self._view, place.offset, place.end)

    def _parse(self, wanted: Wanted, place: Place, content: Content) -> list[RawMessage]:
        found, broken = messages(content.data, wanted)
        if broken and not content.damage:
            content = content._replace(damage="has a broken record")
        note_damage(self.faults, place.offset, content)
        return found

    def _parse_scans(self, wanted: Wanted, place: Place, content: Content) -> list[RecordedScan]:
        """The scans of a chunk: of each channel at once where its message index tells, else one by one."""
        found: list[RecordedScan] = []
        left = {}
        for channel in wanted.channels.values():
            scans = self._scans_by_index(place, content, channel, wanted)
            if scans is None:
                left[channel.id] = channel
            else:
                found += scans
        if left or content.damage:
            for message in self._parse(replace(wanted, channels=left), place, content):
                scan = decoded_scan(self, message)
                if scan is not None:
                    found.append(scan)
        if len(wanted.channels) > 1:
            found.sort(key=attrgetter("log_ns"))
        return found

    def _scans_by_index(
        self, place: Place, content: Content, channel: Channel, wanted: Wanted
    ) -> list[RecordedScan] | None:
        codec = self._codecs[channel.id]
        if content.damage or place.channels is None or not isinstance(codec, RosCodec) or not codec.is_plain_scan:
            return None
        at = place.channels.get(channel.id)
        if at is None:
            return []
        entries = index_entries(self._view, at, channel.id, wanted) if at else None
        return None if entries is None else chunk_scans(content.data, entries, channel)

    def _note_late(self, place: Place) -> None:
        self.faults.add(
            "late_messages",
            f"the chunk at byte {place.offset} holds messages from before its stated start: they come late",
            place=place.offset,
        )

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


def _is_latched(metadata: Mapping[str, str]) -> bool:
    """Whether a channel's publisher kept its last message for late subscribers (ROS 1 latching, ROS 2 durability)."""
    if metadata.get("latching", "").lower() in ("1", "true"):
        return True
    return _TRANSIENT_LOCAL.search(metadata.get("offered_qos_profiles", "")) is not None
