"""Runs that are killed while they write: every step of writing a folder may be the last one."""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from plots import provenance, tell, told

from mapgraft.errors import OutputError
from mapgraft.outputs.claims import claim, clear
from mapgraft.outputs.labels import label
from mapgraft.outputs.lock import LOCK, locked, settled
from mapgraft.outputs.read_back import read_events
from mapgraft.outputs.run_folder import ROUTINE, RunFolder
from mapgraft.outputs.staging import JOURNAL, SUFFIX, Staging

TOYS = Path(__file__).parents[1] / "toys"
MCAP = "demo.merge.mcap"
BRIEF = 1320  # things of the story that the shorter one tells

# Forks for every job: a process that has imported all and written nothing yet. A line of jobs holds for each a folder,
# and each a number or null for the fatal step and the length; the answer is how the processes ended.
JOBS = """
    import json, os, sys, traceback
    from contextlib import suppress
    from itertools import islice
    from pathlib import Path
    from plots import provenance, told, tell, Event
    from tearing import counted
    from mapgraft.outputs.messages import MessageEncoder
    from mapgraft.outputs.run_folder import RunFolder

    with suppress(ImportError):
        import pandas  # pyarrow does where it is there: once is enough
    MessageEncoder()  # reads what messages look like

    def work(folder, fatal, length):
        reported = os.open(folder + ".told", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        with counted(Path(folder), fatal) as steps, RunFolder(Path(folder), "demo", "r1", provenance()) as sink:
            sink.keep("mission.json", str(length).encode())
            for item in islice(told(), length):
                tell(sink, [item])
                if isinstance(item, Event):
                    os.write(reported, f"{item.seq} {item.kind} {len(steps.kinds)}\\n".encode())
        Path(folder + ".steps").write_text(json.dumps([steps.kinds, steps.names]))

    for line in sys.stdin:
        ends = []
        for job in json.loads(line):
            if not (child := os.fork()):
                try:
                    work(*job)
                    os._exit(0)
                except BaseException:
                    traceback.print_exc()
                    os._exit(1)
            ends.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        print(json.dumps(ends), flush=True)
"""

Job = tuple[Path, int | None, int | None]
Do = Callable[[list[Job]], None]


