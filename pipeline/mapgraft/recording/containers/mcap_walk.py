"""The chunks of an MCAP file found by walking its records, across damage and up to wherever the file was cut."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from mapgraft.contracts.sources import ReadFaults
from mapgraft.recording.containers.mcap_records import (
    KNOWN_OPCODES,
    MAGIC,
    OPCODE_CHANNEL,
    OPCODE_CHUNK,
    OPCODE_MESSAGE,
    OPCODE_MESSAGE_INDEX,
    OPCODE_SCHEMA,
    Record,
    index_channel,
    parsed,
)
from mapgraft.recording.containers.mcap_shapes import (
    fits,
    is_cut_chunk,
    is_tight,
    may_begin,
    next_beginning,
    record_at,
)
from mapgraft.recording.containers.octets import Octets

BARE_BLOCK_BYTES = 1 << 20
"""Messages outside chunks are read in blocks of about this size."""

_ANOTHER = re.compile(re.escape(MAGIC) + b"\x01")  # and the header, which every file begins with


@dataclass(slots=True)
class Piece:
    """A chunk with where the message indexes behind it lie, by channel, or a block of messages outside chunks.

    ``indexed`` says that nothing is missing between the chunk and what comes after its message indexes.
    """

    offset: int
    end: int
    is_chunk: bool
    indexes: dict[int, int] = field(default_factory=dict)
    indexed: bool = True


class Walk:
    """One walk through ``view[start:stop]``; what is skipped is added to ``faults``.

    Schemas and channels outside chunks are handed to ``declare``.
    """

    def __init__(self, view: Octets, faults: ReadFaults, declare: Callable[[object], None]) -> None:
        self._view = view
        self._faults = faults
        self._declare = declare
        self.joined = False  # whether another file begins in the middle of this one
        self._bare = False
        self._broken = False  # since the piece at hand

    def pieces(self, start: int, stop: int) -> Iterator[Piece]:
        """The chunks and blocks in the order of the file."""
        piece: Piece | None = None
        self._broken = False
        for record in self._records(start, stop):
            if piece is not None:
                if self._joins(piece, record):
                    continue
                yield self._closed(piece)
                piece = None
            if record.opcode in (OPCODE_CHUNK, OPCODE_MESSAGE):
                piece = Piece(record.offset, record.end, record.opcode == OPCODE_CHUNK)
                self._broken = False
            elif record.opcode in (OPCODE_SCHEMA, OPCODE_CHANNEL):
                self._declare(parsed(self._view, record))
        if piece is not None:
            self._broken |= stop == len(self._view)  # the next message index may have been cut off
            yield self._closed(piece)

    def _joins(self, piece: Piece, record: Record) -> bool:
        """Whether a record belongs to the piece at hand; then it is taken in."""
        if piece.is_chunk and record.opcode == OPCODE_MESSAGE_INDEX and not self._broken:
            piece.indexes[index_channel(self._view, record)] = record.offset
            return True
        bare = not piece.is_chunk and record.opcode == OPCODE_MESSAGE
        if not bare or record.offset != piece.end or record.offset - piece.offset >= BARE_BLOCK_BYTES:
            return False
        piece.end = record.end
        return True

    def _closed(self, piece: Piece) -> Piece:
        piece.indexed = piece.is_chunk and bool(piece.indexes) and not self._broken
        return piece

    def _records(self, at: int, stop: int) -> Iterator[Record]:
        """The records that can be told, one after another."""
        view = self._view
        while at < stop:
            record = record_at(view, at, stop)
            if record is not None and self._is_sound(record, stop):
                self._bare |= record.opcode == OPCODE_MESSAGE
                yield record
                at = record.end
            elif bytes(view[at : at + len(MAGIC)]) == MAGIC:  # the end, or another file joined to this one
                self.joined |= _ANOTHER.match(view[at : at + len(MAGIC) + 1]) is not None
                at += len(MAGIC)
            else:
                found = next_beginning(view, at + 1, stop, bare=self._bare)
                self._skip(at, found, stop)
                at = found

    def _is_sound(self, record: Record, stop: int) -> bool:
        view = self._view
        if not record.whole:
            return stop == len(view) and is_cut_chunk(view, record)
        if not fits(view, record):
            return False
        if is_tight(view, record) or may_begin(view, record.end, stop):
            return True
        if record.opcode != OPCODE_MESSAGE:
            return False
        # Either its length is wrong or what comes behind it is damaged: then nothing begins within it.
        return next_beginning(view, record.begin, record.end, bare=True) == record.end

    def _skip(self, begin: int, end: int, stop: int) -> None:
        self._broken = True
        if end == stop == len(self._view) and self._view[begin] in KNOWN_OPCODES:
            return  # a record that the file's end cuts
        self.joined |= _ANOTHER.search(self._view[begin:end]) is not None
        sentence = f"{end - begin} bytes at byte {begin} cannot be read as records: they are skipped"
        self._faults.add("records_damaged", sentence, place=begin)
