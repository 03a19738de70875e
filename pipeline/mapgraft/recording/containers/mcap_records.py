"""The records of an MCAP file, walked without copying, or fetching, what is not needed.

Source: the MCAP format specification, version 0.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import ChunkIndex, Footer, Header, Schema, Statistics

from mapgraft.recording.containers.inflate import Content, inflate
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.octets import Octets, unpacked

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = 9  # opcode 1, length 8
MESSAGE_HEAD = RECORD_HEAD + 22  # channel 2, sequence 4, log time 8, publish time 8
FOOTER_BYTES = RECORD_HEAD + 20 + len(MAGIC)

OPCODE_MESSAGE = int(Opcode.MESSAGE)
OPCODE_CHUNK = int(Opcode.CHUNK)
OPCODE_SCHEMA = int(Opcode.SCHEMA)
OPCODE_CHANNEL = int(Opcode.CHANNEL)
OPCODE_DATA_END = int(Opcode.DATA_END)
OPCODE_MESSAGE_INDEX = int(Opcode.MESSAGE_INDEX)
KNOWN_OPCODES = frozenset(int(opcode) for opcode in Opcode)

Parsed = ChannelRecord | ChunkIndex | Footer | Header | Schema | Statistics
UNREADABLE = (McapError, struct.error, UnicodeDecodeError, ValueError, OverflowError, MemoryError)

_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")  # start, end, size, crc, length of the compression's name
_LENGTH = struct.Struct("<Q")
_READERS: dict[int, Callable[[ReadDataStream], Parsed]] = {
    int(Opcode.HEADER): Header.read,
    int(Opcode.FOOTER): Footer.read,
    int(Opcode.SCHEMA): Schema.read,
    int(Opcode.CHANNEL): ChannelRecord.read,
    int(Opcode.STATISTICS): Statistics.read,
    int(Opcode.CHUNK_INDEX): ChunkIndex.read,
}


class Record(NamedTuple):
    """Where a record lies: its body is ``view[begin:end]``; ``whole`` is False when the bytes end before it does."""

    opcode: int
    offset: int
    begin: int
    end: int
    whole: bool


def records(view: Octets, start: int, stop: int) -> Iterator[Record]:
    """The records in ``view[start:stop]``; the last one may be cut. Stops where there is no record any more."""
    while stop - start >= RECORD_HEAD:
        opcode, length = unpacked(_HEAD, view, start)
        if opcode == 0:
            return
        end = start + RECORD_HEAD + length
        yield Record(opcode, start, start + RECORD_HEAD, min(end, stop), end <= stop)
        start = end


def parsed(view: Octets, record: Record) -> Parsed | None:
    """The record as a value of the ``mcap`` library; None for an opcode that is not needed, or a broken body."""
    reader = _READERS.get(record.opcode)
    if reader is None or not record.whole:
        return None
    try:
        return reader(ReadDataStream(BytesIO(view[record.begin : record.end])))
    except UNREADABLE:
        return None


def is_parsed(opcode: int) -> bool:
    """Whether ``parsed`` knows records of this kind."""
    return opcode in _READERS


def index_channel(view: Octets, record: Record) -> int:
    """The channel that a whole message index record is of."""
    return int.from_bytes(view[record.begin : record.begin + 2], "little")


class ChunkHead(NamedTuple):
    """The head of a chunk record; its packed bytes are ``view[begin:end]``.

    These are less than ``packed_bytes`` where the file was cut.
    """

    start_ns: int
    end_ns: int
    size: int
    crc: int
    compression: str
    begin: int
    end: int
    packed_bytes: int


def chunk_head(view: Octets, record: Record) -> ChunkHead | None:
    """The head of a chunk, also of a cut one; None when even the head is broken."""
    try:
        start_ns, end_ns, size, crc, name_bytes = unpacked(_CHUNK_HEAD, view, record.begin)
        at = record.begin + 32
        compression = str(view[at : at + name_bytes], "ascii")
        (packed_bytes,) = unpacked(_LENGTH, view, at + name_bytes)
    except (struct.error, UnicodeDecodeError):
        return None
    begin = at + name_bytes + 8
    if begin > record.end or (record.whole and begin + packed_bytes > record.end):
        return None
    return ChunkHead(
        start_ns, end_ns, size, crc, compression, begin, min(begin + packed_bytes, record.end), packed_bytes
    )


def chunk_content(view: Octets, offset: int, end: int, limits: ReadLimits) -> Content:
    """What a place in the file holds: a chunk's content, or the bare records themselves in a file without chunks."""
    record = next(records(view, offset, end), None)
    if record is None or record.opcode not in KNOWN_OPCODES:
        return Content(b"", "is not a chunk")
    if record.opcode != OPCODE_CHUNK:
        return Content(view[offset:end])
    head = chunk_head(view, record)
    if head is None:
        return Content(b"", "has a broken head")
    cut = head.end - head.begin < head.packed_bytes
    return inflate(
        head.compression, view[head.begin : head.end], head.size, head.crc, limit=limits.chunk_bytes, cut=cut
    )
