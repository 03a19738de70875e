"""Recordings and data set in an object store: the same runs, with no more fetched than is needed."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

import mapgraft
from mapgraft.corpus import Dataset, executor_of, read_plan, run_corpus
from mapgraft.corpus import fetching as fetching_module
from mapgraft.corpus.fetching import fetched_inputs, scratch
from mapgraft.corpus.plan import Job
from mapgraft.corpus.recordings import far_recording
from mapgraft.corpus.running import those_there
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.octets import RangedOctets
from mapgraft_recordings import demo_files


@pytest.fixture(scope="module")
def bucket(s3: Any, recordings: Path) -> str:
    """A bucket that holds the recordings below ``in/``."""
    s3.mkdir("corpus")
    for path in recordings.iterdir():
        s3.put_file(str(path), f"corpus/in/{path.name}")
    return "s3://corpus"


@pytest.fixture
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(2) as executor:
        yield executor


def test_from_store_to_store_by_processes(
    bucket: str, recordings: Path, quick_file: str, tmp_path: Path, content: Callable[[str], dict[str, bytes]]
) -> None:
    jobs = read_plan(f"{bucket}/in", [quick_file])
    assert [job.files for job in jobs] == [(f"{bucket}/in/{name}.mcap",) for name in ("attic", "cellar", "hall")]
    with executor_of("processes", 2) as executor:
        report = run_corpus(jobs, f"{bucket}/set", executor)
        assert len(report.done) == 3 and not report.failed
        again = run_corpus(jobs, f"{bucket}/set", executor)
    assert set(again.kept.values()) == {outcome.run_id for outcome in report.done.values()} and not again.done
    here = str(tmp_path / "set")
    with ThreadPoolExecutor(1) as executor:
        run_corpus(read_plan(str(recordings), [quick_file]), here, executor)
    missions = {row["mission"]: row["run_id"] for row in Dataset(here).table("runs").to_pylist()}
    far, near = Dataset(f"{bucket}/set"), Dataset(here)
    for job, outcome in report.done.items():
        assert outcome.run_id != missions[job.mission]  # the one is known by its ETag, the other by its SHA-256
        for table in ("events", "metrics"):
            one, other = (
                [{**row, "run_id": ""} for row in dataset.table(table).to_pylist() if row["run_id"] == run_id]
                for dataset, run_id in ((far, outcome.run_id), (near, missions[job.mission]))
            )
            assert one and str(one) == str(other)
    told = far.table("recordings").to_pylist()
    assert sorted(row["path"] for row in told) == [job.files[0] for job in jobs]
    assert all(row["sha256"] is None and row["etag"] and row["modified"] is None for row in told)


def test_an_object_that_changes_is_another_run(s3: Any, quick_file: str, recordings: Path, pool: Any) -> None:
    s3.mkdir("changing")
    s3.put_file(str(recordings / "attic.mcap"), "changing/in/room.mcap")
    jobs = read_plan("s3://changing/in", [quick_file])
    assert len(run_corpus(jobs, "s3://changing/set", pool).done) == 1
    s3.put_file(str(recordings / "hall.mcap"), "changing/in/room.mcap")
    assert len(run_corpus(jobs, "s3://changing/set", pool).done) == 1
    assert len(Dataset("s3://changing/set").runs()) == 2


def in_small_chunks(source: Path, path: Path) -> None:
    """A recording with many chunks, as large ones have."""
    with source.open("rb") as given, path.open("wb") as stream:
        writer = Writer(stream, chunk_size=16_384)
        writer.start("ros2")
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(given).iter_messages():
            if channel.id not in channels:
                assert schema is not None
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", kind, channel.metadata)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()


def test_a_window_of_a_mission_fetches_only_its_chunks(
    s3: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks are made smaller than those of large recordings, as this recording is small."""
    monkeypatch.setattr("mapgraft.recording.containers.octets.BLOCK_BYTES", 4096)
    in_small_chunks(demo_files()[0][0], path := tmp_path / "alpha.mcap")
    s3.mkdir("windows")
    s3.put_file(str(path), "windows/alpha.mcap")
    window = {"mission": {"end_s": 10}, "map": {"resolution_m": 0.25}}
    job = Job("alpha", "c", ("s3://windows/alpha.mcap",), json.dumps(window))
    with scratch() as folder:
        inputs = fetched_inputs(job, folder, {})
        (octets,) = inputs.octets.values()
        result = mapgraft.run(inputs.paths, inputs.content, stand_ins=inputs.stand_ins)
        expected = mapgraft.run(path, window)
        assert result.observations == expected.observations >= 10
        assert result.maps["alpha"].layer == expected.maps["alpha"].layer
        assert 0 < inputs.fetched_bytes == octets.fetched_bytes < 0.6 * path.stat().st_size
        assert inputs.known[inputs.paths[0]] == far_recording(job.files[0]).input_file
        assert not inputs.paths[0].stat().st_size  # only a name


