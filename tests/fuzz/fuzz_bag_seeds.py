"""Small ROS 1 bags and databases of ROS 2 bags, sound and not, for mutations to begin from."""

from __future__ import annotations

import bz2
import contextlib
import sqlite3
import struct
from collections.abc import Sequence

import lz4.frame
from fuzz_seeds import LASER, POSES, TF, message, store_of

S = 1_000_000_000
_HEAD_BYTES = 90  # of the magic line and the bag's own record
MODES = (1, 2, 3, 5, 8, 12, 16, 32, 48)
_PACK = {"none": bytes, "lz4": lz4.frame.compress, "bz2": bz2.compress}
_CREATE = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, {qos})",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)",
    "CREATE INDEX timestamp_idx ON messages (timestamp ASC)",
)
_DEFINED = (
    "CREATE TABLE message_definitions(id INTEGER, topic_type TEXT, encoding TEXT, encoded_message_definition TEXT)"
)


def _fields(**values: bytes) -> bytes:
    return b"".join(struct.pack("<I", len(n) + 1 + len(v)) + n.encode() + b"=" + v for n, v in values.items())


def record(data: bytes = b"", **values: bytes) -> bytes:
    """A record of a bag."""
    head = _fields(**values)
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


def _time(ns: int) -> bytes:
    return struct.pack("<II", *divmod(ns, S))


def _connection(number: int, topic: str, kind: str, **more: bytes) -> bytes:
    about = _fields(topic=topic.encode(), type=kind.encode(), md5sum=b"*", message_definition=b"", **more)
    return record(about, op=b"\7", conn=struct.pack("<I", number), topic=topic.encode())


def _said(number: int, ns: int, data: bytes) -> bytes:
    return record(data, op=b"\2", conn=struct.pack("<I", number), time=_time(ns))


def _scan(ros: int = 1, name: str = LASER) -> bytes:
    store = store_of(ros)
    made = message(store, name, ros)
    return bytes(store.serialize_ros1(made, name) if ros == 1 else store.serialize_cdr(made, name))


def _bag(compression: str, chunks: Sequence[Sequence[tuple[int, float]]], told: bool = True, lie: int = 0) -> bytes:
    """A bag of scans and poses at these (connection, seconds); ``told`` with index, ``lie`` is added to its sizes."""
    connections = [_connection(0, "/scan", LASER), _connection(1, "/pose", POSES[2], latching=b"1")]
    bodies = (_scan(), _scan(1, POSES[2]))
    out, infos = bytearray(), b""
    for chunk in chunks:
        inner, rows = bytearray(), dict[int, list[bytes]]()
        inner += b"".join(connections) if chunk is chunks[0] else b""
        for number, t in chunk:
            rows.setdefault(number, []).append(_time(int(t * S)) + struct.pack("<I", len(inner)))
            inner += _said(number, int(t * S), bodies[number % 2])
        at, times = len(out) + _HEAD_BYTES, [int(t * S) for _, t in chunk] or [0]
        size = struct.pack("<I", len(inner) + lie)
        out += record(_PACK[compression](bytes(inner)), op=b"\5", compression=compression.encode(), size=size)
        for number, lines in rows.items():
            about = {"ver": b"\1\0\0\0", "conn": struct.pack("<I", number), "count": struct.pack("<I", len(lines))}
            out += record(b"".join(lines), op=b"\4", **about)
        counted = b"".join(struct.pack("<II", number, len(lines)) for number, lines in rows.items())
        about = {"chunk_pos": struct.pack("<Q", at), "start_time": _time(min(times)), "end_time": _time(max(times))}
        infos += record(counted, op=b"\6", ver=b"\1\0\0\0", **about, count=struct.pack("<I", len(rows)))
    place = struct.pack("<Q", len(out) + _HEAD_BYTES) if told else bytes(8)
    counts = {"conn_count": struct.pack("<I", 2), "chunk_count": struct.pack("<I", len(chunks))}
    head = record(op=b"\3", index_pos=place, **counts)
    assert 13 + len(head) == _HEAD_BYTES
    return b"#ROSBAG V2.0\n" + head + bytes(out) + (b"".join(connections) + infos if told else b"")


_TWO = (((0, 1), (1, 1.5), (0, 2)), ((0, 3), (1, 2.5)))


def odd_bags() -> dict[str, bytes]:
    """Bags that nobody writes, by what is wrong with them."""
    whole = _bag("none", _TWO)
    hole = len(whole) // 2
    return {
        "sound": whole,
        "without-index": _bag("lz4", _TWO, told=False),
        "cut": whole[:-40],
        "half": whole[:hole],
        "hole": whole[:hole] + bytes(12) + whole[hole + 12 :],
        "packed-too-large": _bag("bz2", _TWO, lie=5),
        "packed-too-small": _bag("lz4", _TWO, lie=-5),
        "packed-half-a-gigabyte": _bag("lz4", _TWO, lie=1 << 29),
        "out-of-order": _bag("none", [[(0, 9), (0, 1)], [(1, 5)]]),
        "strangers": _bag("none", [[], [(7, 1)]]),
        "messages-of-no-kind": whole.replace(b"op=\2", b"op=\0"),
        "chunks-of-no-kind": whole.replace(b"op=\5", b"op=\x09"),
        "messages-of-nobody": whole.replace(b"conn=", b"none="),
        "compression-unknown": whole.replace(b"compression=none", b"compression=nope"),
        "type-unknown": whole.replace(LASER.encode(), b"a" * len(LASER)),
        "encrypted": whole.replace(b"conn_count=", b"encryptor=x"),
        "old": b"#ROSBAG V1.2\n" + whole[13:],
        "beheaded": whole[80:],
    }


