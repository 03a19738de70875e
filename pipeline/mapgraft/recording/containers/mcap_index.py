"""What an MCAP file holds and where: from its summary, and by walking whatever the summary does not tell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from mcap.records import Channel as ChannelRecord
from mcap.records import ChunkIndex, Schema, Statistics

from mapgraft.contracts.sources import ReadFaults
from mapgraft.recording.containers.chunks import Place, note_damage
from mapgraft.recording.containers.inflate import Content
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.mcap_described import Descriptions, Renaming
from mapgraft.recording.containers.mcap_messages import Spans, spans
from mapgraft.recording.containers.mcap_records import (
    MAGIC,
    RECORD_HEAD,
    ChunkHead,
    chunk_content,
    chunk_head,
    records,
)
from mapgraft.recording.containers.mcap_scans import indexed_span
from mapgraft.recording.containers.mcap_summary import Summary, believable_chunks, read_summary
from mapgraft.recording.containers.mcap_walk import Piece, Walk
from mapgraft.recording.containers.octets import Octets

_INDEX_HEAD, _INDEX_ENTRY = 15, 16  # bytes of a message index's opcode, lengths and channel, and of each message in it


@dataclass(slots=True)
class McapIndex:
    """Schemas, channels and places of a file.

    ``counts`` is None where nobody counted the messages per channel; ``stated`` is what the writer counted.
    ``vouched`` holds where the writer's counts say that the message indexes of all chunks leave nothing out.
    ``unpacked_bytes`` is how much all chunks together say they hold; ``damaged`` holds the chunks that were found
    broken, each with what can be read of it; ``renamings`` those by their offset in which ids stand for others than the
    first of that id.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    places: list[Place] = field(default_factory=list)
    counts: dict[int, int] | None = field(default_factory=dict)
    stated: Mapping[int, int] | None = None
    vouched: bool = False
    unpacked_bytes: int = 0
    damaged: list[tuple[Place, Content]] = field(default_factory=list)
    redefined: set[int] = field(default_factory=set)
    renamings: dict[int, Sequence[Renaming]] = field(default_factory=dict)
    supposed: list[Schema | ChannelRecord] = field(default_factory=list)

    @property
    def start_ns(self) -> int | None:
        return min((place.start_ns for place in self.places if _has_time(place)), default=None)

    @property
    def end_ns(self) -> int | None:
        return max((place.end_ns for place in self.places if _has_time(place)), default=None)

    def declare(self, value: object) -> None:
        """Take in a schema or a channel; the first of an id holds, and a different one is remembered."""
        if isinstance(value, Schema):
            text = self.schemas.setdefault(value.id, value)
            if (text.name, text.encoding, text.data) != (value.name, value.encoding, value.data):
                self.redefined.update(c.id for c in self.channels.values() if c.schema_id == value.id)
        elif isinstance(value, ChannelRecord):
            known = self.channels.setdefault(value.id, value)
            said = (value.topic, value.message_encoding, value.schema_id)
            if (known.topic, known.message_encoding, known.schema_id) != said:
                self.redefined.add(value.id)

    def suppose(self, value: object) -> None:
        """Remember a schema or a channel from bytes that may be wrong, in case that no others are found."""
        if isinstance(value, Schema | ChannelRecord):
            self.supposed.append(value)

    def count(self, counts: Mapping[int, int]) -> None:
        if self.counts is not None:
            for channel, n in counts.items():
                self.counts[channel] = self.counts.get(channel, 0) + n


def _has_time(place: Place) -> bool:
    """Chunks without messages say that they begin and end at 0."""
    return bool(place.channels or place.start_ns or place.end_ns)


def read_index(view: Octets, faults: ReadFaults, limits: ReadLimits) -> McapIndex:
    """The index of a whole file, ``view``. Adds what is wrong to ``faults``.

    Where the summary tells of chunks these are not touched; only what lies between them is walked. Raises
    RecordingError when all chunks together say that they hold far more than a file of this size can.
    """
    index = McapIndex()
    summary = read_summary(view, faults)
    values = () if summary is None else summary.values
    sure = summary is not None and summary.trusted and summary.checked
    for value in values if sure else ():
        index.declare(value)
    told = believable_chunks(view, summary, faults)
    index.unpacked_bytes = sum(min(value.uncompressed_size, limits.chunk_bytes) for value in told)
    limits.check_expansion("the recording", len(view), index.unpacked_bytes)
    index.places = [_told_place(value) for value in told]
    filler = _Filler(view, index, faults, limits)
    found = filler.walk(_gaps(view, told, summary))
    if told and found:
        sentence = f"{found} chunks are missing in the recording's chunk index: they are read all the same"
        faults.add("summary_damaged", sentence, place=2)
    filler.open_for_channels(told)
    for value in () if sure else values:  # the chunks' own descriptions go before those that no checksum vouches for
        (index.declare if summary is not None and summary.trusted else index.suppose)(value)
    if not sure and (filler.joined or index.redefined):
        return _by_all_descriptions(view, faults, limits)
    _adopt(index, faults)
    _take_statistics(summary, index, told, found)
    if not found:
        _distrust_indexes(index, told, faults)
    return index


