"""Everything readable of a damaged MCAP file is read; the files are built byte by byte, so tests know what is left."""

from __future__ import annotations

import random
import struct
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fuzz_mcap import WRONG, Chunk, S, Told, assembled
from fuzz_mcap_seeds import HEAD, scans_at
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mapgraft.contracts.sources import Source
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.inflate import inflate
from mapgraft.recording.containers.limits import ReadLimits
from mapgraft.recording.containers.mcap_file import McapSource

THOROUGH = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

MESSAGES = st.lists(st.tuples(st.sampled_from(["/a", "/b", "/c"]), st.integers(1, 60), st.integers(0, 400)), max_size=6)
CHUNKS = st.lists(MESSAGES, min_size=1, max_size=7)
KINDS = st.fixed_dictionaries(
    {"compression": st.sampled_from(["", "lz4", "zstd"]), "message_indexes": st.booleans(), "declare": st.just("every")}
)
ENDINGS = st.one_of(
    st.none(),
    st.fixed_dictionaries({name: st.booleans() for name in ("chunk_index", "channels", "statistics", "checksum")}),
)
DAMAGE = st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 300), st.integers(0, 2)), max_size=3)


def given_by(source: Source) -> list[tuple[str, int, bytes]]:
    return [(m.channel.topic, m.log_ns, bytes(m.data)) for m in source.messages()]


def build(mcap_bytes: Any, told_type: Any, chunks: Any, kind: Any, ending: Any) -> Any:
    """A file of chunks that overlap, are out of order or empty, with or without its end."""
    made, seeds = mcap_bytes(**kind), random.Random(7)
    for chunk in chunks:
        made.chunk([told_type(topic, log_ns, seeds.randbytes(size)) for topic, log_ns, size in chunk])
    if ending is not None:
        made.finish(**ending)
    return made


def harmed(whole: bytes, damage: Any, cut: float) -> tuple[bytearray, list[tuple[int, int]]]:
    """The file after damage and a cut, and which bytes were changed: turned, zeroed or overwritten with noise."""
    hurt, noise, regions = bytearray(whole), random.Random(11), []
    for where, length, how in damage:
        begin = int(where * len(whole))
        end = min(begin + length, len(whole))
        piece = {0: bytes(b ^ 0xFF for b in hurt[begin:end]), 1: bytes(end - begin), 2: noise.randbytes(end - begin)}[
            how
        ]
        hurt[begin:end] = piece
        regions.append((begin, end))
    del hurt[int(cut * len(whole)) :]
    return hurt, regions


@THOROUGH
@given(chunks=CHUNKS, kind=KINDS, ending=ENDINGS, damage=DAMAGE, cut=st.one_of(st.just(1.0), st.floats(0.1, 1)))
def test_all_messages_of_intact_chunks_are_read_and_nothing_false(
    tmp_path: Path, mcap_bytes: Any, told_type: Any, chunks: Any, kind: Any, ending: Any, damage: Any, cut: float
) -> None:
    """Exactly the messages of the chunks that no damage and no cut touches, and true ones of the others at most."""
    made = build(mcap_bytes, told_type, chunks, kind, ending)
    hurt, regions = harmed(bytes(made.data), damage, cut)
    path = tmp_path / "hurt.mcap"
    path.write_bytes(hurt)
    left = [c for c in made.chunks if c.end <= len(hurt) and all(b <= c.begin or c.end <= a for a, b in regions)]
    expected = Counter(message for chunk in left for message in chunk.messages)
    everything = Counter(message for chunk in made.chunks for message in chunk.messages)
    try:
        source = McapSource(path)
    except RecordingError:
        assert len(hurt) < 8 or any(begin < 8 for begin, _ in regions)
        assert not expected
        return
    with source:
        found = given_by(source)
        assert given_by(source) == found
        assert not expected - Counter(found)
        torn = [
            c for c in made.chunks if c.begin < len(hurt) < c.end and any(a < c.end and c.begin < b for a, b in regions)
        ]
        assert torn or not Counter(found) - everything  # cut off and damaged: no checksum is left to tell
        assert len(found) == everything.total() or len(source.faults)
        assert [row[1] for row in found] == sorted(row[1] for row in found) or source.faults.count("late_messages")


def test_a_damaged_chunk_that_alone_describes_its_channel_is_told(
    tmp_path: Path, mcap_bytes: Any, told_type: Any
) -> None:
    made = mcap_bytes()
    chunk = made.chunk([told_type("/a", 1, random.Random(7).randbytes(151))])
    made.finish(channels=False, statistics=False, checksum=False)
    made.data[chunk.end - 1] ^= 0xFF
    path = tmp_path / "hurt.mcap"
    path.write_bytes(made.data)
    with McapSource(path) as source:
        assert source.channels == ()
        assert {fault.cause: fault.count for fault in source.faults} == {"chunk_damaged": 1, "messages_lost": 1}


