"""Channels that one file describes twice, differently: every message is read as it was meant, or that is said."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest

from mapgraft.recording.containers.mcap_file import McapSource


def topics(path: Path) -> list[tuple[str, bytes]]:
    """Under which topic each message is read, and what it says."""
    with McapSource(path) as source:
        return [(message.channel.topic, bytes(message.data)) for message in source.messages()]


def faults(path: Path) -> dict[str, str]:
    with McapSource(path) as source:
        list(source.messages())
        return {fault.cause: fault.sentence for fault in source.faults}


def text(value: bytes) -> bytes:
    return struct.pack("<I", len(value)) + value


def schema(number: int, name: bytes, data: bytes) -> bytes:
    body = struct.pack("<H", number) + text(name) + text(b"jsonschema") + text(data)
    return struct.pack("<BQ", 3, len(body)) + body


@pytest.fixture
def two_files(mcap_bytes: Any, told_type: Any) -> tuple[bytes, bytes]:
    """Two recordings that use the same ids for different topics; each message says its topic."""
    made = []
    for start_ns, names in ((100, ("/a", "/b", "/same")), (200, ("/c", "/d", "/same"))):
        file = mcap_bytes()
        for chunk in range(3):
            file.chunk([told_type(names[n % 3], start_ns + 10 * chunk + n, names[n % 3].encode()) for n in range(6)])
        made.append(file.finish())
    return made[0], made[1]


@pytest.mark.parametrize("ended", [(0, 0), (0, 40), (60, 0), (60, 40), (0, 400)])
def test_files_that_were_joined_to_one(tmp_path: Path, two_files: tuple[bytes, bytes], ended: tuple[int, int]) -> None:
    first, second = (data[: len(data) - cut] for data, cut in zip(two_files, ended, strict=True))
    path = tmp_path / "joined.mcap"
    path.write_bytes(first + second)
    found = topics(path)
    assert {topic for topic, _ in found} == {"/a", "/b", "/c", "/d", "/same"}
    assert len(found) == 36 and all(topic.encode() == data for topic, data in found)
    assert "described again, as another" in faults(path)["channel_redefined"]


def test_a_file_that_was_joined_to_itself_redefines_nothing(tmp_path: Path, two_files: tuple[bytes, bytes]) -> None:
    path = tmp_path / "twice.mcap"
    path.write_bytes(two_files[0] * 2)
    assert len(topics(path)) == 36 and "channel_redefined" not in faults(path)


def test_an_id_that_changes_its_meaning_within_a_chunk(tmp_path: Path, mcap_bytes: Any, told_type: Any) -> None:
    file = mcap_bytes()
    content, rows = b"", []
    for n, topic in enumerate(("/a", "/b", "/b", "/a")):
        content += file.channel(topic, number=1)
        rows.append((n, len(content)))
        content += file.message(told_type(topic, n, topic.encode()), number=1)
    file.chunk_of(content, {1: rows})
    file.chunk_of(file.message(told_type("/a", 9, b"/a"), number=1), {1: [(9, 0)]})
    path = tmp_path / "changing.mcap"
    path.write_bytes(file.finish(chunk_index=False, channels=False, statistics=False))
    assert topics(path) == [(topic, topic.encode()) for topic in ("/a", "/b", "/b", "/a", "/a")]


def test_a_schema_that_is_described_again(tmp_path: Path, mcap_bytes: Any, told_type: Any) -> None:
    path = tmp_path / "versions.mcap"
    with path.open("wb") as joined:
        for n, version in enumerate((b"{}", b'{"a": 1}')):
            file = mcap_bytes()
            content = schema(7, b"some/Thing", version) + file.channel("/a", number=1, schema=7)
            file.chunk_of(content + file.message(told_type("/a", n, version), number=1), {1: [(n, len(content))]})
            joined.write(file.finish())
    with McapSource(path) as source:
        found = [(source.schema(message.channel), bytes(message.data)) for message in source.messages()]
    assert [text and text.data for text, _ in found] == [data for _, data in found] == [b"{}", b'{"a": 1}']


def test_a_summary_that_nothing_is_wrong_with_holds_for_the_whole_file(
    tmp_path: Path, mcap_bytes: Any, told_type: Any
) -> None:
    file = mcap_bytes()
    file.chunk([told_type("/a", 1, b"1")])
    file.data += file.channel("/other", number=file.channels["/a"])
    file.chunk([told_type("/a", 2, b"2")])
    path = tmp_path / "contradicted.mcap"
    path.write_bytes(file.finish())
    assert topics(path) == [("/a", b"1"), ("/a", b"2")]
    assert "described twice, differently: what the summary says holds" in faults(path)["channel_redefined"]
