"""What an MCAP file holds and where: from its summary, or by walking it when the summary is missing or broken."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field

from mcap.records import Channel as ChannelRecord
from mcap.records import ChunkIndex, Footer, Header, Schema, Statistics

from mapgraft.contracts.sources import ReadFaults
from mapgraft.recording.containers.chunks import Place, note_damage
from mapgraft.recording.containers.mcap_messages import Spans, spans
from mapgraft.recording.containers.mcap_records import (
    FOOTER_BYTES,
    MAGIC,
    OPCODE_CHANNEL,
    OPCODE_CHUNK,
    OPCODE_DATA_END,
    OPCODE_MESSAGE,
    OPCODE_SCHEMA,
    RECORD_HEAD,
    Record,
    chunk_content,
    chunk_head,
    parsed,
    records,
)

BARE_BLOCK_BYTES = 1 << 20
"""Messages outside chunks are read in blocks of about this size."""


@dataclass(slots=True)
class McapIndex:
    """Schemas, channels and places of a file. ``counts`` is None where nobody counted the messages per channel."""

    profile: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    places: list[Place] = field(default_factory=list)
    counts: dict[int, int] | None = None
    start_ns: int | None = None
    end_ns: int | None = None

    def declare(self, value: object) -> None:
        """Take in a schema or a channel; the first of an id holds."""
        if isinstance(value, Schema):
            self.schemas.setdefault(value.id, value)
        elif isinstance(value, ChannelRecord):
            self.channels.setdefault(value.id, value)

    def count(self, found: Spans) -> None:
        self.counts = self.counts or {}
        for channel, n in found.counts.items():
            self.counts[channel] = self.counts.get(channel, 0) + n


def read_index(view: memoryview, faults: ReadFaults) -> McapIndex:
    """The index of a whole file, ``view``, whose leading magic has been checked. Adds what is wrong to ``faults``."""
    index = McapIndex()
    head = next(records(view, len(MAGIC), len(view)), None)
    header = parsed(view, head) if head is not None else None
    if isinstance(header, Header):
        index.profile = header.profile
    summary = _summary(view, faults)
    if summary is None:
        _walk(view, index, faults, look_inside=True)
    else:
        for value in summary:
            index.declare(value)
        if not _take_places(view, summary, index, faults):
            _walk(view, index, faults, look_inside=not index.channels)
        _take_statistics(summary, index)
    index.start_ns = min((place.start_ns for place in index.places), default=None)
    index.end_ns = max((place.end_ns for place in index.places), default=None)
    return index


def _summary(view: memoryview, faults: ReadFaults) -> list[object] | None:
    """The records of the summary; None when there is none, or none that can be trusted."""
    if len(view) < len(MAGIC) + FOOTER_BYTES or bytes(view[-len(MAGIC) :]) != MAGIC:
        faults.add("cut_off", "the recording was cut off (it has no end mark): what was written is read", place=0)
        return None
    end = len(view) - FOOTER_BYTES
    footer = parsed(view, Record(2, end, end + RECORD_HEAD, end + RECORD_HEAD + 20, True))
    if not isinstance(footer, Footer) or not 0 <= footer.summary_start <= end:
        faults.add("summary_damaged", "the recording's summary cannot be found: the whole file is walked instead")
        return None
    if footer.summary_start == 0:
        return None
    checked = view[footer.summary_start : end + RECORD_HEAD + 16]
    if footer.summary_crc and zlib.crc32(checked) != footer.summary_crc:
        faults.add("summary_damaged", "the recording's summary is damaged: the whole file is walked instead")
        return None
    values = [parsed(view, record) for record in records(view, footer.summary_start, end)]
    return [value for value in values if value is not None]


def _take_places(view: memoryview, summary: list[object], index: McapIndex, faults: ReadFaults) -> bool:
    """Places from the chunk index; False when the file has to be walked for them."""
    statistics = next((value for value in summary if isinstance(value, Statistics)), None)
    indexes = [value for value in summary if isinstance(value, ChunkIndex)]
    if not indexes or not index.channels:
        return False
    if statistics is not None and statistics.chunk_count != len(indexes):
        faults.add("summary_damaged", "the recording's chunk index is not complete: the whole file is walked instead")
        return False
    if any(value.chunk_start_offset + value.chunk_length > len(view) for value in indexes):
        faults.add(
            "summary_damaged", "the recording's chunk index points past its end: the whole file is walked instead"
        )
        return False
    index.places = [
        Place(
            value.chunk_start_offset,
            value.chunk_start_offset + value.chunk_length,
            value.message_start_time,
            value.message_end_time,
            value.message_index_offsets or None,
        )
        for value in indexes
    ]
    return True


def _take_statistics(summary: list[object], index: McapIndex) -> None:
    for value in summary:
        if isinstance(value, Statistics) and index.counts is None:
            index.counts = dict(value.channel_message_counts)


def _walk(view: memoryview, index: McapIndex, faults: ReadFaults, *, look_inside: bool) -> None:
    """Find all places by walking the file's records up to its data end or its break.

    With ``look_inside`` chunks are decompressed too, because only they tell the channels, times and counts.
    """
    unopened = False
    for offset, end, stated in _places(view, index, faults):
        if stated is not None and not look_inside:
            index.places.append(Place(offset, end, *stated, None))
            unopened = True
            continue
        content = chunk_content(view, offset, end)
        found = spans(content.data, index.declare)
        note_damage(faults, offset, content)
        if found.counts:
            index.places.append(Place(offset, end, found.start_ns, found.end_ns, dict.fromkeys(found.counts, 0)))
            index.count(found)
    if unopened:
        index.counts = None


def _places(
    view: memoryview, index: McapIndex, faults: ReadFaults
) -> Iterator[tuple[int, int, tuple[int, int] | None]]:
    """(offset, end, stated times) of each chunk, and (offset, end, None) of each block of messages outside chunks."""
    block: int | None = None
    reached = len(MAGIC)
    for record in records(view, len(MAGIC), len(view)):
        bare = record.opcode == OPCODE_MESSAGE and record.whole
        if block is not None and (not bare or record.offset - block >= BARE_BLOCK_BYTES):
            yield block, record.offset, None
            block = None
        if bare and block is None:
            block = record.offset
        reached = record.end
        if record.opcode == OPCODE_DATA_END:
            return
        if record.opcode in (OPCODE_SCHEMA, OPCODE_CHANNEL):
            index.declare(parsed(view, record))
        elif record.opcode == OPCODE_CHUNK:
            head = chunk_head(view, record)
            yield record.offset, record.end, (head.start_ns, head.end_ns) if head is not None else None
    if block is not None:
        yield block, reached, None
    faults.add("cut_off", "the recording was cut off (it has no data end): what was written is read", place=0)