@THOROUGH
@given(chunks=CHUNKS, kind=KINDS, ending=ENDINGS)
def test_whole_files_of_any_make_are_read_without_a_fault(
    tmp_path: Path, mcap_bytes: Any, told_type: Any, chunks: Any, kind: Any, ending: Any
) -> None:
    made = build(mcap_bytes, told_type, chunks, kind, ending)
    path = tmp_path / "whole.mcap"
    path.write_bytes(made.data)
    with McapSource(path) as source:
        messages = [message for chunk in made.chunks for message in chunk.messages]
        assert given_by(source) == sorted(messages, key=lambda message: message.log_ns)
        assert {fault.cause for fault in source.faults} <= ({"cut_off"} if ending is None else set())
        times = [message.log_ns for message in messages]
        assert (source.start_ns, source.end_ns) == ((min(times), max(times)) if times else (None, None))
        counts = Counter(message.topic for message in messages)
        assert {c.topic: c.count for c in source.channels if c.count is not None}.items() <= counts.items()


@THOROUGH
@given(chunks=CHUNKS, where=st.floats(0, 1, exclude_max=True), length=st.integers(1, 200), cut=st.floats(0.1, 1))
def test_messages_outside_chunks(
    tmp_path: Path, mcap_bytes: Any, told_type: Any, chunks: Any, where: float, length: int, cut: float
) -> None:
    """They have no checksums; but those before the damage, and those well behind it, are there."""
    made, seeds, ends = mcap_bytes(), random.Random(5), []
    for chunk in chunks:
        for topic, log_ns, size in chunk:
            made.bare([told := told_type(topic, log_ns, seeds.randbytes(size))])
            ends.append((len(made.data), told))
    hurt, [(begin, end)] = harmed(bytes(made.data), [(where, length, 2)], cut)
    path = tmp_path / "bare.mcap"
    path.write_bytes(hurt)
    untouched = [told for at, told in ends if at <= min(begin, len(hurt))]
    behind = [told for at, told in ends if at - 31 - len(told.data) >= end and at <= len(hurt)]
    if begin < 8 or len(hurt) < 8:
        return
    found = Counter(given_by(McapSource(path)))
    described = {told.topic for told in untouched}  # channels are described once
    assert not Counter(untouched) - found
    missing = Counter(told for told in behind[3:] if told.topic in described) - found
    assert not missing or not untouched  # before the first message nobody knows that there are any outside chunks


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_what_is_lost_is_counted_by_topic(tmp_path: Path, mcap_bytes: Any, told_type: Any, compression: str) -> None:
    made, seeds = mcap_bytes(compression=compression), random.Random(1)
    for n in range(4):
        made.chunk([told_type("/ab"[:2] if k % 3 else "/b", 10 * n + k, seeds.randbytes(500)) for k in range(9)])
    whole = bytearray(made.finish())
    for chunk in made.chunks[1:3]:
        middle = (chunk.begin + chunk.end) // 2
        whole[middle : middle + 600] = bytes(600)
    path = tmp_path / "hurt.mcap"
    path.write_bytes(whole)
    with McapSource(path) as source:
        assert len(given_by(source)) == 18
        lost = {fault.topic: fault.count for fault in source.faults if fault.cause == "messages_lost"}
        assert lost == {"/a": 12, "/b": 6}
        assert source.faults.count("chunk_damaged") == 2


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_the_beginning_of_a_large_damaged_chunk_is_read_and_is_true(
    tmp_path: Path, mcap_bytes: Any, told_type: Any, compression: str
) -> None:
    """Damage that begins in bytes which are stored as they are is noticed a block later: that much is given up."""
    seeds = random.Random(3)
    for trial in range(12):
        made = mcap_bytes(compression=compression)
        messages = [told_type("/a", n, seeds.randbytes(9000)) for n in range(150)]
        chunk = made.chunk(messages)
        made.chunk([told_type("/a", 1000, b"last")])
        whole = bytearray(made.finish())
        begin = chunk.begin + 700_000 + 31_111 * trial
        whole[begin : begin + 150_000] = seeds.randbytes(150_000)
        path = tmp_path / "hurt.mcap"
        path.write_bytes(whole)
        with McapSource(path) as source:
            found = given_by(source)
            assert found[-1] == ("/a", 1000, b"last")
            assert found[:-1] == messages[: len(found) - 1]
            assert 20 < len(found) < 150
            assert source.faults.count("chunk_partial") == 1
            assert source.faults.count("messages_lost") == 151 - len(found)


