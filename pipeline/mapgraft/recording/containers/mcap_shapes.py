"""Whether bytes can be a record of an MCAP file, and where the next one begins behind bytes that cannot.

Nothing in an MCAP file marks where a record begins, so after damage the next chunk is found by what it says of itself
twice: its record's length and the length of what is packed in it.
"""

from __future__ import annotations

import struct

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from mapgraft.recording.containers.mcap_records import (
    KNOWN_OPCODES,
    MAGIC,
    MESSAGE_HEAD,
    OPCODE_CHUNK,
    OPCODE_MESSAGE,
    OPCODE_MESSAGE_INDEX,
    RECORD_HEAD,
    Record,
    is_parsed,
    parsed,
)
from mapgraft.recording.containers.octets import Octets, unpacked

PRIVATE = 0x80  # opcodes from here on are for anybody's own use
CHUNK_HEAD = 40  # bytes of a chunk record's body beside the compression's name and what is packed
LONGEST_NAME = 16  # bytes of a compression's name

_CHAIN = 3  # messages in a row that make a beginning believable
_FIRST_WINDOW_BYTES, _WINDOW_BYTES = 4 << 10, 4 << 20  # windows grow, so that near things are found at small cost
_READ_BYTES = 64 << 10  # longer records are not looked into only to believe what comes before them
_ATTACHMENT = int(Opcode.ATTACHMENT)
_FIXED = {int(Opcode.FOOTER): 20, int(Opcode.DATA_END): 4, int(Opcode.SUMMARY_OFFSET): 17}

_HEAD = struct.Struct("<BQ")
_INDEX_HEAD = struct.Struct("<HI")
_UINT32 = struct.Struct("<I")
_UINT64 = struct.Struct("<Q")


def record_at(view: Octets, at: int, stop: int) -> Record | None:
    """The record at a place, which may be cut at ``stop``; None when there can be none."""
    if stop - at < RECORD_HEAD:
        return None
    opcode, length = unpacked(_HEAD, view, at)
    if opcode == 0 or (opcode not in KNOWN_OPCODES and opcode < PRIVATE and length > stop - at):
        return None
    end = at + RECORD_HEAD + length
    return Record(opcode, at, at + RECORD_HEAD, min(end, stop), end <= stop)


def fits(view: Octets, record: Record) -> bool:
    """Whether a whole record's body adds up to its length; its last bytes may be unknown, for later versions."""
    length = record.end - record.begin
    if record.opcode == OPCODE_CHUNK:
        return (stated := _stated_chunk_bytes(view, record)) is not None and stated <= length
    if record.opcode == OPCODE_MESSAGE:
        return length >= MESSAGE_HEAD - RECORD_HEAD
    if record.opcode == OPCODE_MESSAGE_INDEX:
        if length < 6:
            return False
        _, size = unpacked(_INDEX_HEAD, view, record.begin)
        return bool(size % 16 == 0 and size <= length - 6)
    if record.opcode == _ATTACHMENT:
        return _attachment_bytes(view, record) == length
    if record.opcode in _FIXED:
        return length == _FIXED[record.opcode]
    return not is_parsed(record.opcode) or parsed(view, record) is not None


def is_tight(view: Octets, record: Record) -> bool:
    """Whether the body is so full of lengths that agree that only a record can look so."""
    length = record.end - record.begin
    if record.opcode == OPCODE_CHUNK:
        return _stated_chunk_bytes(view, record) == length
    if record.opcode == OPCODE_MESSAGE_INDEX:
        return length >= 6 and unpacked(_INDEX_HEAD, view, record.begin)[1] == length - 6
    return record.opcode == _ATTACHMENT or is_parsed(record.opcode)


def is_cut_chunk(view: Octets, record: Record) -> bool:
    """Whether a record that the file's end cuts is the beginning of a chunk and no false length."""
    if record.opcode != OPCODE_CHUNK or record.end - record.begin < CHUNK_HEAD:
        return False
    stated = _stated_chunk_bytes(view, record)
    return stated is not None and stated == unpacked(_HEAD, view, record.offset)[1]


