"""A corpus comes to its end whatever its recordings and workers do, and what is there is not done again."""

from __future__ import annotations

import json
import os
import shutil
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.compute as pc
import pytest

import mapgraft
from mapgraft.corpus import Dataset, Job, executor_of, read_plan, run_corpus, working
from mapgraft.corpus.dataset import PART, TABLES
from mapgraft.corpus.fetching import fetched_inputs
from mapgraft.corpus.member import WorkerDiedError
from mapgraft.corpus.working import Task, work
from mapgraft.errors import OutputError, RecordingError
from mapgraft.outputs.labels import label

Content = Callable[[str], dict[str, bytes]]


class Inline(Executor):
    """Runs calls at once, in the order given; ``broken`` calls, by their number, end as if their worker had died."""

    def __init__(self, broken: tuple[int, ...] = ()) -> None:
        self.calls, self._broken = 0, broken

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.calls += 1
        if self.calls in self._broken:
            future.set_exception(WorkerDiedError("its process has ended"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


@pytest.fixture(scope="module")
def jobs(recordings: Path, quick_file: str) -> list[Job]:
    return read_plan(str(recordings), [quick_file])


@pytest.fixture(scope="module")
def done(jobs: list[Job], tmp_path_factory: pytest.TempPathFactory) -> str:
    """A data set with all of them."""
    place = str(tmp_path_factory.mktemp("done") / "set")
    report = run_corpus(jobs, place, Inline())
    assert len(report.done) == 3 and not report.failed
    return place


def test_the_tables_hold_what_single_runs_give(jobs: list[Job], done: str, quick: Any) -> None:
    dataset = Dataset(done)
    results = {job.mission: mapgraft.run(job.files, quick) for job in jobs}
    runs = {row["mission"]: row for row in dataset.table("runs").to_pylist()}
    assert runs.keys() == results.keys() and any(row["merges"] for row in runs.values())
    for mission, result in results.items():
        assert runs[mission]["run_id"] == result.run_id
        assert runs[mission]["observations"] == result.observations == 80
        assert runs[mission]["confirmed"] + runs[mission]["provisional"] == len(result.standing)
        for name, expected in (("events", result.events_table), ("metrics", result.metrics_table)):
            found = dataset.table(name).filter(pc.field("run_id") == result.run_id).drop("run_id")
            assert str(found.to_pylist()) == str(expected.to_pylist())  # as text: NaN equals nothing
    assert dataset.runs() == {result.run_id for result in results.values()}
    assert (
        len(dataset.table("recordings")) == 3 and len(dataset.table("maps")) >= 6 and not len(dataset.table("labels"))
    )


def test_what_is_there_is_not_done_again(jobs: list[Job], done: str, content: Content) -> None:
    before, executor = content(done), Inline()
    report = run_corpus(jobs, done, executor)
    assert executor.calls == 0 and len(report.kept) == 3 and not report.done
    assert content(done) == before


def test_a_recording_elsewhere_on_the_disk_is_the_same_run(
    jobs: list[Job], done: str, recordings: Path, quick_file: str, tmp_path: Path
) -> None:
    shutil.copytree(recordings, tmp_path / "copy")
    for path in (tmp_path / "copy").iterdir():
        os.utime(path, (1, 1))
    report = run_corpus(read_plan(str(tmp_path / "copy"), [quick_file]), done, executor := Inline())
    assert executor.calls == 3  # somebody had to read them to find out
    assert len(report.kept) == 3 and set(report.kept.values()) == Dataset(done).runs()


def test_threads_and_processes_write_the_same(jobs: list[Job], done: str, content: Content, tmp_path: Path) -> None:
    expected = content(done)
    for name in ("threads", "processes"):
        with executor_of(name, 2) as executor:
            report = run_corpus(jobs, str(tmp_path / name), executor)
        assert len(report.done) == 3
        assert content(str(tmp_path / name)) == expected


def test_a_bad_recording_stops_nobody_and_is_forgiven_when_it_is_mended(
    recordings: Path, quick_file: str, done: str, content: Content, tmp_path: Path
) -> None:
    folder, place = tmp_path / "folder", str(tmp_path / "set")
    shutil.copytree(recordings, folder)
    whole = (folder / "cellar.mcap").read_bytes()
    (folder / "cellar.mcap").write_bytes(b"this is no recording")
    jobs = read_plan(str(folder), [quick_file])
    said: list[tuple[int, int, str]] = []
    report = run_corpus(jobs, place, Inline(), progress=lambda *told: said.append(told))
    assert [job.mission for job in report.done] == ["attic", "hall"]
    (row,) = Dataset(place).table("failures").to_pylist()
    assert (row["mission"], row["config"], row["error"], row["attempts"]) == ("cellar", "quick", "RecordingError", 1)
    assert "is not an MCAP file" in row["reason"] and row["files"] == [str(folder / "cellar.mcap")]
    assert [done for done, *_ in said] == [1, 2, 3] and said[-1][2].endswith("1 failed")
    (folder / "cellar.mcap").write_bytes(whole)
    report = run_corpus(jobs, place, Inline())
    assert len(report.done) == 1 and len(report.kept) == 2
    assert not Dataset(place).failures()
    ours, theirs = content(place), content(done)
    assert ours.keys() == theirs.keys()
    for name in ours:
        assert ours[name] == theirs[name] or name.startswith("recordings/")  # they tell paths


def test_a_worker_that_dies_is_tried_again_and_not_for_ever(jobs: list[Job], tmp_path: Path) -> None:
    report = run_corpus(jobs[:1], str(tmp_path / "a"), Inline(broken=(1, 2)), retries=2)
    assert len(report.done) == 1 and report.retried == 2
    report = run_corpus(jobs[:1], str(tmp_path / "b"), executor := Inline(broken=(1, 2, 3, 4)), retries=2)
    (failed,) = report.failed
    assert executor.calls == 3 and failed.attempts == 3
    (row,) = Dataset(str(tmp_path / "b")).table("failures").to_pylist()
    assert (row["error"], row["attempts"]) == ("WorkerDiedError", 3)


def test_a_job_that_takes_too_long_is_ended_and_told_and_stops_nobody(jobs: list[Job], tmp_path: Path) -> None:
    place = str(tmp_path / "set")
    limited = [replace(jobs[0], time_limit_s=0.01), *(replace(job, time_limit_s=600.0) for job in jobs[1:])]
    with executor_of("processes", 1) as executor:
        report = run_corpus(limited, place, executor)
    assert len(report.done) == 2 and not report.retried
    (row,) = Dataset(place).table("failures").to_pylist()
    assert (row["mission"], row["error"], row["attempts"]) == (jobs[0].mission, "TimeLimitError", 1)
    assert row["reason"].startswith("it was ended after 0.01 s, as job_time_limit_s says: ")
    report = run_corpus(limited, place, Inline())  # which cannot end a job
    assert len(report.done) == 1 and len(report.kept) == 2 and not Dataset(place).failures()


def test_where_the_executor_breaks_no_job_is_to_blame(jobs: list[Job], tmp_path: Path) -> None:
    class Breaking(Executor):
        """Does one call, and none after it; the next is taken, and every further one refused."""

        def __init__(self) -> None:
            self.calls = 0

        def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
            self.calls += 1
            future: Future[Any] = Future()
            if self.calls == 1:
                future.set_result(fn(*args, **kwargs))
            elif self.calls < broken:
                future.set_exception(BrokenExecutor("all have left."))
            else:
                raise BrokenExecutor("all have left.")
            return future

    for broken in (2, 4):
        place = str(tmp_path / str(broken))
        with pytest.raises(OutputError, match=r"^all have left: what is done .* the same command goes on from there$"):
            run_corpus(jobs, place, Breaking(), retries=0)
        assert len(Dataset(place).runs()) == 1 and not Dataset(place).failures()
        assert len(run_corpus(jobs, place, Inline()).done) == 2


def test_a_recording_that_changes_while_it_is_read_is_not_used(
    recordings: Path, quick_file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    path, place = tmp_path / "in" / "room.mcap", str(tmp_path / "set")
    shutil.copy(recordings / "attic.mcap", path)
    (job,) = read_plan(str(tmp_path / "in"), [quick_file])
    later, run = [b"this is no recording", (recordings / "hall.mcap").read_bytes()], working.run

    def disturbed(*given: Any, **named: Any) -> Any:
        if later:
            path.write_bytes(later.pop())
        return run(*given, **named)

    monkeypatch.setattr(working, "run", disturbed)
    for _ in range(2):  # by another recording, and by what cannot be read
        outcome = work(Task(job, place))
        assert (outcome.state, outcome.again) == ("failed", True)
        assert outcome.reason == f"{path} was changed while it was read"
        assert not Dataset(place).runs()
    shutil.copy(recordings / "hall.mcap", path)
    assert work(Task(job, place)).state == "done"
    (row,) = Dataset(place).table("runs").to_pylist()
    assert row["run_id"] == mapgraft.run(path, json.loads(Path(quick_file).read_text())).run_id


def test_a_folder_that_changes_while_it_is_read_is_noticed(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    for name in ("metadata.yaml", "bag_0.db3"):
        (bag / name).write_bytes(b"x")
    inputs = fetched_inputs(Job("bag", "c", (str(bag),), "{}"), tmp_path, {})
    (bag / "bag_0.db3-shm").write_bytes(b"by who reads it")
    inputs.require_read()
    for change in (lambda: (bag / "bag_1.db3").write_bytes(b"x"), lambda: (bag / "bag_0.db3").write_bytes(b"xy")):
        inputs = fetched_inputs(Job("bag", "c", (str(bag),), "{}"), tmp_path, {})
        change()
        with pytest.raises(RecordingError, match="bag was changed while it was read") as told:
            inputs.require_read()
        assert isinstance(told.value.__cause__, OSError)  # the next time it may stay


def test_what_was_half_appended_is_done_again_and_counts_only_then(
    jobs: list[Job], done: str, content: Content, tmp_path: Path
) -> None:
    expected, place = content(done), tmp_path / "set"
    shutil.copytree(done, place)
    run_id = sorted(Dataset(done).runs())[0]
    (place / f"runs/run_id={run_id}/{PART}").unlink()
    (place / f"metrics/run_id={run_id}/{PART}").write_bytes(b"PAR1 half a file")
    half = Dataset(str(place))
    assert len(half.runs()) == 2 and run_id not in half.table("events")["run_id"].to_pylist()
    report = run_corpus(jobs, str(place), Inline())
    assert len(report.done) == 1 and len(report.kept) == 2
    assert content(str(place)) == expected
    assert sorted(p.name for p in place.rglob("*.parquet")) == [PART] * (3 * (len(TABLES) + 1))


def test_two_missions_of_equal_content_are_one_run(recordings: Path, quick_file: str, tmp_path: Path) -> None:
    folder = tmp_path / "twins"
    folder.mkdir()
    for name in ("one", "two"):
        shutil.copy(recordings / "hall.mcap", folder / f"{name}.mcap")
    jobs, place = read_plan(str(folder), [quick_file]), str(tmp_path / "set")
    both = threading.Barrier(2)

    class AtOnce(ThreadPoolExecutor):
        """Both begin before either has looked whether the run is there."""

        def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
            def meet() -> Any:
                both.wait() if not args[0].anew else None
                return fn(*args, **kwargs)

            return super().submit(meet)

    with AtOnce(2) as executor:
        report = run_corpus(jobs, place, executor)
    assert len(report.done) + len(report.kept) == 2 and not report.failed
    assert len(Dataset(place).runs()) == 1
    assert len({row["run_id"] for row in Dataset(place).table("events").to_pylist()}) == 1
    assert len(Dataset(place).table("runs")) == 1


def test_every_configuration_makes_a_run_of_its_own(recordings: Path, tmp_path: Path) -> None:
    quick = {"map": {"type": "occupancy_grid", "resolution_m": 0.25}}
    document = {
        "missions": [{"name": "hall", "files": [str(recordings / "hall.mcap")], "config": quick}],
        "configs": {"ledger": {}, "two": {"reversal": "multi_map"}, "odd": {"robots": {"nobody": {"source": "x"}}}},
    }
    path, place = tmp_path / "corpus.yaml", str(tmp_path / "set")
    path.write_text(json.dumps(document))
    report = run_corpus(read_plan(str(path)), place, Inline())
    assert [job.config for job in report.done] == ["ledger", "two"]
    (failed,) = report.failed
    assert failed.outcome.error == "ConfigError" and "there is no robot 'x'" in failed.outcome.reason
    runs = Dataset(place).table("runs").to_pylist()
    assert len({row["run_id"] for row in runs}) == 2
    assert {row["config"]: "multi_map" in row["config_text"] for row in runs} == {"ledger": False, "two": True}


def test_what_people_say_of_merges_is_read_with_the_runs(done: str, tmp_path: Path) -> None:
    place = tmp_path / "set"
    shutil.copytree(done, place)
    events = Dataset(done).table("events").to_pylist()
    merge = next(event for event in events if event["kind"] == "merged")
    said = {"merge_id": merge["merge_id"], "receiver": merge["receiver"], "donor": merge["donor"]}
    label(place, merge["run_id"], verdict="right", **said)
    (row,) = Dataset(str(place)).table("labels").to_pylist()
    assert (row["run_id"], row["merge_id"], row["label"]) == (merge["run_id"], merge["merge_id"], "right")
