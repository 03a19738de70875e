"""MCAP files written record by record, so that a test knows every byte's meaning and may write what no writer would."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import lz4.frame
import pytest
import zstandard

MAGIC = b"\x89MCAP0\r\n"


class Told(NamedTuple):
    """One message of a file: which topic, when, and what."""

    topic: str
    log_ns: int
    data: bytes


class ChunkBytes(NamedTuple):
    """Where a chunk's record lies in a file, and its messages in the order of writing."""

    begin: int
    end: int
    messages: tuple[Told, ...]


def text(value: str) -> bytes:
    return struct.pack("<I", len(value.encode())) + value.encode()


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def packed(compression: str, data: bytes) -> bytes:
    if compression == "zstd":
        return zstandard.ZstdCompressor().compress(data)
    return bytes(lz4.frame.compress(data)) if compression == "lz4" else data


@dataclass(slots=True)
class McapBytes:
    """Builds a file: ``chunk`` for each chunk, ``bare`` for messages outside of them, then ``finish``.

    Channels are described where they first occur, with ``declare="every"`` in each chunk anew. Their messages are
    JSON by name and need no schema, so any bytes will do.
    """

    compression: str = "zstd"
    declare: str = "first"
    checksums: bool = True
    message_indexes: bool = True
    channels: dict[str, int] = field(default_factory=dict)
    chunks: list[ChunkBytes] = field(default_factory=list)
    data: bytearray = field(default_factory=lambda: bytearray(MAGIC + record(1, text("") + text("test"))))
    entries: list[bytes] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)

    def channel(self, topic: str, *, number: int | None = None, encoding: str = "json", schema: int = 0) -> bytes:
        number = self.channels.setdefault(topic, len(self.channels) + 1) if number is None else number
        return record(4, struct.pack("<HH", number, schema) + text(topic) + text(encoding) + struct.pack("<I", 0))

    def message(self, told: Told, number: int | None = None) -> bytes:
        channel = self.channels[told.topic] if number is None else number
        self.counts[channel] = self.counts.get(channel, 0) + 1
        return record(5, struct.pack("<HIQQ", channel, 0, told.log_ns, told.log_ns) + told.data)

    def content(self, messages: Sequence[Told]) -> tuple[bytes, dict[int, list[tuple[int, int]]]]:
        """A chunk's content, and per channel the (log time, offset) of its messages."""
        out, index, declared = bytearray(), dict[int, list[tuple[int, int]]](), set[str]()
        for told in messages:
            if told.topic not in (declared if self.declare == "every" else self.channels):
                out += self.channel(told.topic)
            declared.add(told.topic)
            index.setdefault(self.channels[told.topic], []).append((told.log_ns, len(out)))
            out += self.message(told)
        return bytes(out), index

    def chunk(self, messages: Sequence[Told]) -> ChunkBytes:
        content, index = self.content(messages)
        return self.chunk_of(content, index, messages)

    def chunk_of(
        self, content: bytes, index: dict[int, list[tuple[int, int]]], messages: Sequence[Told] = ()
    ) -> ChunkBytes:
        times = [log_ns for rows in index.values() for log_ns, _ in rows] or [0]
        body = packed(self.compression, content)
        crc = zlib.crc32(content) if self.checksums else 0
        head = struct.pack("<QQQI", min(times), max(times), len(content), crc) + text(self.compression)
        begin = len(self.data)
        self.data += record(6, head + struct.pack("<Q", len(body)) + body)
        end = len(self.data)
        offsets = dict[int, int]()
        for channel, rows in index.items() if self.message_indexes else ():
            offsets[channel] = len(self.data)
            listed = b"".join(struct.pack("<QQ", *row) for row in rows)
            self.data += record(7, struct.pack("<HI", channel, len(listed)) + listed)
        where = b"".join(struct.pack("<HQ", *item) for item in offsets.items())
        entry = struct.pack("<QQQQI", min(times), max(times), begin, end - begin, len(where)) + where
        entry += struct.pack("<Q", len(self.data) - end) + text(self.compression)
        self.entries.append(record(8, entry + struct.pack("<QQ", len(body), len(content))))
        found = ChunkBytes(begin, end, tuple(messages))
        self.chunks.append(found)
        return found

    def bare(self, messages: Sequence[Told]) -> None:
        for told in messages:
            if told.topic not in self.channels:
                self.data += self.channel(told.topic)
            self.data += self.message(told)

    def finish(
        self, *, chunk_index: bool = True, channels: bool = True, statistics: bool = True, checksum: bool = True
    ) -> bytes:
        """The whole file with its data end, summary, footer and end mark."""
        self.data += record(15, bytes(4))
        begin = len(self.data)
        if channels:
            for topic, number in self.channels.items():
                self.data += self.channel(topic, number=number)
        if statistics:
            counts = b"".join(struct.pack("<HQ", *item) for item in self.counts.items())
            numbers = struct.pack(
                "<QHIIIIQQ", sum(self.counts.values()), 0, len(self.channels), 0, 0, len(self.chunks), 0, 0
            )
            self.data += record(11, numbers + struct.pack("<I", len(counts)) + counts)
        for entry in self.entries if chunk_index else ():
            self.data += entry
        start = begin if len(self.data) > begin else 0
        footer = struct.pack("<BQ", 2, 20) + struct.pack("<QQ", start, 0)
        crc = zlib.crc32(self.data[begin:] + footer) if checksum else 0
        self.data += footer + struct.pack("<I", crc) + MAGIC
        return bytes(self.data)


@pytest.fixture(scope="session")
def mcap_bytes() -> type[McapBytes]:
    return McapBytes


@pytest.fixture(scope="session")
def told_type() -> type[Told]:
    return Told
