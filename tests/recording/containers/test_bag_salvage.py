"""Everything readable of a damaged ROS 1 bag is read; where its chunks lie is found out before it is damaged."""

from __future__ import annotations

import random
import struct
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer

from mapgraft.contracts.sources import Source
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.bag_file import BagSource
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.opening import open_source

THOROUGH = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

Row = tuple[str, int, bytes]


class Made:
    """A bag, its messages, and the ranges of its chunks, each with the numbers of the messages in it."""

    def __init__(
        self, whole: bytes, rows: list[Row], chunks: list[tuple[int, int, list[int]]], index_begin: int
    ) -> None:
        self.whole, self.rows, self.chunks, self.index_begin = whole, rows, chunks, index_begin


def given_by(source: Source) -> list[Row]:
    return [(m.channel.topic, m.log_ns, bytes(m.data)) for m in source.messages()]


def top_level(whole: bytes) -> list[tuple[int, int, int, int]]:
    """(op, where it begins, where its data begin, where it ends) of every record outside chunks."""
    found, at = [], len(b"#ROSBAG V2.0\n")
    while at < len(whole):
        (header_bytes,) = struct.unpack_from("<I", whole, at)
        header = whole[at + 4 : at + 4 + header_bytes]
        (data_bytes,) = struct.unpack_from("<I", whole, at + 4 + header_bytes)
        end = at + 8 + header_bytes + data_bytes
        found.append((header[header.index(b"op=") + 3], at, at + 8 + header_bytes, end))
        at = end
    return found


