"""The output folder: nothing reported is lost, nothing half-written is seen, others' things stay."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from plots import ALPHA, AT, START_NS, UNDERSCORE, S, provenance, tell, told, traffic

from mapgraft.contracts import Finding, Measurement, Observation, Transform
from mapgraft.errors import OutputError
from mapgraft.events import Event
from mapgraft.outputs.lock import EXPERIMENT, LOCK, require_kind
from mapgraft.outputs.null_sink import NullSink
from mapgraft.outputs.read_back import read_events
from mapgraft.outputs.run_folder import ROUTINE, RunFolder

TOYS = Path(__file__).parents[1] / "toys"
MCAP = "demo.merge.mcap"


def names(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()} - {LOCK}


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in names(folder)}


def child(script: str, *arguments: object, timeout_s: float = 60) -> subprocess.CompletedProcess[str]:
    """Run a script in another process, with the toys at hand."""
    path = os.pathsep.join([str(TOYS), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": path}
    command = [sys.executable, "-c", textwrap.dedent(script), *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=timeout_s, check=False)


# what is there when all goes well


def test_nothing_has_its_final_name_before_the_end_and_everything_has_it_then(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with RunFolder(out, "demo", "r1", provenance()) as sink:
        tell(sink, told())
        assert all(name.endswith(".partial") for name in names(out))
    finished = names(out)
    assert not any(name.endswith(".partial") for name in finished)
    assert {MCAP, "summary.json", "transforms.csv", "layout.json", f"trajectories/{AT}.tum"} <= finished


def test_the_same_run_gives_the_same_folder_and_replaces_itself(tmp_path: Path, out: Path) -> None:
    again = tmp_path / "again"
    for started_at in (datetime(2026, 1, 2, tzinfo=UTC), datetime(2027, 3, 4, tzinfo=UTC)):
        with RunFolder(again, "demo", "r0123456789abcde", provenance(started_at)) as sink:
            tell(sink, told())
            sink.timed("replay", float(started_at.year), 1)
            sink.carried(traffic())
    first, second = contents(out), contents(again)
    clock = {name for name in first.keys() | second.keys() if name.startswith("timings/")} | {MCAP}
    assert len(clock) == 3
    assert {n: c for n, c in first.items() if n not in clock} == {n: c for n, c in second.items() if n not in clock}


def test_tables_of_other_runs_and_labels_stay_and_yesterdays_maps_and_recording_go(tmp_path: Path) -> None:
    with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:
        tell(sink, told())
    for mine in ("notes.txt", "mine.merge.mcap"):
        (tmp_path / mine).write_text("mine")
    before = contents(tmp_path)
    alone = [item for item in told() if isinstance(item, Observation) and item.robot == AT]
    with RunFolder(tmp_path, "other", "r2", provenance()) as sink:
        tell(sink, alone)
    after = contents(tmp_path)
    kept = {name for name in before if "run_id=r1" in name} | {"notes.txt", "mine.merge.mcap"}
    assert {name: after[name] for name in kept} == {name: before[name] for name in kept}
    assert MCAP not in after and "other.merge.mcap" in after
    assert not {f"maps/{ALPHA}.json", f"maps/{ALPHA}.merged.json", f"trajectories/{ALPHA}.tum"} & after.keys()
    assert f"trajectories/{AT}.tum" in after


def test_what_metrics_found_yesterday_goes(tmp_path: Path) -> None:
    hole = Finding("wall missing", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0, "m")
    measured = Measurement("deviations", 0.1, "", 9, "lower", findings=(hole,))
    story = [
        replace(item, measurements=(measured,)) if isinstance(item, Event) and item.state == "confirmed" else item
        for item in told()
    ]
    for found in (story, told()):
        with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:
            tell(sink, found)
        assert ("findings.csv" in names(tmp_path)) is (found is story)


def test_a_second_writing_of_a_run_leaves_one_part_and_keeps_its_labels(tmp_path: Path) -> None:
    with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:
        tell(sink, told())
    (label,) = (tmp_path / "labels/run_id=r1").glob("*.parquet")
    label.rename(label.with_name("part-00000-0badcafe.parquet"))
    with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:
        tell(sink, list(told())[:900])
    assert [path.name for path in (tmp_path / "labels/run_id=r1").glob("*.parquet")] == ["part-00000-0badcafe.parquet"]
    for table in ("events", "metrics", "maps", "recordings", "timings"):
        assert len(list((tmp_path / table / "run_id=r1").glob("*.parquet"))) == 1


def test_a_run_without_anything_is_a_folder_too(tmp_path: Path) -> None:
    RunFolder(tmp_path, "demo", "r1", provenance()).open().finish()
    assert read_events(tmp_path / MCAP) == []
    assert pq.read_table(next((tmp_path / "events/run_id=r1").glob("*.parquet")), partitioning=None).num_rows == 0


def test_a_null_sink_takes_everything() -> None:
    tell(NullSink(), told())


# what is there when it does not


def test_an_abort_leaves_whole_partial_files_with_every_event(tmp_path: Path, events: list[Event]) -> None:
    sink = RunFolder(tmp_path, "demo", "r1", provenance()).open()
    tell(sink, told())
    sink.abort()
    sink.abort()
    assert all(name.endswith(".partial") for name in names(tmp_path))
    assert [e.seq for e in read_events(tmp_path / f"{MCAP}.partial")] == [e.seq for e in events]
    rows = pq.read_table(tmp_path / "events/run_id=r1/.part-00000.parquet.partial", partitioning=None)
    assert rows.column("seq").to_pylist() == [e.seq for e in events]


def test_an_error_in_the_replay_aborts(tmp_path: Path) -> None:
    story = list(told())[:900]
    with pytest.raises(ZeroDivisionError), RunFolder(tmp_path, "demo", "r1", provenance()) as sink:
        tell(sink, story)
        raise ZeroDivisionError
    seen = [e.seq for e in read_events(tmp_path / f"{MCAP}.partial")]
    assert seen == [item.seq for item in story if isinstance(item, Event)]
    with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:  # the lock was given back
        tell(sink, told())
    assert not any(name.endswith(".partial") for name in names(tmp_path))


KILLED = """
    import os, sys
    from pathlib import Path
    from plots import provenance, told, Event, Observation
    from mapgraft.outputs.run_folder import RunFolder

    sink = RunFolder(Path(sys.argv[1]), "demo", "r1", provenance()).open()
    for item in told():
        if isinstance(item, Observation):
            sink.observed(item)
        elif isinstance(item, Event):
            sink.happened(item)
            print(item.seq, item.kind, flush=True)
            if item.seq == int(sys.argv[2]):
                os.kill(os.getpid(), 9)
        else:
            sink.mapped(item)
