"""The chunks of a ROS 1 bag found by walking its records, across damage and up to wherever the bag was cut."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from mapgraft.contracts.sources import ReadFaults
from mapgraft.recording.containers.bag_records import (
    OP_BAG,
    OP_CHUNK,
    OP_CHUNK_INFO,
    OP_CONNECTION,
    OP_INDEX,
    OP_MESSAGE,
    BagRecord,
    Connection,
    Fields,
    bag_records,
    connection,
    number,
    time_ns,
)
from mapgraft.recording.containers.inflate import COMPRESSIONS

BARE_BLOCK_BYTES = 1 << 20
"""Messages outside chunks are read in blocks of about this size."""

_BEGINNINGS = (b"\x04\x00\x00\x00op=\x05", b"\x04\x00\x00\x00op=\x07")  # chunks and connections
_BEFORE_OP = (0, 13, 19, 20, 32, 33)  # bytes of the fields that may stand before "op": conn or size, compression
_LONGEST_HEADER = 4096  # bytes; topics are part of headers
_FIRST_WINDOW_BYTES, _WINDOW_BYTES = 4 << 10, 4 << 20  # windows grow, so that near things are found at small cost
_uint32 = struct.Struct("<I").unpack_from


@dataclass(slots=True)
class BagPiece:
    """A chunk with where the index records behind it lie, by connection, or a block of messages outside chunks.

    ``indexed`` says that nothing is missing between the chunk and what comes after its index records.
    """

    offset: int
    end: int
    is_chunk: bool
    indexes: dict[int, int] = field(default_factory=dict)
    indexed: bool = True


class BagWalk:
    """One walk through a bag; what is skipped is added to ``faults``.

    Connections outside chunks are handed to ``declare``.
    """

    def __init__(self, view: memoryview, faults: ReadFaults, declare: Callable[[Connection | None], None]) -> None:
        self._view = view
        self._faults = faults
        self._declare = declare
        self._broken = False  # since the piece at hand

    def pieces(self, start: int) -> Iterator[BagPiece]:
        """The chunks and blocks in the order of the file."""
        piece: BagPiece | None = None
        for record in self._records(start):
            if record.op == OP_CONNECTION:
                self._declare(connection(self._view, record))
            if piece is not None and self._joins(piece, record):
                continue
            if piece is not None:
                yield self._closed(piece)
                piece = None
            if record.op in (OP_CHUNK, OP_MESSAGE):
                piece = BagPiece(record.offset, record.end, record.op == OP_CHUNK)
                self._broken = False
        if piece is not None:
            self._broken = True  # the next index record may have been cut off
            yield self._closed(piece)

    def _joins(self, piece: BagPiece, record: BagRecord) -> bool:
        """Whether a record belongs to the piece at hand; then it is taken in."""
        if piece.is_chunk:
            channel = number(record.fields, b"conn")
            if record.op != OP_INDEX or channel is None or self._broken:
                return False
            piece.indexes[channel] = record.offset
            return True
        bare = record.op in (OP_MESSAGE, OP_CONNECTION) and record.offset == piece.end
        if not bare or record.offset - piece.offset >= BARE_BLOCK_BYTES:
            return False
        piece.end = record.end
        return True

    def _closed(self, piece: BagPiece) -> BagPiece:
        piece.indexed = piece.is_chunk and bool(piece.indexes) and not self._broken
        return piece

    def _records(self, at: int) -> Iterator[BagRecord]:
        """The records that can be told, one after another."""
        view, stop = self._view, len(self._view)
        while at < stop:
            record = next(bag_records(view, at, stop), None)
            sound = None if record is None else self._sound(record)
            if sound is not None:
                yield sound
                at = sound.end
            else:
                found = next_beginning(view, at + 1)
                if not (found == stop and record is not None and not record.whole):  # that one the end cuts
                    self._skip(at, found)
                at = found

    def _sound(self, record: BagRecord) -> BagRecord | None:
        """The record with its true end; None when it is none."""
        view = self._view
        if not _has_its_fields(record.op, record.fields):
            return None
        if record.whole and may_begin(view, record.end):
            return record
        if record.op == OP_CHUNK:
            return self._chunk(record)
        # Either its length is wrong or what comes behind it is damaged: then nothing begins within it.
        return record if record.whole and next_beginning(view, record.begin) >= record.end else None

    def _chunk(self, record: BagRecord) -> BagRecord:
        """A chunk that is cut, never finished (it says that it is empty), or says a wrong length."""
        following = next_beginning(self._view, record.begin, _BEGINNINGS[:1])  # chunks may hold connections
        size = number(record.fields, b"size")
        if record.whole and record.end - record.begin and following >= record.end:
            return record  # what comes behind it is damaged
        if size == 0 or following < record.end:
            self._broken = True
            return record._replace(end=following, whole=following < len(self._view))
        return record

    def _skip(self, begin: int, end: int) -> None:
        self._broken = True
        sentence = f"{end - begin} bytes at byte {begin} cannot be read as records: they are skipped"
        self._faults.add("records_damaged", sentence, place=begin)


def _has_its_fields(op: int, fields: Fields) -> bool:
    if op == OP_CHUNK:
        return number(fields, b"size") is not None and fields.get(b"compression", b"").decode("latin") in COMPRESSIONS
    if op == OP_MESSAGE:
        return number(fields, b"conn") is not None and time_ns(fields, b"time") is not None
    if op == OP_CONNECTION:
        return number(fields, b"conn") is not None and b"topic" in fields
    if op == OP_INDEX:
        return number(fields, b"conn") is not None and number(fields, b"count") is not None
    return op in (OP_BAG, OP_CHUNK_INFO)


def may_begin(view: memoryview, at: int) -> bool:
    """Whether a record, or the end of the bag, can be at a place."""
    stop = len(view)
    if at == stop:
        return True
    record = next(bag_records(view, at, stop), None)
    if record is not None:
        return _has_its_fields(record.op, record.fields)
    if stop - at < 4:
        return True
    (header_bytes,) = _uint32(view, at)
    return bool(header_bytes <= _LONGEST_HEADER and at + 8 + header_bytes > stop)  # the end cuts a header


def next_beginning(view: memoryview, at: int, marks: Sequence[bytes] = _BEGINNINGS) -> int:
    """Where the next chunk or connection begins; the end of the bag when there is none."""
    begin, stop, width = at, len(view), _FIRST_WINDOW_BYTES
    while begin < stop:
        window = bytes(view[begin : min(begin + width + len(_BEGINNINGS[0]), stop)])
        for place in sorted(place for mark in marks for place in _places_of(mark, window)):
            start = _header_around(view, begin + place, at)
            if start is not None:
                return start
        begin, width = begin + width, min(2 * width, _WINDOW_BYTES)
    return stop


def _places_of(mark: bytes, window: bytes) -> Iterator[int]:
    place = window.find(mark)
    while place >= 0:
        yield place
        place = window.find(mark, place + 1)


def _header_around(view: memoryview, mark: int, least: int) -> int | None:
    """Where the record begins whose header has this field, not before ``least``; None when there is none."""
    for before in _BEFORE_OP:
        start = mark - before - 4
        if start < least or not before + 8 <= _uint32(view, start)[0] <= _LONGEST_HEADER:
            continue
        record = next(bag_records(view, start, len(view)), None)
        if record is None or record.op != view[mark + 7] or not _has_its_fields(record.op, record.fields):
            continue
        if record.op == OP_CHUNK or (record.whole and may_begin(view, record.end)):
            return start
    return None
