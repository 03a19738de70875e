"""The records of a ROS 1 bag (format 2.0), walked on a memory map.

Source: the ROS bag file format, version 2.0 (wiki.ros.org/Bags/Format/2.0).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from operator import attrgetter
from typing import NamedTuple

from mapgraft.contracts.sources import RawMessage
from mapgraft.recording.containers.inflate import Content, inflate
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.selection import Wanted

MAGIC = b"#ROSBAG V2.0\n"
OP_MESSAGE, OP_BAG, OP_INDEX, OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION = 2, 3, 4, 5, 6, 7

Fields = Mapping[bytes, bytes]

_uint32 = struct.Struct("<I").unpack_from
_time = struct.Struct("<II").unpack
_index_entry = struct.Struct("<III")  # seconds, nanoseconds, offset
_log_ns = attrgetter("log_ns")


class BagRecord(NamedTuple):
    """A record: its header's fields, and its data at ``view[begin:end]``; ``whole`` is False when the data is cut."""

    op: int
    fields: Fields
    offset: int
    begin: int
    end: int
    whole: bool


def header_fields(view: memoryview, start: int, stop: int) -> dict[bytes, bytes] | None:
    """The ``name=value`` fields in ``view[start:stop]``; None when they are broken."""
    fields: dict[bytes, bytes] = {}
    while start < stop:
        if stop - start < 4:
            return None
        (size,) = _uint32(view, start)
        start += 4
        if size > stop - start:
            return None
        name, equals, value = bytes(view[start : start + size]).partition(b"=")
        if not equals:
            return None
        fields[name] = value
        start += size
    return fields


def bag_records(view: memoryview, start: int, stop: int) -> Iterator[BagRecord]:
    """The records in ``view[start:stop]``; the last one may be cut. Stops where there is no record any more."""
    while stop - start >= 8:
        (header_bytes,) = _uint32(view, start)
        data_at = start + 4 + header_bytes + 4
        if data_at > stop:
            return
        fields = header_fields(view, start + 4, data_at - 4)
        if fields is None or len(fields.get(b"op", b"")) != 1:
            return
        (data_bytes,) = _uint32(view, data_at - 4)
        end = data_at + data_bytes
        yield BagRecord(fields[b"op"][0], fields, start, data_at, min(end, stop), end <= stop)
        start = end


def number(fields: Fields, name: bytes) -> int | None:
    """A little-endian unsigned field of 4 or 8 bytes; None when it is missing."""
    value = fields.get(name, b"")
    return int.from_bytes(value, "little") if len(value) in (4, 8) else None


def time_ns(fields: Fields, name: bytes) -> int | None:
    """A time field in nanoseconds; None when it is missing."""
    value = fields.get(name, b"")
    if len(value) != 8:
        return None
    sec, nanosec = _time(value)
    return int(sec) * 10**9 + int(nanosec)


class Connection(NamedTuple):
    """One publisher's channel as the bag describes it."""

    id: int
    topic: str
    type_name: str
    definition: bytes
    latched: bool


def connection(view: memoryview, record: BagRecord) -> Connection | None:
    """The connection in a record; None when it is broken."""
    number_ = number(record.fields, b"conn")
    more = header_fields(view, record.begin, record.end) if record.whole else None
    topic = record.fields.get(b"topic")
    if number_ is None or more is None or topic is None or b"type" not in more:
        return None
    parts = [part for part in topic.decode(errors="replace").split("/") if part]
    name = ("/" if topic.startswith(b"/") else "") + "/".join(parts)
    type_name = more[b"type"].decode(errors="replace")
    return Connection(number_, name, type_name, more.get(b"message_definition", b""), more.get(b"latching") == b"1")


def bag_content(view: memoryview, offset: int, end: int, limits: ReadLimits) -> Content:
    """What a place in the bag holds: a chunk's content, or bare records, as they lie in a chunk never finished."""
    record = next(bag_records(view, offset, len(view)), None)
    if record is None or record.op not in (OP_CHUNK, OP_MESSAGE):
        return Content(b"", "is not a chunk")
    if record.op == OP_MESSAGE:
        return Content(view[offset:end])
    size = number(record.fields, b"size")
    if size is None:
        return Content(b"", "has a broken head")
    compression = record.fields.get(b"compression", b"").decode(errors="replace")
    if size == 0 and end > record.end:  # a recorder fills in the sizes when it finishes a chunk
        content = inflate(compression, view[record.begin : end], limits.chunk_bytes, limit=limits.chunk_bytes, cut=True)
        return content._replace(damage="was never finished")
    cut = not record.whole
    return inflate(compression, view[record.begin : end], size, limit=limits.chunk_bytes, cut=cut)