"""


@pytest.mark.parametrize("last", [0, 2, 60, 104])
def test_a_killed_run_loses_no_decision_it_reported(tmp_path: Path, events: list[Event], last: int) -> None:
    done = child(KILLED, tmp_path, last)
    assert done.returncode == -signal.SIGKILL
    reported = [line.split() for line in done.stdout.splitlines()]
    decided = [int(seq) for seq, kind in reported if kind not in ROUTINE]
    found = read_events(tmp_path / f"{MCAP}.partial")
    assert [e.seq for e in found] == list(range(len(found)))
    assert len(found) >= 1 + max(decided, default=-1)
    assert [(e.kind, e.T_receiver_donor) for e in found] == [(e.kind, e.T_receiver_donor) for e in events[: len(found)]]
    with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:  # and the folder can be written again
        tell(sink, told())
    assert len(read_events(tmp_path / MCAP)) == len(events)


FULL = """
    import resource, sys
    from pathlib import Path
    from plots import provenance, told, Event, tell
    from mapgraft.errors import OutputError
    from mapgraft.outputs.run_folder import RunFolder

    sink = RunFolder(Path(sys.argv[1]), "demo", "r1", provenance()).open()
    decided = -1
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), -1))
    try:
        for item in told():
            tell(sink, [item])
            if isinstance(item, Event) and item.kind not in ("offered", "verified"):
                decided = item.seq
        sink.finish()
    except OutputError as error:
        print(decided, error)
        sink.abort()
        sys.exit(error.exit_code)
