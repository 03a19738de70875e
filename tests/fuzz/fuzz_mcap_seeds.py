"""Small MCAP files of every kind, sound and not, for mutations to begin from; the same bytes every time."""

from __future__ import annotations

import struct
from dataclasses import replace

from fuzz_mcap import (
    ATTACHMENT,
    CHANNEL,
    HEADER,
    MAGIC,
    MESSAGE_INDEX,
    SCHEMA,
    WRONG,
    Chunk,
    Record,
    S,
    Told,
    assembled,
    channel,
    message,
    schema,
    text,
)
from fuzz_seeds import GRID, LASER, TF, mcap_file, store_of
from fuzz_seeds import message as ros_message

ALL, NARROW = b"\0", b"\x20"
MODES = tuple(bytes([mode]) for mode in (1, 2, 3, 4 | 1, 8 | 2, 12, 16, 32, 32 | 16 | 3))


def _bytes(name: str, ros: int = 2) -> bytes:
    store = store_of(ros)
    made = ros_message(store, name, ros)
    return bytes(store.serialize_cdr(made, name) if ros == 2 else store.serialize_ros1(made, name))


def scans_at(times_s, number: int = 1, data: bytes = b"") -> tuple[Record, ...]:
    return tuple(message(number, int(t * S), data or _bytes(LASER)) for t in times_s)


LIES = ("size", "small", "huge", "crc", "start", "end", "name")
HEAD = (Record(HEADER, text("ros2") + text("")), schema(1, LASER), channel(1, 1, "/scan"))
TF_HEAD = (schema(2, TF), channel(2, 2, "/tf"))


def _chunks(compression: str, *spans: tuple[float, ...]) -> list[Record | Chunk]:
    return [*HEAD, *(Chunk(scans_at(times), compression) for times in spans)]


def mcap_seeds() -> list[bytes]:
    files = [*_sound(), *_odd(), *_lying(), *_cut()]
    modes = [mode + file for mode in MODES for file in files[1:3]]
    return [*(ALL + file for file in files), *modes, *(NARROW + file for file in _large())]


def _attachment(rest: bytes) -> Record:
    return Record(ATTACHMENT, bytes(16) + text("a") + text("") + rest)


def _sound() -> list[bytes]:
    """As writers make them, with the messages of both ROS, in chunks and without."""
    two = (*scans_at((1, 2, 3)), *(message(2, int(t * S), _bytes(TF)) for t in (1, 2.5)))
    longer = _bytes(LASER).replace(b"map", b"far")
    ros1 = (schema(1, "sensor_msgs/LaserScan", "ros1msg"), channel(1, 1, "/scan", "ros1"))
    other = (schema(2, LASER), channel(2, 2, "/scan2"))
    grid = message(3, S, _bytes(GRID))
    files: list[list[Record | Chunk]] = [
        [*HEAD, *TF_HEAD, Chunk(two), Chunk(scans_at((4, 5)))],
        [*HEAD, *TF_HEAD, Chunk((*HEAD[1:], *two), "zstd"), Chunk(scans_at((4, 5)), "zstd")],
        [*HEAD, *other, Chunk((*scans_at((1, 2)), *scans_at((1.5, 2.5), 2)), "lz4"), Chunk(scans_at((4, 5)))],
        _chunks("bz2", (1, 2), (3, 4)),
        _chunks("lz4-unsized", (1, 2), (3, 4)),
        _chunks("lz4-large", (1, 2), (3, 4)),
        _chunks("lz4-pieces", (1, 2), (3, 4)),
        _chunks("zstd", *((t, t + 0.4) for t in range(7))),
        _chunks("zstd", *((t, t + 30.0) for t in range(7))),
        _chunks("", (1, 9), (2, 8), (3, 7), (4, 6)),
        [*ros1, Chunk(scans_at((1, 2, 3), data=_bytes(LASER, 1)))],
        [*ros1, Chunk((*scans_at((1, 2), data=_bytes(LASER, 1)), message(1, 3 * S, b"x")))],
        [*HEAD, Chunk((*scans_at((1,)), *scans_at((2,), data=longer)))],
        [*HEAD, Chunk((*scans_at((1,)), *scans_at((2,), data=_bytes(LASER) + b"\1\0\0\0")))],
        [*HEAD, Chunk((*scans_at((1,)), message(2, S, b"tf"), *scans_at((2,)))), *TF_HEAD],
        [*HEAD, *scans_at((1, 2)), *TF_HEAD, *scans_at((3,)), _attachment(bytes(12))],
        [*HEAD, schema(3, GRID), channel(3, 3, "/map", metadata=text("k") + text("v")), Chunk((grid,))],
    ]
    small = {"types": (TF,), "count": 2}
    return [
        mcap_file(types=(LASER,), count=3, enable_crcs=False),
        *map(assembled, files),
        mcap_file("zstd", **small, use_statistics=False),
        assembled(files[7], Told(message_indexes=False)),
        assembled(files[0], Told(crcs=False)),
        assembled(files[0], Told(crcs=False, statistics=False, chunk_indexes=False)),
        assembled(files[9], Told(message_indexes=False, crcs=False)),
        assembled(files[9], Told(summary=False)),
    ]