def test_what_is_no_mcap_is_fetched_whole_with_what_the_configuration_names(
    s3: Any, shared_data: Path, pool: Any, tmp_path: Path
) -> None:
    s3.mkdir("bags")
    for path in sorted((shared_data / "bags/three_robots_sim").iterdir())[:2]:
        s3.put_file(str(path), f"bags/{path.name}")
    files = ["s3://bags/robot1.bag", "s3://bags/robot2.bag"]
    text = f"""
missions:
  - {{name: sim, files: {files}, config: {{mission: {{end_s: 20}}, map: {{resolution_m: 0.25}}}}}}
"""
    (tmp_path / "corpus.yaml").write_text(text)
    (report,) = [run_corpus(read_plan(str(tmp_path / "corpus.yaml")), "s3://bags/set", pool)]
    (outcome,) = report.done.values()
    assert outcome.fetched_bytes == sum(s3.info(f"bags/{name}.bag")["size"] for name in ("robot1", "robot2"))
    (row,) = Dataset("s3://bags/set").table("runs").to_pylist()
    assert len(row["robots"]) == 2 and "/tmp" not in str(row)


def test_what_persons_say_is_fetched_and_makes_no_other_run(
    s3: Any, recordings: Path, quick: Any, tmp_path: Path, pool: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    s3.mkdir("said")
    hall, place = recordings / "hall.mcap", str(tmp_path / "set")
    receiver, donor = sorted(mapgraft.run(hall, quick).maps)
    labels = f"receiver,donor,label,x_m,y_m,yaw_rad\n{receiver},{donor},right,1.5,2.5,0.5\n"
    s3.pipe_file("said/labels.csv", labels.encode())
    (tmp_path / "labels.csv").write_text(labels)
    texts = [
        json.dumps({"missions": [{"files": [str(hall)], "config": {**quick, "examples": {"truth": truth}}}]})
        for truth in ("s3://said/labels.csv", "labels.csv", "s3://said/none.csv")
    ]
    jobs = []
    for text in texts:
        (tmp_path / "corpus.yaml").write_text(text)
        jobs += read_plan(str(tmp_path / "corpus.yaml"))
    monkeypatch.chdir("/")
    tables = []
    for job in jobs[:2]:
        shutil.rmtree(place, ignore_errors=True)
        report = run_corpus([job], place, pool)
        assert len(report.done) == 1, [failed.outcome.reason for failed in report.failed]
        assert len(run_corpus([job], place, pool).kept) == 1
        tables.append(Dataset(place).table("examples", ["example_id", "truth_by", "truth_T"]))
        assert len(Dataset(place).table("recordings")) == 1
    assert "given" in tables[0]["truth_by"].to_pylist() and tables[0] == tables[1]
    assert set(those_there(jobs, Dataset(place))) == set(jobs)  # told without reading what persons say
    (failed,) = run_corpus(jobs[2:], str(tmp_path / "other"), pool).failed
    assert failed.outcome.reason == "s3://said/none.csv does not exist" and failed.attempts == 1


def test_what_cannot_be_read_is_told_by_its_url(s3: Any, pool: Any, quick_file: str) -> None:
    s3.mkdir("broken")
    s3.pipe_file("broken/in/text.mcap", b"this is no recording at all")
    s3.pipe_file("broken/in/empty.mcap", b"")
    report = run_corpus(read_plan("s3://broken/in", [quick_file]), "s3://broken/set", pool)
    reasons = {failed.job.mission: failed.outcome.reason for failed in report.failed}
    assert reasons.keys() == {"text", "empty"}
    for name, reason in reasons.items():
        assert f"s3://broken/in/{name}.mcap" in reason and "mapgraft-corpus" not in reason
    assert all(failed.attempts == 1 for failed in report.failed)


def test_a_recording_replaced_while_it_is_read_is_not_used(s3: Any, recordings: Path) -> None:
    s3.mkdir("replaced")
    s3.put_file(str(recordings / "attic.mcap"), "replaced/a.mcap")
    with scratch() as folder:
        inputs = fetched_inputs(Job("a", "c", ("s3://replaced/a.mcap",), "{}"), folder, {})
        inputs.require_read()
        s3.put_file(str(recordings / "hall.mcap"), "replaced/a.mcap")
        with pytest.raises(RecordingError, match="was replaced while it was read") as told:
            inputs.require_read()
    assert isinstance(told.value.__cause__, OSError)  # the next time it may stay


def test_a_line_that_breaks_is_tried_again(
    s3: Any, bucket: str, pool: Any, quick_file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The server goes on; what breaks is the reading, twice, as when a line is down for a moment."""
    left = [2]

    def broken(name: str, size_bytes: int, read: Callable[[int, int], bytes]) -> RangedOctets:
        def reading(begin: int, end: int) -> bytes:
            if left[0]:
                left[0] -= 1
                raise ConnectionResetError("connection reset by peer")
            return read(begin, end)

        return RangedOctets(name, size_bytes, reading)

    monkeypatch.setattr(fetching_module, "RangedOctets", broken)
    jobs = [job for job in read_plan(f"{bucket}/in", [quick_file]) if job.mission == "hall"]
    report = run_corpus(jobs, f"{bucket}/{os.getpid()}", pool, retries=2)
    assert report.retried == 2 and len(report.done) == 1