IndexedTimes = Mapping[int, list[tuple[int, int]]]
"""What the index records behind a chunk tell: per connection, the log time and the offset of each of its messages."""


def indexed_times(view: memoryview, offset: int) -> IndexedTimes:
    """The index records from ``offset`` on, one behind the other, as far as they can be read."""
    entries: dict[int, list[tuple[int, int]]] = {}
    for record in bag_records(view, offset, len(view)):
        channel, count = number(record.fields, b"conn"), number(record.fields, b"count")
        if (
            record.op != OP_INDEX
            or not record.whole
            or channel is None
            or record.end - record.begin != 12 * (count or 0)
        ):
            break
        rows = _index_entry.iter_unpack(view[record.begin : record.end])
        entries[channel] = [(sec * 10**9 + nanosec, at) for sec, nanosec, at in rows]
    return entries


class BagMessages(NamedTuple):
    """The wanted messages of a chunk; ``broken`` when its records do not add up to its content or are none that chunks
    have, ``strangers`` how many messages are of no connection of the bag.
    """

    found: list[RawMessage]
    broken: bool
    strangers: int


def bag_messages(data: bytes | memoryview, want: Wanted) -> BagMessages:
    """The wanted messages of a chunk's content by log time, equal times as they were written; views into ``data``."""
    view, found, reached, strangers, odd = memoryview(data), list[RawMessage](), 0, 0, False
    for record in bag_records(view, 0, len(view)):
        if not record.whole:
            break
        reached = record.end
        if record.op == OP_MESSAGE:
            stranger, placed = _take(record, view, want, found)
            strangers, odd = strangers + stranger, odd or not placed
        elif record.op != OP_CONNECTION:  # there is nothing else in chunks
            odd = True
    found.sort(key=_log_ns)
    return BagMessages(found, odd or reached != len(view), strangers)


def bag_messages_at(data: bytes | memoryview, want: Wanted, times: IndexedTimes) -> list[RawMessage]:
    """The same of a content whose records are broken: those messages that lie, whole, where the index says."""
    view, found = memoryview(data), list[RawMessage]()
    for record in _there(view, times):
        _take(record, view, want, found)
    found.sort(key=_log_ns)
    return found


def missing_counts(data: bytes | memoryview, times: IndexedTimes) -> dict[int, int]:
    """How many messages of which connection the index tells of that are not in a chunk's content."""
    missing = {channel: len(rows) for channel, rows in times.items()}
    for record in _there(memoryview(data), times):
        missing[number(record.fields, b"conn") or 0] -= 1
    return missing


def _there(view: memoryview, times: IndexedTimes) -> Iterator[BagRecord]:
    """The whole messages that lie where the index says, by their offsets."""
    for at, log_ns, channel in sorted((at, t, channel) for channel, rows in times.items() for t, at in rows):
        record = next(bag_records(view, at, len(view)), None) if at < len(view) else None
        if record is None or not record.whole or record.op != OP_MESSAGE:
            continue
        if number(record.fields, b"conn") == channel and time_ns(record.fields, b"time") == log_ns:
            yield record


def _take(record: BagRecord, view: memoryview, want: Wanted, found: list[RawMessage]) -> tuple[bool, bool]:
    """Append a message if it is wanted; whether it is of no connection of the bag, and if it says which and when."""
    connection_id, log_ns = number(record.fields, b"conn"), time_ns(record.fields, b"time")
    channel = want.channels.get(connection_id) if connection_id is not None else None
    if channel is not None and log_ns is not None and want.start_ns <= log_ns <= want.end_ns:
        found.append(RawMessage(channel, log_ns, view[record.begin : record.end]))
    return connection_id not in want.declared, connection_id is not None and log_ns is not None
