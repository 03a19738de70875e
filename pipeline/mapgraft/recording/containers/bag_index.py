"""What a ROS 1 bag holds and where: from its index, or by walking it when the index is missing or broken."""

from __future__ import annotations

from dataclasses import dataclass, field

from mapgraft.contracts.sources import ReadFaults
from mapgraft.recording.containers.bag_records import (
    MAGIC,
    OP_BAG,
    OP_CHUNK,
    OP_CHUNK_INFO,
    OP_CONNECTION,
    OP_MESSAGE,
    BagRecord,
    Connection,
    bag_content,
    bag_records,
    connection,
    indexed_times,
    number,
    time_ns,
)
from mapgraft.recording.containers.bag_walk import BagPiece, BagWalk
from mapgraft.recording.containers.chunks import Place, note_damage
from mapgraft.recording.containers.inflate import Content
from mapgraft.recording.containers.limits import ReadLimits


@dataclass(slots=True)
class BagIndex:
    """Connections and places of a bag, and how many messages each connection has.

    ``unpacked_bytes`` is how much all chunks together say they hold; ``damaged`` are those of which nothing is left.
    """

    connections: dict[int, Connection] = field(default_factory=dict)
    places: list[Place] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    unpacked_bytes: int = 0
    damaged: list[tuple[Place, Content]] = field(default_factory=list)

    def declare(self, found: Connection | None) -> None:
        if found is not None:
            self.connections.setdefault(found.id, found)

    def count(self, counts: dict[int, int]) -> None:
        for channel, n in counts.items():
            self.counts[channel] = self.counts.get(channel, 0) + n

    def unpack(self, view: memoryview, offset: int, limits: ReadLimits) -> None:
        """Add what a chunk says that it holds; raises RecordingError when it gets too much."""
        chunk = next(bag_records(view, offset, len(view)))
        self.unpacked_bytes += min(number(chunk.fields, b"size") or 0, limits.chunk_bytes)
        limits.check_expansion("the bag", len(view), self.unpacked_bytes)


def read_bag_index(view: memoryview, faults: ReadFaults, limits: ReadLimits) -> BagIndex:
    """The index of a whole bag, ``view``, whose magic has been checked. Adds what is wrong to ``faults``.

    Raises RecordingError when all chunks together say that they hold far more than a bag of this size can.
    """
    head = next(bag_records(view, len(MAGIC), len(view)), None)
    index = _indexed(view, head, limits) if head is not None and head.op == OP_BAG else None
    if index is None:
        faults.add("index_damaged", "the bag has no usable index (it was cut off or damaged): the whole file is walked")
        index = _Walker(view, faults, limits).walk()
    return index


def _indexed(view: memoryview, head: BagRecord, limits: ReadLimits) -> BagIndex | None:
    """The index that the bag's header points to; None unless all of it fits the file."""
    at = number(head.fields, b"index_pos")
    connections, chunks = number(head.fields, b"conn_count"), number(head.fields, b"chunk_count")
    if not at or at > len(view) or connections is None or chunks is None:
        return None
    index = BagIndex()
    for record in bag_records(view, at, len(view)):
        if record.op == OP_CONNECTION:
            index.declare(connection(view, record))
        elif record.op == OP_CHUNK_INFO and not _take_chunk(view, record, index):
            return None
    if len(index.connections) != connections or len(index.places) != chunks:
        return None
    if not index.counts.keys() <= index.connections.keys():
        return None
    for place in index.places:
        index.unpack(view, place.offset, limits)
    return index


def _take_chunk(view: memoryview, info: BagRecord, index: BagIndex) -> bool:
    at, entries = number(info.fields, b"chunk_pos"), number(info.fields, b"count")
    start_ns, end_ns = time_ns(info.fields, b"start_time"), time_ns(info.fields, b"end_time")
    if at is None or entries is None or start_ns is None or end_ns is None or info.end - info.begin != 8 * entries:
        return False
    chunk = next(bag_records(view, at, len(view)), None) if at < len(view) else None
    if chunk is None or chunk.op != OP_CHUNK or not chunk.whole:
        return False
    numbers = memoryview(bytes(view[info.begin : info.end])).cast("I").tolist()
    counts = dict(zip(numbers[::2], numbers[1::2], strict=True))
    index.places.append(Place(chunk.offset, chunk.end, start_ns, end_ns, dict.fromkeys(counts, 0)))
    index.count(counts)
    return True


class _Walker:
    """Finds places by walking, and looks into chunks where nothing else tells what they hold."""

    def __init__(self, view: memoryview, faults: ReadFaults, limits: ReadLimits) -> None:
        self._view = view
        self._faults = faults
        self._limits = limits
        self.index = BagIndex()

    def walk(self) -> BagIndex:
        for piece in BagWalk(self._view, self._faults, self.index.declare).pieces(len(MAGIC)):
            place = self._by_indexes(piece) or self._open(piece)
            if place is not None:
                self.index.places.append(place)
        return self.index

    def _by_indexes(self, piece: BagPiece) -> Place | None:
        """The place of a chunk whose index records are all there; it stays closed."""
        index = self.index
        if not piece.indexed or not piece.indexes.keys() <= index.connections.keys():
            return None
        times = indexed_times(self._view, piece.end)
        stamps = [log_ns for rows in times.values() for log_ns, _ in rows]
        if times.keys() != piece.indexes.keys() or not stamps:
            return None
        index.count({channel: len(rows) for channel, rows in times.items()})
        index.unpack(self._view, piece.offset, self._limits)
        return Place(piece.offset, piece.end, min(stamps), max(stamps), piece.indexes)

    def _open(self, piece: BagPiece) -> Place | None:
        """The place of a chunk or block by what is in it; None when there is nothing of use."""
        index = self.index
        index.unpack(self._view, piece.offset, self._limits)
        content = bag_content(self._view, piece.offset, piece.end, self._limits)
        inside, counts = memoryview(content.data), dict[int, int]()
        stamps: list[int] = []
        for record in bag_records(inside, 0, len(inside)):
            if record.op == OP_CONNECTION:
                index.declare(connection(inside, record))
            channel, log_ns = number(record.fields, b"conn"), time_ns(record.fields, b"time")
            if record.op == OP_MESSAGE and record.whole and channel is not None and log_ns is not None:
                counts[channel] = counts.get(channel, 0) + 1
                stamps.append(log_ns)
        if content.damage:
            note_damage(self._faults, piece.offset, content)
        if not stamps:
            if content.damage:
                index.damaged.append((Place(piece.offset, piece.end, 0, 0, piece.indexes), content))
            return None
        index.count(counts)
        return Place(piece.offset, piece.end, min(stamps), max(stamps), dict.fromkeys(counts, 0))
