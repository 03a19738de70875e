"""MCAP files as recorders write them."""

from __future__ import annotations

from typing import Any
from zlib import crc32

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import IndexType

from mapgraft.contracts.sources import Source
from mapgraft.errors import RecordingError
from mapgraft.recording.containers import chunks as chunk_reading
from mapgraft.recording.containers.mcap_file import McapSource

QUICK = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def told(source: Source, **window: Any) -> list[tuple[str, int, int]]:
    return [(m.channel.topic, m.log_ns, crc32(m.data)) for m in source.messages(**window)]


def written(*chunks: Any) -> list[tuple[str, int, int]]:
    return [(s.topic, s.log_ns, crc32(s.data)) for chunk in chunks for s in chunk]


@pytest.fixture
def two_chunks(ros2_scans: Any) -> list[list[Any]]:
    """Two topics, twelve scans, in order of time."""
    samples = [ros2_scans.sample(1000 + 10 * n, "/front" if n % 3 else "/rear") for n in range(12)]
    return [samples[:7], samples[7:]]


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"index_types": IndexType.NONE},
        {"index_types": IndexType.CHUNK},
        {"repeat_channels": False, "repeat_schemas": False},
        {"use_statistics": False},
        {"use_chunking": False},
        {"use_chunking": False, "repeat_channels": False, "repeat_schemas": False},
        {"enable_crcs": False},
        {"finish": False},
    ],
    ids=lambda options: " ".join(options) or "usual",
)
def test_every_way_to_write_a_file_reads_the_same(
    write_mcap: Any, two_chunks: Any, compression: str, options: Any
) -> None:
    path = write_mcap(two_chunks, compression=compression, **options)
    with McapSource(path) as source:
        assert told(source) == written(*two_chunks)
        assert [c.topic for c in source.channels] == ["/rear", "/front"]
        assert all(c.decodable and c.message_type == "sensor_msgs/msg/LaserScan" for c in source.channels)
        assert (source.start_ns, source.end_ns) == (1000, 1110)
        assert [len(list(source.scans())), len(list(source.scans(["/rear"])))] == [12, 4]
        expected = {"cut_off"} if options.get("finish") is False else set()
        assert {fault.cause for fault in source.faults} == expected
        if options.get("use_statistics", True) or options.get("finish") is False:
            assert [c.count for c in source.channels] == [4, 8]


def test_topics_and_windows_are_inclusive_and_skip_chunks(write_mcap: Any, two_chunks: Any) -> None:
    source = McapSource(write_mcap(two_chunks))
    everything = written(*two_chunks)
    assert told(source, topics=["/rear"]) == [row for row in everything if row[0] == "/rear"]
    assert told(source, start_ns=1030, end_ns=1070) == [row for row in everything if 1030 <= row[1] <= 1070]
    assert told(source, start_ns=1111) == [] == told(source, topics=[]) == told(source, topics=["/none"])
    assert [s.log_ns for s in source.scans(["/rear"], 1030, 1090)] == [1030, 1060, 1090]


def test_a_chunk_without_the_topic_is_not_even_decompressed(write_mcap: Any, ros2_scans: Any) -> None:
    path = write_mcap([[ros2_scans.sample(1, "/a")], [ros2_scans.sample(2, "/b")]])
    whole = bytearray(path.read_bytes())
    second = whole.find(b"\x28\xb5\x2f\xfd", whole.find(b"\x28\xb5\x2f\xfd") + 4)  # the second zstd frame
    whole[second + 12] ^= 0xFF
    path.write_bytes(whole)
    source = McapSource(path)
    assert [row[1] for row in told(source, topics=["/a"])] == [1]
    assert len(source.faults) == 0
    told(source)
    assert source.faults.count("chunk_partial") + source.faults.count("chunk_damaged") == 1


