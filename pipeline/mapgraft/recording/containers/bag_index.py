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
    number,
    time_ns,
)
from mapgraft.recording.containers.chunks import Place, note_damage


@dataclass(slots=True)
class BagIndex:
    """Connections and places of a bag, and how many messages each connection has."""

    connections: dict[int, Connection] = field(default_factory=dict)
    places: list[Place] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)

    def declare(self, found: Connection | None) -> None:
        if found is not None:
            self.connections.setdefault(found.id, found)

    def count(self, counts: dict[int, int]) -> None:
        for channel, n in counts.items():
            self.counts[channel] = self.counts.get(channel, 0) + n


def read_bag_index(view: memoryview, faults: ReadFaults) -> BagIndex:
    """The index of a whole bag, ``view``, whose magic has been checked. Adds what is wrong to ``faults``."""
    head = next(bag_records(view, len(MAGIC), len(view)), None)
    index = _indexed(view, head) if head is not None and head.op == OP_BAG else None
    if index is None:
        faults.add("index_damaged", "the bag has no usable index (it was cut off or damaged): the whole file is walked")
        index = _walked(view, faults)
    return index


def _indexed(view: memoryview, head: BagRecord) -> BagIndex | None:
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


def _walked(view: memoryview, faults: ReadFaults) -> BagIndex:
    index = BagIndex()
    for record in bag_records(view, len(MAGIC), len(view)):
        if record.op == OP_CONNECTION:
            index.declare(connection(view, record))
        elif record.op == OP_CHUNK:
            _look_inside(view, record, index, faults)
    return index


def _look_inside(view: memoryview, chunk: BagRecord, index: BagIndex, faults: ReadFaults) -> None:
    content = bag_content(view, chunk.offset, chunk.end)
    note_damage(faults, chunk.offset, content)
    inside, counts = memoryview(content.data), dict[int, int]()
    start_ns, end_ns = 2**64, -1
    for record in bag_records(inside, 0, len(inside)):
        if record.op == OP_CONNECTION:
            index.declare(connection(inside, record))
        elif record.op == OP_MESSAGE and record.whole:
            channel, log_ns = number(record.fields, b"conn"), time_ns(record.fields, b"time")
            if channel is not None and log_ns is not None:
                counts[channel] = counts.get(channel, 0) + 1
                start_ns, end_ns = min(start_ns, log_ns), max(end_ns, log_ns)
    if counts:
        index.places.append(Place(chunk.offset, chunk.end, start_ns, end_ns, dict.fromkeys(counts, 0)))
        index.count(counts)