"""


@pytest.mark.parametrize("limit", [9_000, 12_000, 30_000, 60_000, 66_000])
def test_a_full_disk_is_one_sentence_and_what_was_decided_stays(tmp_path: Path, limit: int) -> None:
    done = child(FULL, tmp_path, limit)
    assert (done.returncode, done.stderr) == (1, "")
    decided, _, sentence = done.stdout.strip().partition(" ")
    assert "cannot be written because the disk or the quota is full: make room" in sentence and "\n" not in sentence
    assert all(name.endswith(".partial") for name in names(tmp_path))
    found = read_events(tmp_path / f"{MCAP}.partial")
    assert len(found) >= int(decided) + 1
    assert [e.seq for e in found] == list(range(len(found)))


READ_ONLY = """
    import os, sys
    from pathlib import Path
    from plots import provenance
    from mapgraft.errors import OutputError
    from mapgraft.outputs.run_folder import RunFolder

    if os.geteuid() == 0:
        os.setuid(65534)  # root may write anywhere
    for out in (Path(sys.argv[1]), Path(sys.argv[1]) / "new"):
        try:
            RunFolder(out, "demo", "r1", provenance()).open()
        except OutputError as error:
            print(error)
"""


def test_a_read_only_folder_is_one_sentence(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("locked")
    folder.chmod(0o555)
    done = child(READ_ONLY, folder)
    folder.chmod(0o755)
    assert done.stderr == ""
    first, second = done.stdout.splitlines()
    assert str(folder) in first and "read-only for this user: choose another output folder" in first
    assert str(folder / "new") in second and "read-only for this user" in second
    assert names(folder) == set()


def test_a_file_in_the_way_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    for folder in (tmp_path / "out", tmp_path / "out" / "below"):
        with pytest.raises(OutputError, match="a file or folder of that name is in the way"):
            RunFolder(folder, "demo", "r1", provenance()).open()
    assert (tmp_path / "out").read_text() == "a file"


def test_two_runs_do_not_write_one_folder_at_once(tmp_path: Path) -> None:
    with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:
        with pytest.raises(OutputError, match="is being written by another run"):
            RunFolder(tmp_path, "other", "r2", provenance()).open()
        tell(sink, told())
    with RunFolder(tmp_path, "other", "r2", provenance()):
        pass


def test_run_ids_that_readers_take_for_numbers_are_refused(tmp_path: Path) -> None:
    for run_id in ("", "12", "1e5", "r/1", "r 1", "é1"):
        with pytest.raises(OutputError, match="a run id is a letter and then"):
            RunFolder(tmp_path / "out", "demo", run_id, provenance()).open()


def test_a_closed_folder_takes_no_more(tmp_path: Path, events: list[Event]) -> None:
    sink = RunFolder(tmp_path, "demo", "r1", provenance()).open()
    sink.finish()
    with pytest.raises(OutputError, match="is closed or has failed before"):
        sink.happened(next(e for e in events if e.kind == "merged"))


# what it costs


def test_waiting_things_are_bounded_and_payloads_are_let_go(tmp_path: Path) -> None:
    import gc
    import weakref

    class Payload:
        pass

    T = Transform.identity()
    payloads: list[weakref.ref[Payload]] = []
    with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:
        for n in range(3000):
            payload = Payload()
            payloads.append(weakref.ref(payload))
            sink.observed(Observation(UNDERSCORE, START_NS + n * S // 10, 0, "probe", "cells", payload, T, T))
            del payload
        gc.collect()
        assert not any(ref() is not None for ref in payloads)
        assert (tmp_path / f"trajectories/{UNDERSCORE}.tum.partial").stat().st_size > 2000 * 80


def test_a_folder_that_holds_an_experiment_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / EXPERIMENT).write_text("{}")
    with pytest.raises(OutputError, match="holds an experiment: choose another folder"):
        RunFolder(tmp_path, "demo", "r1", provenance()).open()
    assert [path.name for path in tmp_path.iterdir()] == [EXPERIMENT]
    require_kind(tmp_path, EXPERIMENT)