def test_an_index_that_is_incomplete_or_points_elsewhere(tmp_path: Path, mcap_bytes: Any, told_type: Any) -> None:
    """What the chunk index leaves out is found between the chunks it tells of; what cannot be true is passed over."""
    for wrong in ("missing", "shifted", "long", "twice", "times"):
        made = mcap_bytes()
        for n in range(5):
            made.chunk([told_type("/a", 10 * n + k, bytes([n, k])) for k in range(3)])
        entry = made.entries[2]
        if wrong == "missing":
            made.entries[2:3] = []
        elif wrong == "twice":
            made.entries.append(entry)
        else:
            at, value = {
                "shifted": (25, made.chunks[2].begin + 20),
                "long": (33, 1 << 40),
                "times": (9, 1 << 60),
            }[wrong]
            made.entries[2] = entry[:at] + struct.pack("<Q", value) + entry[at + 8 :]
        path = tmp_path / f"{wrong}.mcap"
        path.write_bytes(made.finish())
        with McapSource(path) as source:
            assert [row[1] for row in given_by(source)] == [10 * n + k for n in range(5) for k in range(3)], wrong
            assert source.faults.count("summary_damaged") >= 1, wrong


@pytest.mark.parametrize("behind", [False, True])
def test_messages_that_an_index_leaves_out_are_found(
    tmp_path: Path, mcap_bytes: Any, told_type: Any, behind: bool
) -> None:
    """``behind``: the message indexes are there behind the chunk, but the chunk index does not tell of them all."""
    made = mcap_bytes()
    for n in range(3):
        told = [told_type("/b" if k % 2 else "/a", 10 * n + k, bytes(9)) for k in range(6)]
        content, index = made.content(told)
        made.chunk_of(content, {1: index[1]} if n == 1 and not behind else index, told)
    if behind:
        entry = made.entries[1]
        (size,) = struct.unpack_from("<I", entry, 9 + 32)
        assert size == 2 * 10
        lengths = struct.pack("<BQ", 8, len(entry) - 9 - 10)
        made.entries[1] = lengths + entry[9:41] + struct.pack("<I", 10) + entry[45:55] + entry[65:]
    path = tmp_path / "partial.mcap"
    path.write_bytes(made.finish())
    with McapSource(path) as source:
        assert len(list(source.messages(["/a"]))) == 9
        assert len(list(source.messages(["/b"]))) == 9
        assert len(list(source.messages())) == 18
        assert [(f.cause, f.topic, f.count) for f in source.faults] == [("index_partial", "", 1)]


@pytest.mark.parametrize("wrong", [name for name in WRONG if name.startswith("entries")])
@pytest.mark.parametrize("told", [Told(), Told(statistics=False), Told(summary=False), Told(chunk_indexes=False)])
def test_no_scan_is_lost_by_what_its_index_says(tmp_path: Path, told: Told, wrong: str) -> None:
    """Nobody counted the messages, where there are no statistics: then the chunks are held against their indexes."""
    path = tmp_path / "left_out.mcap"
    chunks = [Chunk(scans_at(range(5 * n + 1, 5 * n + 6))) for n in range(4)]
    path.write_bytes(assembled([*HEAD, *chunks], replace(told, wrong=frozenset({wrong}))))
    with McapSource(path) as source:
        assert [scan.log_ns for scan in source.scans()] == [n * S for n in range(1, 21)]
        assert [message.log_ns for message in source.messages()] == [n * S for n in range(1, 21)]
        assert not source.faults.count("count_differs")


def test_messages_that_an_index_leaves_out_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "left_out.mcap"
    chunks = [Chunk(scans_at(range(5 * n + 1, 5 * n + 6))) for n in range(4)]
    path.write_bytes(assembled([*HEAD, *chunks], Told(statistics=False, wrong=frozenset({"entries_few"}))))
    with McapSource(path) as source:
        assert len(list(source.scans())) == 20
        (fault,) = source.faults
        assert (fault.cause, fault.count) == ("index_partial", 4)


def test_channels_described_only_in_a_damaged_chunk_are_taken_from_it(
    tmp_path: Path, mcap_bytes: Any, told_type: Any
) -> None:
    made = mcap_bytes(compression="")
    for n in range(3):
        made.chunk([told_type("/only/here", 10 * n + k, bytes(300)) for k in range(4)])
    first = made.chunks[0]
    made.data[first.end - 100] ^= 1  # in the last message: the checksum is wrong, the description right
    path = tmp_path / "first.mcap"
    path.write_bytes(made.data)
    with McapSource(path) as source:
        assert [row[1] for row in given_by(source)] == [10, 11, 12, 13, 20, 21, 22, 23]
        assert [c.topic for c in source.channels] == ["/only/here"]
        assert {f.cause for f in source.faults} == {"cut_off", "channel_doubtful", "chunk_damaged", "messages_lost"}


