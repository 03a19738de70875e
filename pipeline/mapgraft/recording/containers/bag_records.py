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
from mapgraft.recording.containers.selection import Wanted

MAGIC = b"#ROSBAG V2.0\n"
OP_MESSAGE, OP_BAG, OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION = 2, 3, 5, 6, 7

Fields = Mapping[bytes, bytes]

_uint32 = struct.Struct("<I").unpack_from
_time = struct.Struct("<II").unpack
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


def bag_content(view: memoryview, offset: int, end: int) -> Content:
    """What the chunk record at ``view[offset:end]`` holds."""
    record = next(bag_records(view, offset, end), None)
    if record is None or record.op != OP_CHUNK:
        return Content(b"", "is not a chunk")
    size = number(record.fields, b"size")
    if size is None:
        return Content(b"", "has a broken head")
    compression = record.fields.get(b"compression", b"").decode(errors="replace")
    return inflate(compression, view[record.begin : record.end], size)


class BagMessages(NamedTuple):
    """The wanted messages of a chunk; ``broken`` when its records do not add up to its content, ``strangers`` how many
    messages are of no connection of the bag.
    """

    found: list[RawMessage]
    broken: bool
    strangers: int


def bag_messages(data: bytes | memoryview, want: Wanted) -> BagMessages:
    """The wanted messages of a chunk's content by log time, equal times as they were written; views into ``data``."""
    view, found, reached, strangers = memoryview(data), list[RawMessage](), 0, 0
    for record in bag_records(view, 0, len(view)):
        if not record.whole:
            break
        reached = record.end
        if record.op != OP_MESSAGE:
            continue
        connection_id, log_ns = number(record.fields, b"conn"), time_ns(record.fields, b"time")
        channel = want.channels.get(connection_id) if connection_id is not None else None
        strangers += connection_id not in want.declared
        if channel is not None and log_ns is not None and want.start_ns <= log_ns <= want.end_ns:
            found.append(RawMessage(channel, log_ns, view[record.begin : record.end]))
    found.sort(key=_log_ns)
    return BagMessages(found, reached != len(view), strangers)
