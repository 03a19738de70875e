"""Reading events back from files that are whole, cut, damaged, or something else."""

from __future__ import annotations

import random
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.writer import Writer

from mapgraft.errors import OutputError
from mapgraft.events import Event
from mapgraft.outputs.mcap_log import EVENTS
from mapgraft.outputs.messages import MERGE_EVENT, MessageEncoder
from mapgraft.outputs.read_back import read_attachment, read_events, told_by


def test_a_cut_file_gives_the_events_before_the_cut(merge_file: Path, tmp_path: Path, events: list[Event]) -> None:
    data = merge_file.read_bytes()
    counts = []
    for size in range(len(data) // 20, len(data), len(data) // 20):
        cut = tmp_path / "cut.mcap.partial"
        cut.write_bytes(data[:size])
        found = read_events(cut)
        assert [e.seq for e in found] == [e.seq for e in events[: len(found)]]
        counts.append(len(found))
    assert counts == sorted(counts) and counts[-1] > counts[0]


def test_a_finished_file_that_is_damaged_is_said(merge_file: Path, tmp_path: Path) -> None:
    data = bytearray(merge_file.read_bytes())
    at = data.index(b"zstd") + 300
    data[at : at + 40] = bytes(40)
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(data)
    with pytest.raises(OutputError, match="is damaged"):
        read_events(damaged)


def test_other_files_are_said(tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    other.write_bytes(b"hello")
    with pytest.raises(OutputError, match="is no MCAP file"):
        read_events(other)
    with pytest.raises(OutputError, match="cannot be read: No such file"):
        read_events(tmp_path / "missing.mcap")


def test_the_configuration_can_be_taken_from_a_cut_file(merge_file: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap.partial"
    cut.write_bytes(merge_file.read_bytes()[:5000])
    for path in (merge_file, cut):
        assert read_attachment(path, "config.yaml") == b"seed: 0\n"
    with pytest.raises(OutputError, match=r"holds no attachment 'layout.json'"):
        read_attachment(cut, "layout.json")


def test_lengths_that_lie_allocate_nothing_and_raise_sentences_only(merge_file: Path, tmp_path: Path) -> None:
    data, chance, path = merge_file.read_bytes(), random.Random(1), tmp_path / "damaged.merge.mcap.partial"
    counts = set()
    for _ in range(40):
        damaged, at = bytearray(data), chance.randrange(8, len(data) - 8)
        damaged[at : at + 8] = chance.choice([b"\xff" * 8, b"\xff\xff\xff\x7f" + bytes(4), bytes(8)])
        path.write_bytes(damaged)
        counts.add(told_by(path).events)
        with suppress(OutputError):
            read_events(path)
    assert len(counts) > 3


@pytest.mark.parametrize("change", ["another field", "nothing that is a type", "nothing at all"])
def test_events_with_other_fields_are_not_guessed_at(tmp_path: Path, change: str) -> None:
    """A recording of another version: its own description of the events is not what is read here."""
    encoder, path = MessageEncoder(), tmp_path / "old.merge.mcap"
    text = encoder.definition(MERGE_EVENT)
    told = {"another field": text.replace("float64 scale", "float32 scale"), "nothing that is a type": "no type!"}
    assert encoder.is_as_here(MERGE_EVENT, text) and told["another field"] != text
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema(MERGE_EVENT, "ros2msg", told.get(change, "").encode())
        channel = writer.register_channel(EVENTS, "cdr", schema)
        writer.add_message(channel, 0, b"\0\1\0\0" + bytes(80), 0)
        writer.finish()
    with pytest.raises(OutputError, match="another version of mapgraft"):
        read_events(path)