def may_begin(view: Octets, at: int, stop: int) -> bool:
    """Whether a record, the end mark or the end of it all can be at a place."""
    if at == stop or bytes(view[at : at + len(MAGIC)]) == MAGIC:
        return True
    record = record_at(view, at, stop)
    if record is None:
        return stop == len(view) and 0 < stop - at < RECORD_HEAD and view[at] in KNOWN_OPCODES
    return record.whole or (
        stop == len(view) and record.opcode in KNOWN_OPCODES and unpacked(_HEAD, view, at)[1] < 1 << 40
    )


def _stated_chunk_bytes(view: Octets, record: Record) -> int | None:
    """The length of a chunk's body as what is in it says; None when not even that can be read."""
    try:
        (name_bytes,) = unpacked(_UINT32, view, record.begin + 28)
        if name_bytes > LONGEST_NAME:
            return None
        return int(CHUNK_HEAD + name_bytes + unpacked(_UINT64, view, record.begin + 32 + name_bytes)[0])
    except struct.error:
        return None


def _attachment_bytes(view: Octets, record: Record) -> int | None:
    at = record.begin + 16  # log and creation time
    for _ in range(2):  # name and media type
        if record.end - at < 4:
            return None
        at += 4 + int(unpacked(_UINT32, view, at)[0])
    if record.end - at < 8:
        return None
    return int(at + 8 + unpacked(_UINT64, view, at)[0] + 4 - record.begin)


def next_beginning(view: Octets, at: int, stop: int, *, bare: bool) -> int:
    """Where the next chunk begins, or (``bare``: in files with messages outside chunks) the next row of messages.

    ``stop`` when there is none.
    """
    width = _FIRST_WINDOW_BYTES
    while at < stop:
        end = min(at + width, stop)
        found = _first_chunk(view, at, end, stop)
        if bare:
            found = min(found, _first_messages(view, at, end, stop))
        if found < stop:
            return found
        at, width = end, min(2 * width, _WINDOW_BYTES)
    return stop


def _octets(view: Octets, begin: int, end: int, stop: int, reach: int) -> NDArray[np.uint8]:
    """The bytes of a window and ``reach`` more, with zeros behind the end of the file."""
    octets = np.frombuffer(view[begin : min(end + reach, stop)], np.uint8)
    missing = end - begin + reach - len(octets)
    return np.concatenate([octets, np.zeros(missing, np.uint8)]) if missing else octets


def _first_chunk(view: Octets, begin: int, end: int, stop: int) -> int:
    octets = _octets(view, begin, end, stop, RECORD_HEAD + 32)
    count = end - begin
    likely = octets[:count] == OPCODE_CHUNK
    for zero in (7, 8, 38, 39, 40):  # no length reaches 2⁴⁸, and no compression has a name of 256 letters
        likely &= octets[zero : zero + count] == 0
    for at in np.flatnonzero(likely).tolist():
        record = record_at(view, begin + at, stop)
        if record is not None and (
            (record.whole and is_tight(view, record)) or (stop == len(view) and is_cut_chunk(view, record))
        ):
            return begin + int(at)
    return stop


def _first_messages(view: Octets, begin: int, end: int, stop: int) -> int:
    octets = _octets(view, begin, end, stop, RECORD_HEAD)
    count = end - begin
    likely = octets[:count] == OPCODE_MESSAGE
    for zero in (5, 6, 7, 8):
        likely &= octets[zero : zero + count] == 0
    for at in np.flatnonzero(likely).tolist():
        if _is_chain(view, begin + at, stop):
            return begin + int(at)
    return stop


def _is_chain(view: Octets, at: int, stop: int) -> bool:
    """Whether a few records in a row, or all up to the end, look right."""
    for _ in range(_CHAIN):
        record = record_at(view, at, stop)
        if record is None or not record.whole or record.opcode not in KNOWN_OPCODES:
            return False
        if record.end - record.begin <= _READ_BYTES and not fits(view, record):
            return False
        at = record.end
        if at == stop:
            return True
    return may_begin(view, at, stop)