def _odd() -> list[bytes]:
    """What nobody should write: channels twice, without schema or description, chunks without messages."""
    json = channel(5, 0, "/json", "json", text("offered_qos_profiles") + text("- durability: 1"))
    odd, none = channel(6, 0, "/odd", "odd"), channel(7, 99, "/none")
    told = (message(5, S, b'{"a": 1}'), message(6, S), message(7, S))
    early = Record(MESSAGE_INDEX, b"\1\0" + struct.pack("<I", 16))
    files: list[list[Record | Chunk]] = [
        [*HEAD, json, odd, none, Chunk(told)],
        [*HEAD, channel(1, 1, "/other"), schema(1, TF), Chunk(scans_at((1, 2)))],
        [*HEAD, Chunk(()), Chunk((Record(SCHEMA, b"\1"), Record(CHANNEL, b"\1\0"), *scans_at((1, 2))))],
        [Chunk(scans_at((1, 2))), Chunk(HEAD[1:])],
        [*HEAD, Chunk((*scans_at((1, 2)), Record(0x90, b"own"), Record(0, b"")))],
        [*HEAD, Record(MESSAGE_INDEX, b"\1\0\0"), Record(6, b"short"), Record(2, b"foot"), *scans_at((1, 2, 3, 4))],
        [*HEAD, Chunk((*scans_at((2, 1, 3)), message(1, 2**64 - 1, b"")))],
        [*HEAD, Chunk((message(1, S, b"not a scan"), *scans_at((2,))))],
        [*HEAD, Chunk((message(9, S, b"a stranger"), *scans_at((2,))))],
        [*HEAD, early, Record(ATTACHMENT, bytes(18)), Chunk(scans_at((1,)))],
        [*HEAD, _attachment(b"x"), Chunk(scans_at((1,)))],
        [*HEAD, Chunk(scans_at((1, 2), data=_bytes(LASER).replace(b"map", b"\xff\xff\xff")))],
        [*HEAD, Chunk((*scans_at((1, 2)), *scans_at((3,), data=_flat(_bytes(LASER)))))],
        [],
    ]
    untold = [assembled(file, Told(summary=False, message_indexes=False)) for file in files]
    return [*map(assembled, files), *untold, *_broken_records(), mcap_file(count=0), MAGIC, b"x", b"x" * 60]