def bag_seeds() -> list[bytes]:
    """Whole, without index, cut, with holes, in several orders and compressions."""
    odd = odd_bags()
    found = [*odd.values(), _bag("lz4", [[(0, t)] for t in range(7)])]
    for compression in _PACK:
        whole = _bag(compression, _TWO)
        found += [whole, _bag(compression, _TWO, told=False), whole[:-40], whole[: len(whole) // 2]]
        hole = len(whole) // 2
        found.append(whole[:hole] + bytes(12) + whole[hole + 12 :])
        found += [_bag(compression, _TWO, lie=lie) for lie in (5, -5, 1 << 29)]
    whole = odd["sound"]
    found += [b"#ROSBAG V2.0\n", b"x" * 60, b"x" * 20 + whole[20:], b""]
    return [*(b"\0" + data for data in found), *(bytes([mode]) + whole for mode in MODES)]


def _database(rows: Sequence[tuple[object, ...]], topics: Sequence[tuple[object, ...]] = (), **chosen: object) -> bytes:
    with contextlib.closing(sqlite3.connect(":memory:")) as database:
        database.execute(f"PRAGMA page_size = {chosen.get('page', 512)}")
        for command in (*_CREATE, *([_DEFINED] if chosen.get("defined") else [])):
            database.execute(command.format(qos=chosen.get("qos", "offered_qos_profiles TEXT")))
        usual = ((1, "/scan", LASER, "cdr", ""), (2, "/tf", TF, "cdr", "- durability: 1"))
        database.executemany("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", topics or usual)
        database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)
        for kind, encoding, text in chosen.get("defined") or ():
            database.execute("INSERT INTO message_definitions VALUES (1, ?, ?, ?)", (kind, encoding, text))
        for command in chosen.get("more") or ():
            database.execute(command)
        database.commit()
        return database.serialize()


def _rows() -> list[tuple[object, ...]]:
    scan, tf = _scan(2), _scan(2, TF)
    rows: list[tuple[object, ...]] = [(n + 1, 1 + n % 2, n * S, (scan, tf)[n % 2]) for n in range(6)]
    return [*rows, (9, 1, 3 * S, scan + bytes(900)), (10, 2, 4 * S, tf), (11, 1, -5, scan)]


def odd_databases() -> dict[str, bytes]:
    """Databases that nobody writes, by what is wrong with them."""
    rows, scan = _rows(), _scan(2)
    odd = [
        (1, 1, 1.5, scan),
        (2, 1, 2, "text"),
        (3, 1, None, scan),
        (4, None, 4, scan),
        (5, 99, 5, scan),
        (6, "x", 6, 7),
    ]
    computed = "ALTER TABLE messages ADD COLUMN more BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL"
    whole = _database(rows)
    return {
        "sound": whole,
        "odd-values": _database(odd),
        "topics-of-nothing": _database(rows, [(1, None, LASER, "cdr", ""), (2, "/b", None, None, 5)]),
        "topics-of-noise": _database(rows, [(1, "/a", b"\xff", "cdr", ""), (2, "/b", 5, 6, None)]),
        "definitions-of-nothing": _database(rows, defined=[(LASER, None, None)]),
        "computed-gigabytes": _database(rows, more=[computed]),
        "no-messages": _database(rows, more=["DROP TABLE messages"]),
        "messages-a-view": _database(
            rows, more=["DROP TABLE messages", "CREATE VIEW messages AS SELECT * FROM topics"]
        ),
        "nothing-in-it": _database([], page=4096),
        "first-page-only": whole[:100],
        "cut-in-last-page": whole[:-512],
        "half": whole[: len(whole) // 2],
        "leaf-cut-off": whole[:1536] + b"\x0d\0\0\0\x7f" + whole[1541:],
        "leaf-of-zeros": whole[:1024] + bytes(512) + whole[1536:],
    }


def db3_seeds() -> list[bytes]:
    """Whole, cut, with holes, with values of other kinds and schemas that nobody writes."""
    rows = _rows()
    whole = _database(rows)
    found = [
        *odd_databases().values(),
        _database(rows, defined=[(LASER, "ros2msg", "float32 x"), (TF, "ros2idl", "")]),
        _database(rows, qos="x TEXT"),
        b"SQLite format 3\0",
        b"x",
        b"",
    ]
    for page in range(len(whole) // 512):
        at = 512 * page + (100 if page == 0 else 0)
        patches = (bytes(8), b"\xff" * 4, b"\x0d\0\0\0\x7f")
        found += [whole[:at] + patch + whole[at + len(patch) :] for patch in patches]
    return [*(b"\0" + data for data in found), *(bytes([mode]) + whole for mode in (*MODES, 64))]