@pytest.fixture(params=[None, Writer.CompressionFormat.LZ4, Writer.CompressionFormat.BZ2], ids=["none", "lz4", "bz2"])
def made(request: Any, tmp_path: Path, ros1_scans: Any) -> Made:
    """Chunks of two to four scans; both topics begin in the first two."""
    path, rows = tmp_path / "made.bag", list[Row]()
    writer = Writer(path)
    writer.chunk_threshold = 3 * 350
    if request.param is not None:
        writer.set_compression(request.param)
    with writer:
        connections = [
            writer.add_connection(topic, ros1_scans.name, typestore=ros1_scans.store) for topic in ("/a", "/b")
        ]
        for n in range(24):
            sample = ros1_scans.sample(1000 * (n + 1), "/b" if n % 3 == 0 else "/a", beams=60)
            writer.write(connections[n % 3 == 0], sample.log_ns, sample.data)
            rows.append((sample.topic, sample.log_ns, sample.data))
    whole = path.read_bytes()
    records = top_level(whole)
    chunks = list[tuple[int, int, list[int]]]()
    for op, begin, data, end in records:
        if op == 5:
            chunks.append((begin, end, []))
        elif op == 4:
            chunks[-1][2].extend(nanosec // 1000 - 1 for _, nanosec, _ in struct.iter_unpack("<III", whole[data:end]))
    assert len(chunks) > 6
    ranges = [(begin, end, sorted(numbers)) for begin, end, numbers in chunks]
    return Made(whole, rows, ranges, next(begin for op, begin, _, _ in records if op == 7 and begin > chunks[-1][1]))


@THOROUGH
@given(
    where=st.floats(0, 1, exclude_max=True),
    length=st.integers(1, 400),
    zeros=st.booleans(),
    cut=st.one_of(st.just(1.0), st.floats(0.3, 1)),
)
def test_all_messages_of_intact_chunks_are_read(
    made: Made, tmp_path: Path, where: float, length: int, zeros: bool, cut: float
) -> None:
    """Bags have no checksums: of a damaged chunk, and of none else, something false may be given."""
    begin = int(where * len(made.whole))
    end = min(begin + length, len(made.whole))
    hurt = bytearray(made.whole)
    hurt[begin:end] = bytes(end - begin) if zeros else random.Random(begin).randbytes(end - begin)
    del hurt[int(cut * len(made.whole)) :]
    path = tmp_path / "hurt.bag"
    path.write_bytes(hurt)
    intact = [c for c in made.chunks if c[1] <= len(hurt) and (end <= c[0] or c[1] <= begin)]
    described = all(chunk in intact for chunk in made.chunks[:2]) or (cut == 1.0 and not made.index_begin - 400 < end)
    expected = [made.rows[n] for _, _, numbers in intact for n in numbers]
    try:
        source = BagSource(path)
    except RecordingError:
        assert begin < 4200  # the magic, or the head of the bag
        return
    with source:
        found = given_by(source)
        assert not described or not Counter(expected) - Counter(found)
        strange = [row for row in found if row not in made.rows]
        hit = len(made.chunks) - len(intact)
        assert len(strange) <= 4 * hit
        assert len(found) + len(strange) >= len(made.rows) or len(source.faults)


@pytest.mark.parametrize("finished", [False, True])
def test_a_recording_never_finished(made: Made, tmp_path: Path, finished: bool) -> None:
    """The header points to no index, and the last chunk does not say how much it holds: its messages are read."""
    begin, end, numbers = made.chunks[5]
    rows = made.rows[: numbers[-1] + 1]
    data = bytearray(made.whole[:end])
    at = data.index(b"index_pos=")
    data[at + 10 : at + 18] = bytes(8)
    if not finished:
        head = struct.unpack_from("<I", data, begin)[0]
        size = data.index(b"size=", begin) + 5
        data[size : size + 4] = bytes(4)
        data[begin + 4 + head : begin + 8 + head] = bytes(4)
    path = tmp_path / "recording.bag.active"
    path.write_bytes(data)
    with open_source(path) as source:
        assert source.container == "rosbag1"
        assert given_by(source) == rows
        assert {c.topic: c.count for c in source.channels} == Counter(row[0] for row in rows)
        assert source.faults.count("index_damaged") == 1


def test_what_is_lost_is_counted_by_topic(made: Made, tmp_path: Path) -> None:
    begin, end, numbers = made.chunks[3]
    hurt = bytearray(made.whole)
    hurt[begin + 60 : end] = b"\xee" * (end - begin - 60)
    path = tmp_path / "hurt.bag"
    path.write_bytes(hurt)
    with BagSource(path) as source:
        assert given_by(source) == made.rows[: numbers[0]] + made.rows[numbers[-1] + 1 :]
        lost = Counter(made.rows[n][0] for n in numbers)
        assert {f.topic: f.count for f in source.faults if f.cause == "messages_lost"} == lost


def test_the_index_finds_messages_behind_a_broken_record(made: Made, tmp_path: Path) -> None:
    """In a chunk that is not compressed one broken record hides no other."""
    first = made.rows[9][2]
    if first not in made.whole:
        pytest.skip("the chunks of this bag are compressed")
    hurt = bytearray(made.whole)
    at = made.whole.index(first) - 4  # the length of the message
    hurt[at : at + 4] = b"\xff\xff\xff\x7f"
    path = tmp_path / "hurt.bag"
    path.write_bytes(hurt)
    with BagSource(path) as source:
        assert given_by(source) == made.rows[:9] + made.rows[10:]
        assert source.faults.count("messages_lost") == 1


@pytest.mark.parametrize(("name", "wrong"), [(b"op=\x02", b"op=\x00"), (b"time=", b"emit="), (b"conn=", b"none=")])
def test_a_record_that_is_no_message_any_more_is_told(made: Made, tmp_path: Path, name: bytes, wrong: bytes) -> None:
    """Its lengths may be sound: then nothing else is broken, and nobody would miss it."""
    first = made.rows[9][2]
    if first not in made.whole:
        pytest.skip("the chunks of this bag are compressed")
    hurt = bytearray(made.whole)
    at = made.whole.rindex(name, 0, made.whole.index(first))
    hurt[at : at + len(wrong)] = wrong
    path = tmp_path / "hurt.bag"
    path.write_bytes(hurt)
    with BagSource(path) as source:
        assert given_by(source) == made.rows[:9] + made.rows[10:]
        assert {f.topic: f.count for f in source.faults if f.cause == "messages_lost"} == {made.rows[9][0]: 1}


def test_a_bag_whose_first_bytes_are_gone_is_known_by_its_name(made: Made, tmp_path: Path) -> None:
    path = tmp_path / "hurt.bag"
    path.write_bytes(bytes(20) + made.whole[20:])
    with open_source(path) as source:
        assert given_by(source) == made.rows
        assert source.faults.count("start_damaged") == 1
    path.write_bytes(bytes(3000))
    with pytest.raises(RecordingError, match="does not begin like one"):
        open_source(path)


def test_chunks_that_claim_too_much(made: Made, tmp_path: Path) -> None:
    hurt, numbers = bytearray(made.whole), made.chunks[2][2]
    size = hurt.index(b"size=", made.chunks[2][0]) + 5
    hurt[size : size + 4] = b"\xff" * 4
    path = tmp_path / "bomb.bag"
    path.write_bytes(hurt)
    with BagSource(path, limits=ReadLimits(chunk_bytes=10_000)) as source:
        assert given_by(source) == made.rows[: numbers[0]] + made.rows[numbers[-1] + 1 :]
        assert source.faults.count("chunk_damaged") == 1