def _broken_records() -> list[bytes]:
    """Messages in chunks without checksum say that they are longer than these, and chunks that their names are long."""
    whole = assembled([*HEAD, Chunk(scans_at((1, 2, 3)))], Told(crcs=False))
    bare = assembled([*HEAD, Chunk(scans_at((1, 2, 3)))], Told(crcs=False, message_indexes=False, summary=False))
    found = []
    for file in (whole, bare):
        chunk = file.index(struct.pack("<Q", S)) - 9
        at = file.rindex(struct.pack("<HIQ", 1, 0, 3 * S)) - 8
        lengths = [struct.pack("<Q", length) for length in (0, 5, 1 << 20, 1 << 62)]
        found += [file[:at] + length + file[at + 8 :] for length in lengths]
        found.append(file[: chunk + 37] + b"\x40" + file[chunk + 38 :])
        found.append(file[: chunk + 41] + b"\xff" * 8 + file[chunk + 49 :])
    return found


def _flat(scan: bytes) -> bytes:
    """The same size, but one range less and one intensity more."""
    at = scan.index(struct.pack("<I", 5), 40)
    return scan[:at] + struct.pack("<I", 4) + scan[at + 4 : at + 20] + struct.pack("<I", 3) + scan[at + 24 :]


def _large() -> list[bytes]:
    """What is more than narrow limits allow."""
    nothing = message(1, S, bytes(60_000))
    files = [[*HEAD, Chunk(scans_at((1, 5)), compression, "huge")] for compression in ("", "zstd")]
    files += [[*HEAD, Chunk((nothing,), compression)] for compression in ("zstd", "lz4", "bz2")]
    return [*map(assembled, files), *(assembled(file, Told(summary=False)) for file in files)]


def _lying() -> list[bytes]:
    """Chunks, indexes and summaries that say what is not so."""
    chunks = _chunks("zstd", (1, 2), (3, 4))
    lies = [
        [*HEAD, Chunk(scans_at((1, 2)), compression, lie), Chunk(scans_at((0.5, 3)))]
        for compression in ("", "zstd", "lz4", "bz2")
        for lie in ("size", "small", "crc")
    ]
    lies += [
        [*HEAD, Chunk(scans_at((1, 5)), "", lie), Chunk(scans_at((3, 4)))] for lie in ("start", "end", "name", "huge")
    ]
    told = [Told(wrong=frozenset({name})) for name in WRONG]
    plain = _chunks("", (1, 2, 3), (4, 5))
    sealed = bytearray(assembled(plain))
    sealed[sealed.index(bytes([6]), 60)] = 0  # a chunk whose first byte is gone, under a summary that is sound
    unsealed = [assembled(plain, replace(one, crcs=False)) for one in told]
    return [
        *map(assembled, lies),
        *(assembled(lie, Told(message_indexes=False, summary=False)) for lie in lies),
        *(assembled(chunks, one) for one in told),
        *(assembled(plain, replace(one, chunk_indexes=False)) for one in told),
        *unsealed,
        bytes(sealed),
        assembled(plain, Told(wrong=frozenset({"count"}), message_indexes=False)),
        assembled(plain, Told(wrong=frozenset({"count", "entries_few"}))),
    ]


def _cut() -> list[bytes]:
    """Files that end too early, have holes, or begin with something else."""
    files = []
    for compression in ("", "zstd", "lz4", "bz2"):
        whole = assembled([*_chunks(compression, (1, 2, 3), (4, 5)), *TF_HEAD], Told(ended=False))
        files += [whole, whole[:-7], whole[: len(whole) * 2 // 3], whole[: len(whole) // 2]]
        hole = len(whole) // 2
        files.append(whole[:hole] + bytes(20) + whole[hole + 20 :])
    whole = assembled(_chunks("", (1, 2, 3), (4, 5)))
    bare = assembled([*HEAD, *scans_at(range(8))], Told(ended=False))
    files += [whole[:-8], whole[:-20], whole[30:], b"x" * 40 + whole, whole + whole, bare[:-5]]
    files += [bare[:250] + b"\xff" * 30 + bare[280:], bare[:180] + bytes(9) + bare[250:]]
    return files