def _told_place(value: ChunkIndex) -> Place:
    begin, end = value.chunk_start_offset, value.chunk_start_offset + value.chunk_length
    return Place(begin, end, value.message_start_time, value.message_end_time, value.message_index_offsets or None)


def _gaps(view: Octets, told: Sequence[ChunkIndex], summary: Summary | None) -> Iterator[tuple[int, int]]:
    """What lies between the chunks that are known, from the first record to the summary or the end of the file."""
    begin = len(MAGIC)
    for k, value in enumerate(told):
        yield begin, value.chunk_start_offset
        begin = value.chunk_start_offset + value.chunk_length
        behind = begin + value.message_index_length
        limit = told[k + 1].chunk_start_offset if k + 1 < len(told) else len(view)
        begin = behind if behind <= limit else begin
    yield begin, len(view) if summary is None or not told else max(begin, summary.begin)


class _Filler:
    """Finds places by walking, and looks into chunks where nothing else tells what they hold."""

    def __init__(self, view: Octets, index: McapIndex, faults: ReadFaults, limits: ReadLimits) -> None:
        self._view = view
        self._index = index
        self._faults = faults
        self._limits = limits
        self._known = bool(index.channels)
        self.joined = False

    def walk(self, gaps: Iterator[tuple[int, int]]) -> int:
        """Take in what lies in the gaps; how many chunks and blocks of messages there were."""
        walk, found = Walk(self._view, self._faults, self._index.declare), 0
        for begin, end in gaps:
            if end - begin < RECORD_HEAD:
                continue
            for piece in walk.pieces(begin, end):
                found += 1
                self._take(piece)
            self.joined |= walk.joined
        return found

    def _take(self, piece: Piece) -> None:
        index, head = self._index, None
        if piece.is_chunk:
            head = chunk_head(self._view, next(records(self._view, piece.offset, piece.end)))
            index.unpacked_bytes += 0 if head is None else min(head.size, self._limits.chunk_bytes)
            self._limits.check_expansion("the recording", len(self._view), index.unpacked_bytes)
        place = None if head is None else self._by_indexes(piece, head)
        if place is None and head is not None and not piece.indexes and self._known and head.start_ns <= head.end_ns:
            place = Place(piece.offset, piece.end, head.start_ns, head.end_ns, None)
            index.counts = None
        if place is None:
            place = self._open(piece)
        if place is not None:
            index.places.append(place)

    def _by_indexes(self, piece: Piece, head: ChunkHead) -> Place | None:
        """The place of a chunk whose message indexes are all there and agree with its head; it stays closed."""
        if not piece.indexed or not piece.indexes.keys() <= self._index.channels.keys():
            return None
        span = indexed_span(self._view, piece.indexes)
        if span is None or (span.start_ns, span.end_ns) != (head.start_ns, head.end_ns):
            return None
        self._index.count(span.counts)
        return Place(piece.offset, piece.end, span.start_ns, span.end_ns, piece.indexes)

    def _open(self, piece: Piece) -> Place | None:
        """The place of a chunk or block by what is in it; None when there is nothing of use."""
        content = chunk_content(self._view, piece.offset, piece.end, self._limits)
        found = spans(content.data, self._index.declare)
        spans(content.suspect, self._index.suppose)
        self._index.count(found.counts)
        place = _opened_place(piece, found)
        if content.damage:
            note_damage(self._faults, piece.offset, content)
            whole = place._replace(channels=piece.indexes or place.channels)
            self._index.damaged.append((whole, content._replace(suspect=b"")))
        return place if found.counts else None

    def open_for_channels(self, told: Sequence[ChunkIndex]) -> None:
        """Look into chunks of the chunk index for channels that it speaks of and nobody describes.

        What is wrong with them is told now: nobody may ask for what is in them.
        """
        index = self._index
        for place in index.places[: len(told)]:
            known = self._known if place.channels is None else place.channels.keys() <= index.channels.keys()
            if not known:
                content = chunk_content(self._view, place.offset, place.end, self._limits)
                spans(content.data, index.declare)
                spans(content.suspect, index.suppose)
                if content.damage:
                    index.damaged.append((place, content._replace(suspect=b"")))