@pytest.fixture(scope="module")
def do() -> Iterator[Do]:
    """Tell the story to folders, and die on the way where a step is named."""
    path = os.pathsep.join([str(TOYS), *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-c", textwrap.dedent(JOBS)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=os.environ | {"PYTHONPATH": path}, **pipes) as worker:

        def work(jobs: list[Job]) -> None:
            worker.stdin.write(json.dumps([(str(folder), fatal, length) for folder, fatal, length in jobs]) + "\n")
            worker.stdin.flush()
            assert select.select([worker.stdout], [], [], 300)[0], "it hangs"
            ends = json.loads(worker.stdout.readline())
            assert ends == [0 if fatal is None else -signal.SIGKILL for _, fatal, _ in jobs]

        try:
            yield work
        finally:
            worker.kill()


def contents(folder: Path) -> dict[str, bytes]:
    """Everything but the lock, unfinished files, and what knows the wall clock."""
    return {
        name: path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
        and not (name := path.relative_to(folder).as_posix()).endswith(SUFFIX)
        and name != LOCK
        and not name.startswith("timings/")
    }


def decided(folder: Path) -> set[int]:
    """The decisions that any run in the folder has reported."""
    return {seq for seq, _ in reported(folder)}


def reported(folder: Path) -> list[tuple[int, int]]:
    """Number, and the step that comes next, of every decision that was reported."""
    lines = folder.with_name(folder.name + ".told").read_text().splitlines()
    return [(int(seq), int(step)) for seq, kind, step in map(str.split, lines) if kind not in ROUTINE]


def readable(folder: Path) -> set[int]:
    """The events that can be read from finished and unfinished recordings."""
    paths = [path for path in folder.glob("*.merge.mcap*") if path.stat().st_size]
    return {event.seq for path in paths for event in read_events(path)}


@pytest.fixture(scope="module")
def stories(do: Do, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``short`` and ``long``: folders of undisturbed runs, and the steps of a long one after a short one, ``both``."""
    folder = tmp_path_factory.mktemp("stories")
    do([(folder / "short", None, BRIEF), (folder / "long", None, None)])
    shutil.copytree(folder / "short", folder / "both")
    do([(folder / "both", None, None)])
    return folder


@pytest.fixture(scope="module")
def killed(do: Do, stories: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders with a finished short run, in which a long one was killed, each in another step."""
    kinds, names = json.loads((stories / "both.steps").read_text())
    journal = next(n for n, name in enumerate(names) if JOURNAL in name)
    between = [step + 1 for _, step in reported(stories / "both")][::2]
    fatal = sorted({0, *between, journal // 2, *range(journal - 2, len(kinds), 3), len(kinds) - 1})
    folder = tmp_path_factory.mktemp("killed")
    for step in fatal:
        shutil.copytree(stories / "short", folder / f"{step:05d}")
    do([(folder / f"{step:05d}", step, None) for step in fatal])
    return [folder / f"{step:05d}" for step in fatal]


def test_no_reported_decision_is_lost_whatever_step_was_the_last(killed: list[Path]) -> None:
    assert len({len(decided(folder)) for folder in killed}) > 3
    for folder in killed:
        assert decided(folder) <= readable(folder), folder.name


def test_the_folder_holds_the_earlier_run_or_the_new_one_whole(
    killed: list[Path], stories: Path, tmp_path: Path
) -> None:
    earlier, new = contents(stories / "short"), contents(stories / "both")
    seen = []
    for folder in killed:
        copy = shutil.copytree(folder, tmp_path / folder.name)
        begun = (copy / JOURNAL).exists()
        settled(copy)
        assert not (copy / JOURNAL).exists()
        seen.append(contents(copy) == new)
        assert seen[-1] or (contents(copy) == earlier and not begun), folder.name
    assert seen == sorted(seen) and 8 < sum(seen) < len(seen) - 6


def test_started_again_it_ends_as_if_nothing_had_happened(
    do: Do, killed: list[Path], stories: Path, tmp_path: Path
) -> None:
    copies = [Path(shutil.copytree(folder, tmp_path / folder.name)) for folder in killed[::3]]
    do([(copy, None, None) for copy in copies])
    expected = contents(stories / "both")
    assert expected == contents(stories / "long")
    for copy in copies:
        assert contents(copy) == expected, copy.name
        assert not list(copy.rglob(f"*{SUFFIX}")), copy.name


def test_killed_again_and_again_it_keeps_what_got_farthest(do: Do, stories: Path, tmp_path: Path) -> None:
    steps = len(json.loads((stories / "long.steps").read_text())[0])
    out = tmp_path / "out"
    for share in (0.1, 0.5, 0.0):
        do([(out, int(steps * share), None)])
        assert decided(out) <= readable(out)
    assert any(".r1." in path.name for path in out.glob(f"*{SUFFIX}"))
    do([(out, None, None)])
    assert contents(out) == contents(stories / "long")
    assert not list(out.rglob(f"*{SUFFIX}"))


def test_what_an_unfinished_run_of_other_content_decided_stays_and_is_told(tmp_path: Path) -> None:
    sink = RunFolder(tmp_path, "demo", "r1", provenance()).open()
    tell(sink, list(told())[:900])
    sink.abort()
    assert (tmp_path / "events/run_id=r1/.part-00000.parquet.partial").exists()
    seen = [event.seq for event in read_events(tmp_path / f"{MCAP}{SUFFIX}")]
    with RunFolder(tmp_path, "demo", "r2", provenance()) as sink:
        assert (
            len(sink.unfinished) == 1 and "demo.r1.merge.mcap.partial tells what another run had" in sink.unfinished[0]
        )
        tell(sink, told())
    assert [path.name for path in tmp_path.rglob(f"*{SUFFIX}")] == [f"demo.r1.merge.mcap{SUFFIX}"]
    assert [event.seq for event in read_events(tmp_path / f"demo.r1.merge.mcap{SUFFIX}")] == seen
    with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:
        assert sink.unfinished == []
        tell(sink, told())
    assert not list(tmp_path.rglob(f"*{SUFFIX}"))


@pytest.mark.parametrize("rest", [b"", b"\x89MCAP0\r\n", bytes(5000)])
def test_a_rest_that_tells_nothing_goes(tmp_path: Path, rest: bytes) -> None:
    (tmp_path / f"{MCAP}{SUFFIX}").write_bytes(rest)
    RunFolder(tmp_path, "demo", "r1", provenance()).open().finish()
    assert not list(tmp_path.rglob(f"*{SUFFIX}"))


def test_a_journal_of_somebody_else_is_refused(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("mine")
    out = tmp_path / "out"
    out.mkdir()
    for plan in (
        {"renamed": {}, "gone": ["../victim"]},
        {"renamed": {"../victim": "x"}, "gone": []},
        {"renamed": {}, "gone": [str(victim)]},
        {"renamed": [], "gone": [7]},
        [],
    ):
        (out / JOURNAL).write_text(json.dumps(plan))
        with pytest.raises(OutputError, match="is not what a run writes there: remove it"):
            settled(out)
        with pytest.raises(OutputError, match="is not what a run writes there: remove it"):
            RunFolder(out, "demo", "r1", provenance()).open()
    assert victim.read_text() == "mine"


def test_somebody_in_a_hurry_gets_the_whole_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "of the earlier run").touch()
    staging, renamed = Staging(tmp_path), []
    for name in ("a", "b", "c"):
        staging.write(name, name.encode())
    real = os.replace

    def interrupted(source: Path, target: Path) -> None:
        real(source, target)
        renamed.append(target)
        if len(renamed) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    with locked(tmp_path), pytest.raises(KeyboardInterrupt):
        staging.publish(gone=["of the earlier run"])
    assert contents(tmp_path) == {name: name.encode() for name in ("a", "b", "c")}


# labels of many writers

LABELS = """
    import sys
    from datetime import UTC, datetime, timedelta
    from pathlib import Path
    from mapgraft.outputs.labels import label

    for n in range(int(sys.argv[2])):
        clock = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=n)
        label(Path(sys.argv[1]), "r1", merge_id=f"a.b.{n}", receiver="a", donor="b", verdict="right",
              by=sys.argv[3], clock=clock)
"""


def test_no_label_is_lost_when_many_write_at_once_beside_a_run(tmp_path: Path) -> None:
    import pyarrow.dataset as ds

    with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:
        writers = [
            subprocess.Popen([sys.executable, "-c", textwrap.dedent(LABELS), str(tmp_path), "25", f"person {n}"])
            for n in range(3)
        ]
        tell(sink, told())
        assert [writer.wait(timeout=60) for writer in writers] == [0, 0, 0]
    with RunFolder(tmp_path, "demo", "r1", provenance()) as sink:
        tell(sink, told())
    rows = ds.dataset(tmp_path / "labels", partitioning="hive").to_table(["merge_id", "annotator"]).to_pylist()
    assert len({(row["merge_id"], row["annotator"]) for row in rows}) == len(rows) == 75


UNWRITTEN = """
    import resource, sys
    from pathlib import Path
    from mapgraft.errors import OutputError
    from mapgraft.outputs.labels import label

    resource.setrlimit(resource.RLIMIT_FSIZE, (100, -1))
    try:
        label(Path(sys.argv[1]), "r1", merge_id="a.b.1", receiver="a", donor="b", verdict="right")
    except OutputError as error:
        print(error)
"""


def test_a_label_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    label(tmp_path, "r1", merge_id="a.b.1", receiver="a", donor="b", verdict="right")
    before = contents(tmp_path)
    command = [sys.executable, "-c", textwrap.dedent(UNWRITTEN), str(tmp_path)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    assert "because the disk or the quota is full: make room and run again" in done.stdout
    assert contents(tmp_path) == before and not list(tmp_path.rglob(f"*{SUFFIX}"))


DIES = """
    import os, sys
    from pathlib import Path
    from mapgraft.outputs import parquet_log
    from mapgraft.outputs.labels import label

    parquet_log.sync = lambda stream: os.kill(os.getpid(), 9)
    label(Path(sys.argv[1]), "r1", merge_id="a.b.7", receiver="a", donor="b", verdict="right")
"""


def rests(folder: Path) -> list[Path]:
    return sorted((folder / "labels").rglob(f".*{SUFFIX}"))


@pytest.mark.parametrize("next_one", ["label", "run"])
def test_what_a_killed_writer_of_labels_has_left_goes_and_what_another_one_writes_stays(
    tmp_path: Path, next_one: str
) -> None:
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(DIES), str(tmp_path)], check=False, timeout=60)
    assert done.returncode == -9 and len(rests(tmp_path)) == 1
    alive = tmp_path / "labels/run_id=r1" / f".part-00000-alive.parquet{SUFFIX}"
    with alive.open("wb") as stream:
        assert claim(alive, stream.fileno())
        if next_one == "label":
            label(tmp_path, "r1", merge_id="a.b.1", receiver="a", donor="b", verdict="right")
        else:
            RunFolder(tmp_path, "demo", "r1", provenance()).open().finish()
        assert rests(tmp_path) == [alive]
    label(tmp_path, "r1", merge_id="a.b.2", receiver="a", donor="b", verdict="right")
    assert rests(tmp_path) == []


def test_a_file_that_is_gone_cannot_be_claimed(tmp_path: Path) -> None:
    path = tmp_path / "rest"
    with path.open("wb") as stream:
        clear([path])  # nobody had claimed it yet
        assert not path.exists() and not claim(path, stream.fileno())
        path.touch()  # another one of that name
        assert not claim(path, stream.fileno())
