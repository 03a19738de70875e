"""MCAP files: any profile and encoding, whole, cut or damaged."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import chain
from operator import attrgetter
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.records import Channel as ChannelRecord

from mapgraft.contracts.sources import (
    SCAN_TYPES,
    Channel,
    RawMessage,
    ReadFaults,
    RecordedScan,
    ScanMessage,
    SchemaText,
)
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.chunks import (
    Place,
    T,
    in_log_order,
    note_damage,
    note_late,
    note_lost,
    note_strangers,
)
from mapgraft.recording.containers.inflate import Content
from mapgraft.recording.containers.latching import is_latched
from mapgraft.recording.containers.limits import DEFAULT_LIMITS, ReadLimits
from mapgraft.recording.containers.mapping import map_file
from mapgraft.recording.containers.mcap_described import renamed_messages
from mapgraft.recording.containers.mcap_index import McapIndex, read_index
from mapgraft.recording.containers.mcap_messages import messages, spans
from mapgraft.recording.containers.mcap_records import MAGIC, chunk_content
from mapgraft.recording.containers.mcap_scans import chunk_scans, index_entries, indexed_counts
from mapgraft.recording.containers.octets import Octets
from mapgraft.recording.containers.scanning import decoded_scan
from mapgraft.recording.containers.selection import Wanted, places_of, wanted
from mapgraft.recording.decoding.codecs import DEFAULT_TYPESTORE, Codec, RosCodec, Undecodable, codec_for
from mapgraft.recording.decoding.names import message_type

_COUNT_DIFFERS = "count_differs"
_INDEX_PARTIAL = "index_partial"
_OF_INDEXES = (_COUNT_DIFFERS, _INDEX_PARTIAL)  # nothing is lost by these alone


class McapSource:
    """One MCAP file. Raises RecordingError when the file is empty or no MCAP file at all.

    Chunks are found by the summary; without one, or with a damaged one, the file is walked and what can be read is
    read. ``faults`` says what was lost. ``octets`` are the file's bytes where it is not on this machine: then only what
    is needed of it is fetched.
    """

    container = "mcap"

    def __init__(
        self,
        path: Path,
        *,
        typestore: str = DEFAULT_TYPESTORE,
        limits: ReadLimits = DEFAULT_LIMITS,
        octets: Octets | None = None,
    ) -> None:
        self.path = path
        self.faults = ReadFaults()
        self._view: Octets = map_file(path) if octets is None else octets
        self._is_elsewhere = octets is not None
        self._limits = limits
        index = self._index()
        self.start_ns, self.end_ns = index.start_ns, index.end_ns
        self._places = index.places
        self._stated, self._vouched = index.stated, index.vouched
        self._renamings = index.renamings
        self._codecs: dict[int, Codec] = {}
        self._schemas: dict[int, SchemaText] = {}
        self.channels = tuple(self._channel(record, index, typestore) for _, record in sorted(index.channels.items()))
        self._topics = {channel.id: channel.topic for channel in self.channels}
        for place, content in index.damaged:
            self._note_damage(place, content)

    def _index(self) -> McapIndex:
        """What the file holds; one that does not begin like an MCAP file must show in another way that it is one."""
        begins = bytes(self._view[: len(MAGIC)]) == MAGIC
        if not begins and len(self._view) <= len(MAGIC):
            raise RecordingError(f"{self.path} is not an MCAP file: it does not begin like one")
        index = read_index(self._view, self.faults, self._limits)
        if not begins and not index.channels:
            raise RecordingError(f"{self.path} is not an MCAP file: it does not begin like one")
        if not begins:
            self.faults.add(
                "start_damaged", "the recording does not begin like an MCAP file: it is searched for chunks"
            )
        return index

    def _channel(self, record: ChannelRecord, index: McapIndex, typestore: str) -> Channel:
        schema = index.schemas.get(record.schema_id)
        text = SchemaText(schema.name, schema.encoding, schema.data) if schema is not None else None
        if text is not None:
            self._schemas[record.id] = text
        codec = codec_for(record.message_encoding, text, typestore)
        if not isinstance(codec, Undecodable):
            self._codecs[record.id] = codec
        return Channel(
            record.id,
            record.topic,
            message_type(schema.name) if schema is not None else "",
            record.message_encoding,
            None if index.counts is None else index.counts.get(record.id, 0),
            is_latched(record.metadata),
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
        return self._in_order(wanted(self.channels, topics, start_ns, end_ns), self._parse)

    def scans(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedScan]:
        """See ``Source.scans``."""
        return self._in_order(wanted(self.channels, topics, start_ns, end_ns, SCAN_TYPES), self._parse_scans)

    def _in_order(self, want: Wanted, parse: Callable[[Wanted, Place, Content], list[T]]) -> Iterator[T]:
        given: dict[int, int] = {}

        def counted(place: Place, content: Content) -> list[T]:
            found = parse(want, place, content)
            given[place.offset] = len(found)
            return found

        late = partial(note_late, self.faults)
        passed = in_log_order(places_of(self._places, want, self._vouched), self._fetch, counted, late)
        return chain(passed, self._compared(want, given))

    def _compared(self, want: Wanted, given: Mapping[int, int]) -> Iterator[T]:
        """Nothing more; but when fewer came than the writer counted and no other fault tells why, an index is wrong."""
        if self._stated is not None and want.is_open and all(fault.cause in _OF_INDEXES for fault in self.faults):
            stated, found = sum(self._stated.get(number, 0) for number in want.channels), sum(given.values())
            topics = sorted({channel.topic for channel in want.channels.values()})
            if found < stated:
                sentence = f"the summary tells of {stated:,} messages, and {found:,} are found: its indexes are wrong"
                topic = topics[0] if len(topics) == 1 else ""
                self.faults.add(_COUNT_DIFFERS, sentence, topic=topic, place=0, count=stated - found)
        yield from ()

    def _fetch(self, place: Place, most_bytes: int | None) -> Content:
        if not self._view:
            raise RecordingError(f"{self.path} was closed while it was still being read")
        limits = self._limits
        if most_bytes is not None and most_bytes < limits.chunk_bytes:
            limits = replace(limits, chunk_bytes=most_bytes)
        content = chunk_content(self._view, place.offset, place.end, limits)
        return content._replace(costly=True) if self._is_elsewhere else content  # worth to be read ahead

    def _parse(self, want: Wanted, place: Place, content: Content) -> list[RawMessage]:
        renamings = self._renamings.get(place.offset)
        out = renamed_messages(content.data, want, renamings) if renamings else messages(content.data, want)
        found, broken, strangers = out
        if broken and not content.damage:
            content = content._replace(damage="has a broken record")
        if content.damage:
            self._note_damage(place, content)
        note_strangers(self.faults, place.offset, strangers)
        return found

    def _note_damage(self, place: Place, content: Content) -> None:
        """Count a damaged chunk, and what is missing of it by topic where its message indexes tell."""
        note_damage(self.faults, place.offset, content)
        if place.channels and any(place.channels.values()):
            read = spans(content.data, lambda _: None).counts
            for channel, count in indexed_counts(self._view, place.channels).items():
                note_lost(self.faults, place.offset, self._topics.get(channel, ""), count - read.get(channel, 0))

    def _parse_scans(self, want: Wanted, place: Place, content: Content) -> list[RecordedScan]:
        """The scans of a chunk: of each channel at once where its message index tells, else one by one."""
        found: list[RecordedScan] = []
        left, complete = {}, self._tells_all(place, content)
        for channel in want.channels.values():
            scans = self._scans_by_index(place, content, channel, want) if complete else None
            if scans is None:
                left[channel.id] = channel
            else:
                found += scans
        if left or content.damage:
            for message in self._parse(replace(want, channels=left), place, content):
                scan = decoded_scan(self, message, self.faults)
                if scan is not None:
                    found.append(scan)
        if len(want.channels) > 1:
            found.sort(key=attrgetter("log_ns"))
        return found

    def _tells_all(self, place: Place, content: Content) -> bool:
        """Whether the message indexes of a chunk tell of all its messages; where nothing vouches for it, look."""
        if self._vouched or content.damage or place.channels is None:
            return True
        held, told = spans(content.data, lambda _: None).counts, indexed_counts(self._view, place.channels)
        left_out = sum(max(0, count - told.get(channel, 0)) for channel, count in held.items())
        if left_out and any(place.channels.values()):
            sentence = "the message indexes leave messages of their chunks out: these chunks are searched for them"
            self.faults.add(_INDEX_PARTIAL, sentence, place=place.offset, count=left_out)
        return not left_out

    def _scans_by_index(
        self, place: Place, content: Content, channel: Channel, want: Wanted
    ) -> list[RecordedScan] | None:
        codec = self._codecs[channel.id]
        if content.damage or place.channels is None or not isinstance(codec, RosCodec) or not codec.is_plain_scan:
            return None
        at = place.channels.get(channel.id)
        if at is None:
            return []
        entries = index_entries(self._view, at, channel.id, want) if at else None
        return None if entries is None else chunk_scans(content.data, entries, channel)

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
