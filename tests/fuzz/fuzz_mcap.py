"""MCAP files put together of records, and taken apart again to be damaged where it hurts: in single records.

Random bytes hardly ever get past checksums and lengths; so what is taken apart is changed and put together anew, with
all lengths, indexes and checksums right, or some of them wrong on purpose.
"""

from __future__ import annotations

import bz2
import random
import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import lz4.frame
import zstandard
from fuzz_mutations import Damage

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = 1, 2, 3, 4, 5, 6, 7, 8
ATTACHMENT, STATISTICS, DATA_END = 9, 11, 15
EDGES = (0, 1, 2, 9, 255, 256, 65535, 2**31, 2**32 - 1, 2**40, 2**62, 2**63, 2**64 - 1)
S = 1_000_000_000


@dataclass(frozen=True)
class Record:
    """A record outside chunks or in one."""

    opcode: int
    body: bytes

    def packed(self) -> bytes:
        return struct.pack("<BQ", self.opcode, len(self.body)) + self.body


@dataclass(frozen=True)
class Chunk:
    """Records in a chunk; ``lie`` is what to say wrongly of it: ``size``, ``crc``, ``start``, ``end``, ``name``."""

    records: tuple[Record, ...]
    compression: str = ""
    lie: str = ""


@dataclass(frozen=True)
class Told:
    """What a file tells beside its chunks; ``wrong`` names what of it is wrong on purpose."""

    crcs: bool = True
    message_indexes: bool = True
    chunk_indexes: bool = True
    statistics: bool = True
    summary: bool = True
    ended: bool = True
    wrong: frozenset[str] = field(default_factory=frozenset)


WRONG = ("summary_crc", "summary_start", "index_offset", "index_times", "index_nowhere", "count")
WRONG += ("entries", "entries_order", "entries_few", "entries_none", "entries_long", "entries_other", "entries_twice")


def text(value: str) -> bytes:
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def schema(number: int, name: str, encoding: str = "ros2msg", data: bytes = b"") -> Record:
    return Record(SCHEMA, struct.pack("<H", number) + text(name) + text(encoding) + struct.pack("<I", len(data)) + data)


def channel(number: int, schema_id: int, topic: str, encoding: str = "cdr", metadata: bytes = b"") -> Record:
    head = struct.pack("<HH", number, schema_id)
    return Record(CHANNEL, head + text(topic) + text(encoding) + struct.pack("<I", len(metadata)) + metadata)


def message(channel_id: int, log_ns: int, data: bytes = b"") -> Record:
    return Record(MESSAGE, struct.pack("<HIQQ", channel_id, 0, log_ns, log_ns) + data)


@cache
def _zstd() -> zstandard.ZstdCompressor:
    return zstandard.ZstdCompressor(level=1)


def _in_pieces(data: bytes) -> bytes:
    """More blocks than so many bytes need."""
    packer = lz4.frame.LZ4FrameCompressor(auto_flush=True)
    pieces = [data[at : at + 100] for at in range(0, len(data), 100)]
    return packer.begin(len(data)) + b"".join(map(packer.compress, pieces)) + packer.flush()


_PACK: dict[str, Callable[[bytes], bytes]] = {
    "zstd": lambda data: _zstd().compress(data),
    "lz4": lz4.frame.compress,
    "lz4-unsized": lambda data: lz4.frame.compress(data, store_size=False),
    "lz4-large": lambda data: lz4.frame.compress(data, block_size=lz4.frame.BLOCKSIZE_MAX4MB, block_checksum=True),
    "lz4-pieces": _in_pieces,
    "bz2": bz2.compress,
}


@dataclass
class _Written:
    """A chunk as it stands in the file."""

    begin: int
    length: int
    start_ns: int
    end_ns: int
    entries: dict[int, list[tuple[int, int]]]
    indexes: dict[int, int] = field(default_factory=dict)
    index_length: int = 0
    compression: str = ""
    packed: int = 0
    size: int = 0


def assembled(items: Sequence[Record | Chunk], told: Told = Told()) -> bytes:
    """An MCAP file of these records and chunks, with what is told of them."""
    out, written = bytearray(MAGIC), []
    for item in items:
        if isinstance(item, Chunk):
            written.append(_write_chunk(out, item, told))
        else:
            out += item.packed()
    if not told.ended:
        return bytes(out)
    out += Record(DATA_END, bytes(4)).packed()
    begin = len(out) if told.summary else 0
    if told.summary:
        out += _summary(items, written, told)
    if "summary_start" in told.wrong:
        begin = max(begin - 40, 8)
    tail = struct.pack("<BQQQ", FOOTER, 20, begin, 0)
    crc = zlib.crc32(bytes(out[begin:]) + tail) if told.crcs and begin else 0
    out += tail + struct.pack("<I", crc ^ ("summary_crc" in told.wrong)) + MAGIC
    return bytes(out)