def test_a_chunk_that_is_fine_is_not_decompressed_twice_for_want_of_a_summary(
    tmp_path: Path, mcap_bytes: Any, told_type: Any, monkeypatch: Any
) -> None:
    """A cut file's message indexes tell what its chunks hold."""
    made = mcap_bytes()
    for n in range(6):
        made.chunk([told_type("/a", 10 * n + k, bytes(100)) for k in range(4)])
    path = tmp_path / "cut.mcap"
    path.write_bytes(made.data)
    opened: Counter[int] = Counter()

    def counting(*arguments: Any, **options: Any) -> Any:
        opened[arguments[3]] += 1  # the chunk's checksum
        return inflate(*arguments, **options)

    monkeypatch.setattr("mapgraft.recording.containers.mcap_records.inflate", counting)
    with McapSource(path) as source:
        assert sum(opened.values()) == 2  # the first describes the channel, the last may have lost an index
        assert len(given_by(source)) == 24
    assert sum(opened.values()) == 8


def test_chunks_that_claim_or_hold_too_much(tmp_path: Path, mcap_bytes: Any, told_type: Any) -> None:
    """Neither a size that is claimed nor one that comes out is believed beyond the limit."""
    made = mcap_bytes()
    made.chunk([told_type("/a", 1, b"before")])
    made.chunk([told_type("/a", 2, bytes(3_000_000))])
    made.chunk([told_type("/a", 3, b"behind")])
    whole = made.finish()
    path = tmp_path / "bomb.mcap"
    path.write_bytes(whole)
    with McapSource(path, limits=ReadLimits(chunk_bytes=1_000_000)) as source:
        assert [row[1] for row in given_by(source)] == [1, 3]
        assert {f.topic: f.count for f in source.faults if f.cause == "messages_lost"} == {"/a": 1}
    for claimed in (10, 1 << 62, 2**64 - 1):
        hurt = bytearray(whole)
        at = made.chunks[1].begin + 25
        hurt[at : at + 8] = struct.pack("<Q", claimed)
        path.write_bytes(hurt)
        with McapSource(path) as source:
            assert [row[1] for row in given_by(source)] == [1, 3]
            assert source.faults.count("chunk_damaged") == 1


def test_a_file_that_claims_to_unpack_to_thousands_of_times_its_size(
    tmp_path: Path, mcap_bytes: Any, told_type: Any, monkeypatch: Any
) -> None:
    monkeypatch.setattr("mapgraft.recording.containers.limits.FREE_BYTES", 5_000_000)
    made = mcap_bytes()
    for n in range(12):
        made.chunk([told_type("/a", n, bytes(1_000_000))])
    for whole in (bytes(made.data), made.finish()):
        path = tmp_path / "bomb.mcap"
        path.write_bytes(whole)
        with pytest.raises(RecordingError, match=r"unpacks to .* raise limits\.expansion"):
            McapSource(path)
        with McapSource(path, limits=ReadLimits(expansion=1e6)) as source:
            assert len(given_by(source)) == 12


@pytest.mark.parametrize("length", [0, 2**63 - 1, 2**64 - 1, 1 << 40, 10])
def test_record_lengths_that_lie(tmp_path: Path, mcap_bytes: Any, told_type: Any, length: int) -> None:
    """Of a chunk, and of records of every other kind: what comes behind is found again."""
    for opcode in (3, 4, 5, 6, 7, 9, 12, 99, 200):
        made = mcap_bytes(declare="every")
        made.chunk([told_type("/a", 1, b"one")])
        made.data += struct.pack("<BQ", opcode, length) + bytes(range(1, 60))
        made.chunk([told_type("/a", 2, b"two")])
        path = tmp_path / "lie.mcap"
        path.write_bytes(made.data)
        with McapSource(path) as source:
            assert [row[1] for row in given_by(source)] == [1, 2], opcode
            assert source.faults.count("records_damaged") >= 1


def test_a_tail_of_zeros(tmp_path: Path, mcap_bytes: Any, told_type: Any) -> None:
    """What a file system leaves behind after the power has gone."""
    for compression in ("", "lz4", "zstd"):
        made = mcap_bytes(compression=compression)
        for n in range(3):
            made.chunk([told_type("/a", n, bytes(range(200)))])
        end = made.chunks[2].begin + 60
        path = tmp_path / "power.mcap"
        path.write_bytes(bytes(made.data[:end]) + bytes(5000))
        with McapSource(path) as source:
            assert [row[1] for row in given_by(source)] == [0, 1]
            assert source.faults.count("cut_off") == 1


def test_empty_and_nearly_empty_files(tmp_path: Path, mcap_bytes: Any) -> None:
    path = tmp_path / "short.mcap"
    whole = mcap_bytes().finish()
    for length in range(8):
        path.write_bytes(whole[:length])
        with pytest.raises(RecordingError, match=r"is empty|does not begin"):
            McapSource(path)
    for length in range(8, len(whole) + 1):
        path.write_bytes(whole[:length])
        with McapSource(path) as source:
            assert given_by(source) == []