def _by_all_descriptions(view: Octets, faults: ReadFaults, limits: ReadLimits) -> McapIndex:
    """The index of a file in which ids stand for several things: all is opened, in the order of the file."""
    index, described = McapIndex(), Descriptions()
    for piece in Walk(view, faults, described.declare).pieces(len(MAGIC), len(view)):
        content = chunk_content(view, piece.offset, piece.end, limits)
        found, renamings = described.look_through(content.data)
        spans(content.suspect, index.suppose)
        index.count(found.counts)
        channels = dict.fromkeys(found.counts, 0)
        place = Place(piece.offset, piece.end, found.start_ns, found.end_ns, channels)
        if renamings:
            index.renamings[piece.offset] = renamings
        if content.damage:
            note_damage(faults, piece.offset, content)
            index.damaged.append((place, content._replace(suspect=b"")))
        if found.counts:
            index.places.append(place)
    index.schemas, index.channels = described.schemas, described.channels
    _adopt(index, faults)
    for number, told in sorted(described.told.items()):
        if number != told:
            topic = described.channels[number].topic
            sentence = f"the channel {told} is described again, as another: messages behind that are read as it says"
            faults.add("channel_redefined", sentence, topic=topic, place=number)
    return index


def _opened_place(piece: Piece, found: Spans) -> Place:
    channels = {channel: piece.indexes.get(channel, 0) for channel in found.counts}
    return Place(piece.offset, piece.end, found.start_ns, found.end_ns, channels)


def _adopt(index: McapIndex, faults: ReadFaults) -> None:
    """Where nothing better describes a channel or its schema, take a description from bytes that may be wrong."""
    channels, schemas = set[int](), set[int]()
    for value in index.supposed:
        if isinstance(value, Schema) and value.id not in index.schemas:
            index.schemas[value.id] = value
            schemas.add(value.id)
        elif isinstance(value, ChannelRecord) and value.id not in index.channels:
            index.channels[value.id] = value
            channels.add(value.id)
    for number, channel in sorted(index.channels.items()):
        if number in channels or channel.schema_id in schemas:
            sentence = "its description lies in a damaged part of the file and is the only one: it may be wrong"
            faults.add("channel_doubtful", sentence, topic=channel.topic, place=number)
        if number in index.redefined:
            sentence = f"the channel {number} is described twice, differently: what the summary says holds"
            faults.add("channel_redefined", sentence, topic=channel.topic, place=number)


def _distrust_indexes(index: McapIndex, told: Sequence[ChunkIndex], faults: ReadFaults) -> None:
    """Open all chunks, whatever their message indexes say, when these have room for fewer messages than were counted.

    Where they have room for all of them, they are vouched for.

    How many messages an index tells of follows from its length: nothing has to be read for it.
    """
    if index.stated is None or not all(value.message_index_length for value in told):
        return
    sizes = [value.message_index_length - len(value.message_index_offsets) * _INDEX_HEAD for value in told]
    told_of, counted = sum(sizes) // _INDEX_ENTRY, sum(index.stated.values())
    known = {channel for value in told for channel in value.message_index_offsets}
    unknown = any(count for channel, count in index.stated.items() if channel not in known)
    if told_of >= counted and not unknown and not any(size % _INDEX_ENTRY for size in sizes):
        index.vouched = True
        return
    index.places[: len(told)] = [place._replace(channels=None) for place in index.places[: len(told)]]
    sentence = f"the message indexes leave out some of the {counted:,} messages: all chunks are searched for them"
    faults.add("index_partial", sentence, place=0)


def _take_statistics(summary: Summary | None, index: McapIndex, told: Sequence[ChunkIndex], found: int) -> None:
    """What the writer counted, where it did and where not everything was counted here."""
    statistics = () if summary is None or not summary.trusted else summary.values
    counted = next((dict(value.channel_message_counts) for value in statistics if isinstance(value, Statistics)), None)
    index.stated = counted
    if told or index.counts is None:
        index.counts = counted