def _write_chunk(out: bytearray, chunk: Chunk, told: Told) -> _Written:
    inner, entries = bytearray(), dict[int, list[tuple[int, int]]]()
    for record in chunk.records:
        if record.opcode == MESSAGE and len(record.body) >= 22:
            number, _, log_ns = struct.unpack_from("<HIQ", record.body)
            entries.setdefault(number, []).append((log_ns, len(inner)))
        inner += record.packed()
    times = [log_ns for of in entries.values() for log_ns, _ in of] or [0]
    start, end = min(times), max(times)
    if chunk.lie == "start":
        start = min(start + 3 * S, 2**64 - 1)
    if chunk.lie == "end":
        end = max(end - 2 * S, 0)
    name = chunk.compression.partition("-")[0] if chunk.lie != "name" else "snappy"
    packed = _PACK[chunk.compression](bytes(inner)) if chunk.compression else bytes(inner)
    size = len(inner) + {"size": 5, "small": -5, "huge": 1 << 40}.get(chunk.lie, 0)
    crc = (zlib.crc32(inner) if told.crcs else 0) ^ (chunk.lie == "crc")
    head = struct.pack("<QQQI", start, end, max(size, 0), crc) + text(name) + struct.pack("<Q", len(packed))
    one = _Written(len(out), 0, start, end, entries, compression=name, packed=len(packed), size=max(size, 0))
    out += Record(CHUNK, head + packed).packed()
    one.length = len(out) - one.begin
    if told.message_indexes:
        for number, of in entries.items():
            one.indexes[number] = len(out)
            out += _message_index(number, of, told)
    one.index_length = len(out) - one.begin - one.length
    return one


def _message_index(number: int, entries: list[tuple[int, int]], told: Told) -> bytes:
    if "entries_order" in told.wrong:
        entries = entries[::-1]
    if "entries_few" in told.wrong:
        entries = entries[:-1]
    if "entries" in told.wrong:
        entries = [(log_ns, at + 3) for log_ns, at in entries]
    if "entries_twice" in told.wrong:
        entries = [*entries[:-1], entries[0]]
    if "entries_none" in told.wrong:
        entries = []
    body = b"".join(struct.pack("<QQ", log_ns, at) for log_ns, at in entries)
    number = (number + ("entries_other" in told.wrong)) & 0xFFFF
    if "entries_long" in told.wrong:
        return Record(MESSAGE_INDEX, struct.pack("<HI", number, len(body) + 16) + body).packed()
    return Record(MESSAGE_INDEX, struct.pack("<HI", number, len(body)) + body).packed()


def _summary(items: Sequence[Record | Chunk], written: Sequence[_Written], told: Told) -> bytes:
    out, counts = bytearray(), dict[int, int]()
    flat = [r for item in items for r in (item.records if isinstance(item, Chunk) else (item,))]
    out += b"".join(r.packed() for r in flat if r.opcode in (SCHEMA, CHANNEL))
    for one in written:
        for number, of in one.entries.items():
            counts[number] = counts.get(number, 0) + len(of) + ("count" in told.wrong)
    if told.statistics:
        listed = b"".join(struct.pack("<HQ", *pair) for pair in counts.items())
        head = struct.pack("<QHIIIIQQ", sum(counts.values()), 1, len(counts), 0, 0, len(written), 0, 0)
        out += Record(STATISTICS, head + struct.pack("<I", len(listed)) + listed).packed()
    for one in written if told.chunk_indexes else ():
        begin = one.begin + 7 * ("index_offset" in told.wrong)
        start = one.start_ns + 2 * S * ("index_times" in told.wrong)
        nowhere = 2**63 * ("index_nowhere" in told.wrong)
        offsets = b"".join(struct.pack("<HQ", number, at + nowhere) for number, at in one.indexes.items())
        head = struct.pack("<QQQQI", min(start, 2**64 - 1), one.end_ns, begin, one.length, len(offsets)) + offsets
        tail = struct.pack("<Q", one.index_length) + text(one.compression) + struct.pack("<QQ", one.packed, one.size)
        out += Record(CHUNK_INDEX, head + tail).packed()
    return bytes(out)


def taken_apart(data: bytes) -> list[Record | Chunk]:
    """The records and chunks of a file up to its summary, as far as they can be told."""
    items: list[Record | Chunk] = []
    for record in _records(data[len(MAGIC) :] if data.startswith(MAGIC) else data):
        if record.opcode == DATA_END:
            break
        chunk = _opened(record) if record.opcode == CHUNK else None
        if record.opcode != MESSAGE_INDEX:
            items.append(chunk or record)
    return items