@QUICK
@given(
    data=st.lists(
        st.lists(st.tuples(st.integers(0, 40), st.sampled_from(["/a", "/b"])), min_size=1, max_size=8),
        min_size=1,
        max_size=9,
    ),
    resident=st.sampled_from([0, 40_000, 1 << 25]),
)
def test_overlapping_chunks_come_in_log_order(
    write_mcap: Any, ros2_scans: Any, monkeypatch: Any, data: Any, resident: int
) -> None:
    """Whatever overlaps: by log time, then by chunk, then as written; however few chunks fit into memory."""
    monkeypatch.setattr(chunk_reading, "RESIDENT_BYTES", resident)
    seeds = iter(range(100))
    chunks = [[ros2_scans.sample(t, topic, 30, seed=next(seeds)) for t, topic in chunk] for chunk in data]
    expected = sorted(written(*chunks), key=lambda row: row[1])
    source = McapSource(write_mcap(chunks, compression="lz4"))
    assert told(source) == expected
    assert [s.log_ns for s in source.scans()] == [row[1] for row in expected]
    assert len(source.faults) == 0


def test_two_passes_at_once(write_mcap: Any, two_chunks: Any) -> None:
    source = McapSource(write_mcap(two_chunks))
    first, second = source.messages(), source.messages()
    pairs = list(zip(first, second, strict=True))
    assert len(pairs) == 12
    assert all(one.log_ns == other.log_ns for one, other in pairs)


def test_ranges_outlive_their_file(write_mcap: Any, two_chunks: Any, ros2_scans: Any) -> None:
    for compression in ("", "zstd"):
        source = McapSource(write_mcap(two_chunks, compression=compression))
        scans = [recorded.scan for recorded in source.scans()]
        source.close()
        del source
        for scan, sample in zip(scans, [s for chunk in two_chunks for s in chunk], strict=True):
            message = ros2_scans.store.deserialize_cdr(sample.data, ros2_scans.name)
            assert np.array_equal(scan.ranges_m, message.ranges)
            assert not scan.ranges_m.flags.writeable


def test_a_file_closed_while_it_is_read_says_so(write_mcap: Any, ros2_scans: Any) -> None:
    source = McapSource(write_mcap([[ros2_scans.sample(n)] for n in range(30)]))
    messages = source.messages()
    next(messages)
    source.close()
    with pytest.raises(RecordingError, match="was closed"):
        list(messages)


def test_latched_channels(tmp_path: Any, ros2_scans: Any) -> None:
    from mcap.writer import Writer

    path = tmp_path / "latched.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        schema = writer.register_schema(*ros2_scans.schema)
        profiles = ["- durability: 1", "- durability: transient_local", "- durability: 2", "- durability: volatile", ""]
        for n, profile in enumerate(profiles):
            writer.register_channel(f"/{n}", "cdr", schema, {"offered_qos_profiles": profile})
        writer.register_channel("/ros1", "cdr", schema, {"latching": "1"})
        writer.add_message(1, 1, ros2_scans.sample(1).data, 1)
        writer.finish()
    assert [c.latched for c in McapSource(path).channels] == [True, True, False, False, False, True]


def test_a_chunk_whose_index_lies_about_its_start_comes_late_and_is_counted(write_mcap: Any, ros2_scans: Any) -> None:
    chunks = [[ros2_scans.sample(n)] for n in (10, 20)]
    path = write_mcap(chunks, enable_crcs=False)
    whole = bytearray(path.read_bytes())
    at = whole.rfind((10).to_bytes(8, "little") + (10).to_bytes(8, "little"))  # start and end in the chunk index
    whole[at : at + 16] = (30).to_bytes(8, "little") + (40).to_bytes(8, "little")
    path.write_bytes(whole)
    source = McapSource(path)
    assert sorted(row[1] for row in told(source)) == [10, 20]
    assert source.faults.count("late_messages") == 1


def test_no_messages_at_all(write_mcap: Any) -> None:
    source = McapSource(write_mcap([]))
    assert (source.channels, source.start_ns, source.end_ns, list(source.messages())) == ((), None, None, [])
