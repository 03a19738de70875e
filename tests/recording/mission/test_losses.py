"""What was lost of a damaged recording is told by ``info`` and ``run`` and kept in the outputs, by cause and topic."""

from __future__ import annotations

import dataclasses
import io
import json
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

import mapgraft
from mapgraft.config import Config, MissionConfig, load_config
from mapgraft.contracts import RecordingError
from mapgraft.recording.survey import survey
from mapgraft_recordings import demo_files

SCAN = "/alpha/scan"


@pytest.fixture(scope="module")
def damaged(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], Config, int]:
    """The demo's files with one chunk of the first destroyed; the configuration; how many scans the chunk held."""
    files, config, _ = demo_files()
    folder = tmp_path_factory.mktemp("damaged")
    copies = [folder / file.name for file in files]
    for file, copy in zip(files, copies, strict=True):
        copy.write_bytes(file.read_bytes())
    whole = bytearray(copies[0].read_bytes())
    chunks = [r for r in StreamReader(io.BytesIO(whole), emit_chunks=True).records if isinstance(r, Chunk)]
    inside = breakup_chunk(chunks[1])
    (scan,) = {r.id for chunk in chunks for r in breakup_chunk(chunk) if isinstance(r, Channel) and r.topic == SCAN}
    at = whole.index(chunks[1].data) + 2000  # so early that nothing before it is given
    whole[at : at + 3000] = bytes(3000)
    copies[0].write_bytes(whole)
    scans = sum(isinstance(record, Message) and record.channel_id == scan for record in inside)
    brief = load_config(config).model_copy(update={"mission": MissionConfig(start_s=84.0, end_s=92.0)})
    return copies, brief, scans


def test_info_tells_it(damaged: tuple[list[Path], Config, int]) -> None:
    files, config, scans = damaged
    found = survey(files, config)
    lost = {(loss.where, loss.topic, loss.cause): loss.count for loss in found.lost}
    assert lost["alpha.mcap", SCAN, "messages_lost"] == scans > 0
    assert lost["alpha.mcap", "", "chunk_damaged"] == 1
    assert not any(where in ("bravo.mcap", "charlie.mcap") for where, _, _ in lost)
    sentences = [problem for problem in found.problems if problem.startswith(f"alpha.mcap: {SCAN}: a message is lost")]
    assert len(sentences) == 1 and sentences[0].endswith(f"({scans:,} times)")
    json.dumps(dataclasses.asdict(found)["lost"])


def test_run_tells_it_and_keeps_it(damaged: tuple[list[Path], Config, int], tmp_path: Path) -> None:
    files, config, scans = damaged
    result = mapgraft.run(files, config, tmp_path)
    assert sum(f"alpha.mcap: {SCAN}: a message is lost" in line for line in result.lost) == 1
    summary = json.loads((tmp_path / "summary.json").read_text())
    with (tmp_path / "alpha.merge.mcap").open("rb") as stream:
        (kept,) = [m.metadata for m in make_reader(stream).iter_metadata() if m.name == "merge_lost"]
    assert json.loads(kept["lost"]) == summary["lost"]
    told = {(row["where"], row["cause"]): row["count"] for row in summary["lost"] if row["topic"] == SCAN}
    assert told["alpha.mcap", "messages_lost"] == scans


def test_a_whole_recording_loses_nothing(damaged: tuple[list[Path], Config, int], tmp_path: Path) -> None:
    files, _, _ = demo_files()
    result = mapgraft.run(files, damaged[1], tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["lost"] == []
    assert result.lost == ()


@pytest.fixture
def beside(tmp_path: Path) -> list[Path]:
    """The demo's files, an empty one beside them, and one that only begins."""
    files, _, _ = demo_files()
    empty, cut = tmp_path / "empty.mcap", tmp_path / "cut.db3"
    empty.write_bytes(b"")
    cut.write_bytes(b"SQLite format 3\0")
    return [*files, empty, cut]


def test_a_recording_that_cannot_be_opened_is_left_out_beside_others_and_told(beside: list[Path]) -> None:
    config = Config(mission=MissionConfig(start_s=0.0, end_s=3.0))
    result = mapgraft.run(beside, config)
    assert set(result.maps) == {"alpha", "bravo", "charlie"}
    said = [sentence for sentence in result.lost if sentence.endswith("it is left out")]
    assert [sentence.split()[0] for sentence in said] == ["empty.mcap", "cut.db3"]
    assert [p for p in survey(beside, config).problems if p.endswith("it is left out")] == said


def test_recordings_that_cannot_be_opened_and_nothing_else_are_an_error(beside: list[Path]) -> None:
    with pytest.raises(RecordingError, match=r"empty\.mcap is empty .*; .*cut\.db3"):
        mapgraft.run(beside[-2:])


def test_a_file_that_the_configuration_needs_must_be_read(beside: list[Path]) -> None:
    config = Config.model_validate({"robots": {"delta": {"files": ["empty.mcap"]}}})
    with pytest.raises(RecordingError, match="is empty"):
        mapgraft.run(beside, config)


def test_what_is_no_recording_is_not_left_out(beside: list[Path], tmp_path: Path) -> None:
    wrong = tmp_path / "notes.txt"
    wrong.write_text("bought milk\n")
    with pytest.raises(RecordingError, match="is not a recording"):
        mapgraft.run([*beside, wrong])
    with pytest.raises(RecordingError, match="does not exist"):
        mapgraft.run([*beside, tmp_path / "missing.mcap"])