def _records(data: bytes) -> list[Record]:
    found, at = [], 0
    while len(data) - at >= 9 and len(found) < 200:
        opcode, length = struct.unpack_from("<BQ", data, at)
        if length > len(data) - at - 9:
            break
        found.append(Record(opcode, data[at + 9 : at + 9 + length]))
        at += 9 + length
    return found


def _opened(record: Record) -> Chunk | None:
    try:
        (named,) = struct.unpack_from("<I", record.body, 28)
        name, packed = record.body[32 : 32 + named].decode(), record.body[40 + named :]
        if name == "zstd":
            if zstandard.frame_content_size(packed) > 1 << 16:
                return None
            packed = zstandard.ZstdDecompressor().decompress(packed, max_output_size=1 << 16)
        elif name == "lz4":
            packed = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=1 << 16)
        elif name == "bz2":
            packed = bz2.BZ2Decompressor().decompress(packed, max_length=1 << 16)
        return Chunk(tuple(_records(packed)), name if name in _PACK else "")
    except (struct.error, ValueError, RuntimeError, OSError, EOFError, MemoryError, zstandard.ZstdError):
        return None


def damaged(data: bytes, chance: random.Random, damage: Damage) -> bytes:
    """A file behind one byte of mode, with records damaged by ``damage`` and put together anew, or damaged as it is."""
    if chance.random() < 0.35 or not (items := taken_apart(data[1:])):
        return damage(data)
    for _ in range(chance.randint(1, 3)):
        _change(items, chance, damage)
    rarely = [name for name in WRONG if chance.random() < 0.06]
    told = Told(*(chance.random() < 0.85 for _ in range(6)), wrong=frozenset(rarely))
    mode = data[:1] if chance.random() < 0.8 else bytes([chance.randrange(64)])
    whole = assembled(items, told)
    return mode + (whole if chance.random() < 0.8 else damage(whole))


def _change(items: list[Record | Chunk], chance: random.Random, damage: Damage) -> None:
    at = chance.randrange(len(items)) if items else 0
    item = items[at] if items else None
    kind = chance.randrange(6)
    if isinstance(item, Chunk) and kind < 4:
        items[at] = _changed_chunk(item, chance, damage)
    elif item is None or kind == 4:
        other = chance.choice(_stock())
        items.insert(at, other)
    elif kind == 5 and len(items) > 1:
        items.append(items.pop(at))
    elif kind == 3:
        del items[at]
    elif isinstance(item, Record):
        items[at] = replace(item, body=_changed_body(item.body, chance, damage))


def _changed_chunk(chunk: Chunk, chance: random.Random, damage: Damage) -> Chunk:
    kind, inner = chance.randrange(5), list(chunk.records)
    if kind == 0:
        return replace(chunk, compression=chance.choice(("", *_PACK)))
    if kind == 1:
        lie = chance.choice(("size", "small", "huge", "crc", "start", "end", "name"))
        return replace(chunk, lie=lie)
    _change(inner, chance, damage)
    return replace(chunk, records=tuple(r for r in inner if isinstance(r, Record)))


def _changed_body(body: bytes, chance: random.Random, damage: Damage) -> bytes:
    """Bytes changed at random, or a number among the first ones set to an edge."""
    if chance.random() < 0.5:
        return damage(body)
    size = chance.choice((2, 4, 8))
    at = chance.randrange(0, 23, 2)
    edge = chance.choice(EDGES) if chance.random() < 0.6 else chance.randrange(10) * S
    return body[:at] + (edge % (1 << 8 * size)).to_bytes(size, "little") + body[at + size :]


@cache
def _stock() -> tuple[Record | Chunk, ...]:
    """What is put in between."""
    one = (message(1, 2 * S, b"x"), message(2, S), message(9, 3 * S))
    return (
        Record(HEADER, text("") + text("")),
        schema(1, "sensor_msgs/msg/LaserScan"),
        schema(3, "a.B", "jsonschema", b"{}"),
        channel(1, 1, "/again"),
        channel(3, 3, "/json", "json", text("offered_qos_profiles") + text("- durability: 1")),
        channel(4, 0, "/none", "json"),
        Record(SCHEMA, b"\1"),
        Record(CHANNEL, b"\1"),
        *one,
        Record(ATTACHMENT, bytes(16) + text("a") + text("b") + struct.pack("<Q", 1) + b"x" + bytes(4)),
        Record(0x81, b"anybody's own"),
        Record(0, b""),
        Record(MESSAGE_INDEX, struct.pack("<HIQQ", 1, 16, S, 0)),
        *(Chunk(one, compression) for compression in ("", "zstd", "lz4", "bz2")),
        Chunk(()),
    )
