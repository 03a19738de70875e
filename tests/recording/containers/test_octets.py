"""Files elsewhere read by ranges: the same messages as from the disk, and nothing fetched that nobody needs."""

from __future__ import annotations

import random
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mapgraft.contracts.sources import Source
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.mcap_file import McapSource
from mapgraft.recording.containers.octets import BLOCK_BYTES, RangedOctets, unpacked
from mapgraft.recording.containers.opening import open_source

CALM = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
S = 1_000_000_000


def octets_of(data: bytes, asked: list[tuple[int, int]] | None = None) -> RangedOctets:
    def read(begin: int, end: int) -> bytes:
        if asked is not None:
            asked.append((begin, end))
        return data[begin:end]

    return RangedOctets("far.mcap", len(data), read)


def given_by(source: Source, *window: Any) -> list[tuple[str, int, bytes]]:
    with source:
        return [(m.channel.topic, m.log_ns, bytes(m.data)) for m in source.messages(*window)]


@CALM
@given(
    st.integers(1, 5 * BLOCK_BYTES),
    st.lists(st.tuples(st.integers(-10, 6 * BLOCK_BYTES), st.integers(-10, 6 * BLOCK_BYTES)), max_size=6),
)
def test_slices_are_those_of_the_bytes_and_no_block_is_fetched_twice(size: int, slices: list[tuple[int, int]]) -> None:
    data, asked = random.Random(size).randbytes(size), list[tuple[int, int]]()
    octets = octets_of(data, asked)
    assert len(octets) == size
    for begin, end in slices:
        assert octets[begin:end] == data[begin:end]
        assert octets[begin:end].readonly
    assert octets[size - 1] == data[-1] == octets[-1]
    blocks = [block for begin, end in asked for block in range(begin // BLOCK_BYTES, -(-end // BLOCK_BYTES))]
    assert len(blocks) == len(set(blocks))
    assert octets.requests == len(asked) and octets.fetched_bytes == sum(end - begin for begin, end in asked)


def test_fields_behind_the_end_are_an_error_as_in_memory() -> None:
    octets, form = octets_of(bytes(range(10))), struct.Struct("<Q")
    assert unpacked(form, octets, 1) == unpacked(form, memoryview(bytes(range(10))), 1)
    for at in (3, 10, 2**63, 2**64 + 1):
        with pytest.raises(struct.error):
            unpacked(form, octets, at)


def test_views_outlive_the_file_they_are_of() -> None:
    view = octets_of(b"x" * 1000)[10:20]
    assert bytes(view) == b"x" * 10


def test_threads_may_look_at_once() -> None:
    data = random.Random(1).randbytes(8 * BLOCK_BYTES)
    octets, ready = octets_of(data), threading.Barrier(4)

    def look(seed: int) -> bool:
        ready.wait()
        places = random.Random(seed)
        spans = [(at, at + 1000) for at in (places.randrange(len(data)) for _ in range(50))]
        return all(octets[begin:end] == data[begin:end] for begin, end in spans)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(look, range(4)))


def test_what_cannot_be_had_is_told() -> None:
    def refuse(begin: int, end: int) -> bytes:
        raise ConnectionError("the line is dead")

    octets = RangedOctets("far.mcap", 100, refuse)
    assert not octets.broken
    with pytest.raises(RecordingError, match=r"far\.mcap cannot be read: the line is dead") as told:
        octets[:10]
    assert isinstance(told.value.__cause__, OSError) and octets.broken == str(told.value)
    with pytest.raises(RecordingError, match="50 of 100 bytes at byte 0 came"):
        RangedOctets("far.mcap", 100, lambda begin, end: bytes(50))[:10]
    with pytest.raises(RecordingError, match="is empty"):
        RangedOctets("far.mcap", 0, refuse)


MESSAGES = st.lists(st.tuples(st.sampled_from(["/a", "/b"]), st.integers(1, 60), st.integers(0, 400)), max_size=6)
KINDS = st.fixed_dictionaries(
    {"compression": st.sampled_from(["", "lz4", "zstd"]), "message_indexes": st.booleans(), "declare": st.just("every")}
)


@CALM
@given(
    st.lists(MESSAGES, min_size=1, max_size=7),
    KINDS,
    st.booleans(),
    st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 100)), max_size=2),
    st.floats(0.2, 1.0),
)
def test_whole_cut_or_damaged_a_file_elsewhere_reads_as_one_here(
    tmp_path: Path, mcap_bytes: Any, told_type: Any, chunks: Any, kind: Any, ended: bool, damage: Any, cut: float
) -> None:
    made, seeds = mcap_bytes(**kind), random.Random(7)
    for chunk in chunks:
        made.chunk([told_type(topic, log_ns, seeds.randbytes(size)) for topic, log_ns, size in chunk])
    if ended:
        made.finish()
    data = bytearray(made.data)
    for where, length in damage:
        begin = int(where * len(data))
        data[begin : begin + length] = bytes(len(data[begin : begin + length]))
    del data[max(int(cut * len(data)), 9) :]
    path = tmp_path / "near.mcap"
    path.write_bytes(data)
    try:
        near, seen = McapSource(path), None
    except RecordingError as error:
        seen = str(error)
    if seen is not None:
        with pytest.raises(RecordingError, match=r"not an MCAP file|unpacks to"):
            McapSource(path, octets=octets_of(bytes(data)))
        return
    far = McapSource(path, octets=octets_of(bytes(data)))
    assert far.channels == near.channels and (far.start_ns, far.end_ns) == (near.start_ns, near.end_ns)
    assert given_by(far) == given_by(near)
    assert [fault.sentence for fault in far.faults] == [fault.sentence for fault in near.faults]


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_only_the_chunks_of_a_window_are_fetched(write_mcap: Any, ros2_scans: Any, compression: str) -> None:
    chunks = [[ros2_scans.sample(S * (60 * k + n), beams=16_000) for n in range(20)] for k in range(16)]
    path = write_mcap(chunks, compression=compression)
    data = path.read_bytes()
    assert len(data) > 60 * BLOCK_BYTES
    octets = octets_of(data)
    far = open_source(Path("no/such/file.mcap"), octets=octets)
    looked = octets.fetched_bytes
    assert looked <= 3 * BLOCK_BYTES  # the beginning and the summary
    window = (["/scan"], S * 60 * 5, S * 60 * 6 - 1)
    assert given_by(far, *window) == given_by(open_source(path), *window)
    assert octets.fetched_bytes - looked < 2 * len(data) / 16


def test_scans_are_read_by_their_indexes_elsewhere_too(write_mcap: Any, ros2_scans: Any) -> None:
    path = write_mcap([[ros2_scans.sample(S * (10 * k + n)) for n in range(10)] for k in range(8)])
    with open_source(path) as near, open_source(path, octets=octets_of(path.read_bytes())) as far:
        here, there = list(near.scans()), list(far.scans())
    assert len(here) == 80
    for one, other in zip(here, there, strict=True):
        assert (one.log_ns, one.scan.stamp_ns) == (other.log_ns, other.scan.stamp_ns)
        assert (one.scan.ranges_m == other.scan.ranges_m).all()
