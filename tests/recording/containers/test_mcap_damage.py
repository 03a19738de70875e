"""MCAP files that were cut off or damaged: what can be read is read, nothing false is given, and the loss is told."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import IndexType

from mapgraft.errors import RecordingError
from mapgraft.recording.containers.mcap_file import McapSource

THOROUGH = settings(max_examples=250, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
MAGIC_BYTES = 8


def told(source: McapSource) -> list[tuple[str, int, int]]:
    return [(m.channel.topic, m.log_ns, crc32(m.data)) for m in source.messages()]


@pytest.fixture(params=["", "lz4", "zstd"])
def compression(request: Any) -> str:
    kind: str = request.param
    return kind


@pytest.fixture
def recording(write_mcap: Any, ros2_scans: Any, compression: str) -> tuple[Path, list[tuple[str, int, int]]]:
    """Five chunks of four scans on two topics, and what they hold."""
    samples = [ros2_scans.sample(10 * n, "/a" if n % 2 else "/b", beams=60) for n in range(20)]
    path = write_mcap([samples[n : n + 4] for n in range(0, 20, 4)], compression=compression)
    return path, [(s.topic, s.log_ns, crc32(s.data)) for s in samples]


@THOROUGH
@given(where=st.floats(0, 1))
def test_cut_anywhere(recording: Any, where: float) -> None:
    """A cut file gives a beginning of what was recorded, and says that it was cut."""
    path, everything = recording
    whole = path.read_bytes()
    length = int(where * (len(whole) - 1))
    cut = path.with_name("cut.mcap")
    cut.write_bytes(whole[:length])
    if length < MAGIC_BYTES:
        with pytest.raises(RecordingError, match=r"is empty|does not begin"):
            McapSource(cut)
        return
    with McapSource(cut) as source:
        found = told(source)
        assert found == everything[: len(found)]
        assert source.faults.count("cut_off") == 1
        assert sum(channel.count or 0 for channel in source.channels) == len(found)
        complete = sum(1 for place in McapSource(path)._places if place.end <= length)
        assert len(found) >= 4 * complete
        assert [scan.log_ns for scan in source.scans()] == [row[1] for row in found]


def test_a_chunk_cut_in_the_middle_still_gives_its_beginning(
    write_mcap: Any, ros2_scans: Any, compression: str
) -> None:
    samples = [ros2_scans.sample(n, beams=2000) for n in range(60)]  # compressors work in blocks of 64 or 128 KiB
    path = write_mcap([samples[:20], samples[20:]], compression=compression)
    second = McapSource(path)._places[1]
    path.write_bytes(path.read_bytes()[: second.end - 20_000])
    source = McapSource(path)
    assert source.faults.count("chunk_partial") == 1
    found = told(source)
    assert 20 < len(found) < 60
    assert found == [(s.topic, s.log_ns, crc32(s.data)) for s in samples[: len(found)]]


@THOROUGH
@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_any_bit_turned(recording: Any, where: float, bit: int) -> None:
    """No bit can make a reader crash, or give a message that was never recorded from a checked chunk."""
    path, everything = recording
    whole = bytearray(path.read_bytes())
    whole[int(where * len(whole))] ^= 1 << bit
    hurt = path.with_name("hurt.mcap")
    hurt.write_bytes(whole)
    try:
        source = McapSource(hurt)
    except RecordingError:
        assert int(where * len(whole)) < MAGIC_BYTES
        return
    found, known = told(source), Counter(everything)
    strangers = Counter(found) - known
    assert not strangers or source.faults.count("chunk_partial"), strangers
    assert len(found) >= len(everything) - 4 or len(source.faults) > 0
    scans = [(s.channel.topic, s.log_ns) for s in source.scans()]
    assert Counter(scans) == Counter((topic, log_ns) for topic, log_ns, _ in found)


def test_a_damaged_chunk_is_left_out_and_counted_once(recording: Any, compression: str) -> None:
    path, everything = recording
    place = McapSource(path)._places[1]
    whole = bytearray(path.read_bytes())
    middle = (place.offset + place.end) // 2
    whole[middle : middle + 40] = bytes(40)
    path.write_bytes(whole)
    with McapSource(path) as source:
        found = told(source)
        assert told(source) == found
        assert [row for row in everything if row in found] == found
        assert set(everything[:4] + everything[8:]) <= set(found)
        fault, *lost = source.faults
        assert {(fault.cause, fault.count) for fault in lost} == {("messages_lost", 2)}  # on each of two topics
        assert (fault.cause, fault.count) in {("chunk_damaged", 1), ("chunk_partial", 1)}
        assert f"byte {place.offset}" in fault.sentence
        if not compression:
            assert fault.sentence.endswith("does not match its checksum: it is left out")
            assert len(found) == 16


@pytest.mark.parametrize("index_types", [IndexType.NONE, IndexType.CHUNK])
def test_damage_without_an_index(write_mcap: Any, ros2_scans: Any, index_types: Any) -> None:
    samples = [ros2_scans.sample(n, beams=60) for n in range(12)]
    path = write_mcap([samples[n : n + 3] for n in range(0, 12, 3)], index_types=index_types, compression="")
    whole = bytearray(path.read_bytes())
    at = whole.find(samples[4].data) + 100
    whole[at] ^= 0xFF
    path.write_bytes(whole)
    source = McapSource(path)
    assert [row[1] for row in told(source)] == [0, 1, 2, 6, 7, 8, 9, 10, 11]
    assert source.faults.count("chunk_damaged") == 1


def test_a_damaged_summary_is_walked_around(recording: Any) -> None:
    path, everything = recording
    whole = bytearray(path.read_bytes())
    whole[-300] ^= 0xFF
    path.write_bytes(whole)
    source = McapSource(path)
    assert told(source) == everything
    assert source.faults.count("summary_damaged") == 1


def test_a_chunk_that_claims_to_be_huge(write_mcap: Any, ros2_scans: Any) -> None:
    """Sizes are not believed: no memory is asked for that the data does not fill."""
    path = write_mcap([[ros2_scans.sample(n)] for n in range(3)], compression="zstd")
    place = McapSource(path)._places[1]
    whole = bytearray(path.read_bytes())
    whole[place.offset + 25 : place.offset + 33] = (1 << 60).to_bytes(8, "little")
    path.write_bytes(whole)
    source = McapSource(path)
    assert [row[1] for row in told(source)] == [0, 2]
    assert [(f.cause, f.count) for f in source.faults] == [("chunk_damaged", 1), ("messages_lost", 1)]
    assert "more than the limit of 134,217,728 (limits.chunk_bytes)" in next(iter(source.faults)).sentence


def test_an_unknown_compression_is_named(write_mcap: Any, ros2_scans: Any) -> None:
    path = write_mcap([[ros2_scans.sample(n)] for n in range(3)], compression="zstd")
    path.write_bytes(path.read_bytes().replace(b"\x04\x00\x00\x00zstd", b"\x04\x00\x00\x00zstq"))
    source = McapSource(path)
    assert told(source) == []
    sentences = [fault.sentence for fault in source.faults if fault.cause == "chunk_damaged"]
    assert "compressed with 'zstq', which is unknown here" in sentences[0]
