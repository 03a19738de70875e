"""The command: what it says, how it ends, and that it goes on where it was ended."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mapgraft.cli import invoke
from mapgraft.corpus import Dataset, executor_of, read_plan, run_corpus


@pytest.fixture
def crowded(recordings: Path, tmp_path: Path) -> Path:
    """The recordings, and one that is none."""
    folder = tmp_path / "recordings"
    shutil.copytree(recordings, folder)
    (folder / "broken.mcap").write_bytes(b"no recording")
    return folder


def corpus(*words: str) -> list[str]:
    return ["corpus", *words, "--executor", "threads", "--workers", "1"]


def test_what_is_done_kept_and_failed_is_told(
    crowded: Path, quick_file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(crowded), "-o", str(tmp_path / "set"), "-c", quick_file]
    assert invoke(["corpus", *words, "--dry-run"]) == 0
    assert capsys.readouterr().out.count("to be done") == 4
    assert not (tmp_path / "set").exists()
    assert invoke(corpus(*words)) == 1
    said = capsys.readouterr().out
    assert "3 done, 0 there before, 1 failed." in said and "broken" in said and "not an MCAP file" in said
    (crowded / "broken.mcap").unlink()
    assert invoke(corpus(*words, "--json")) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["kept"]) == 3 and not told["done"] and not told["failed"]
    assert invoke(["corpus", *words, "--dry-run", "--json"]) == 0
    assert all(row["run_id"] for row in json.loads(capsys.readouterr().out))


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["nowhere", "-o", "x"], 2, "neither a folder of recordings nor a document"),
        (["nowhere.yaml", "-o", "x"], 2, "there is no file"),
        ([".", "-o", "x"], 1, "holds no recording"),
        ([".", "-o", "x", "--workers", "0"], 2, "workers"),
        (["{recordings}", "-o", "x", "--executor", "cloud"], 2, "there is no executor 'cloud'"),
        (["{recordings}", "-o", "nowhere://x"], 2, "nowhere://x cannot be opened"),
        (["{recordings}", "-o", "{run}"], 1, "holds a run: choose another folder"),
        (["{recordings}", "-o", "{later}"], 1, "of another version"),
        (["{recordings}", "-o", "x", "-c", "none.yaml"], 2, "there is no file"),
    ],
)
def test_what_is_wrong_is_one_sentence(
    words: list[str], code: int, said: str, recordings: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    for name, file in (("run", "summary.json"), ("later", "corpus.json")):
        (tmp_path / name).mkdir()
        (tmp_path / name / file).write_text('{"schema_version": "9.0.0"}')
    places = {"recordings": recordings, "run": tmp_path / "run", "later": tmp_path / "later"}
    assert invoke(["corpus", *(word.format(**places) for word in words)]) == code
    captured = capsys.readouterr()
    assert said in captured.err and not captured.out and "Traceback" not in captured.err


def test_where_a_time_limit_does_not_hold_it_is_told(
    recordings: Path, quick: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missions = [{"files": [str(recordings / "hall.mcap")], "config": dict(quick)}]
    document = tmp_path / "corpus.yaml"
    document.write_text(json.dumps({"missions": missions, "job_time_limit_s": 0.01}))
    assert invoke(corpus(str(document), "-o", str(tmp_path / "set"))) == 0
    captured = capsys.readouterr()
    assert "1 done" in captured.out
    told = " ".join(captured.err.split())
    assert told == "job_time_limit_s does not hold: --executor threads cannot end a job, processes can"
    words = ["corpus", str(document), "-o", str(tmp_path / "other"), "--workers", "1"]
    assert invoke(words) == 1
    captured = capsys.readouterr()
    assert "it was ended after 0.01 s" in " ".join(captured.out.split()) and not captured.err


def test_a_run_does_not_write_into_a_data_set(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Dataset(str(tmp_path / "set")).prepare()
    assert invoke(["run", str(recordings / "hall.mcap"), "-o", str(tmp_path / "set")]) == 1
    assert "holds a corpus: choose another folder" in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_ended_in_the_middle_it_goes_on_from_there(
    number: signal.Signals, recordings: Path, quick_file: str, tmp_path: Path,
    content: Callable[[str], dict[str, bytes]], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    place, scratch, expected = tmp_path / "set", tmp_path / "scratch", str(tmp_path / "expected")
    scratch.mkdir()
    command = [sys.executable, "-m", "mapgraft", "corpus", str(recordings), "-o", str(place), "-c", quick_file]
    with subprocess.Popen(
        [*command, "--workers", "1"], stderr=subprocess.PIPE, text=True, env=os.environ | {"TMPDIR": str(scratch)}
    ) as running:
        deadline = time.monotonic() + 240
        while not list(place.glob("runs/*/*.parquet")) and running.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        running.send_signal(number)
        _, err = running.communicate(timeout=60)
    assert running.returncode == (130 if number == signal.SIGINT else -number)
    if number == signal.SIGINT:
        assert err == (
            "mapgraft: interrupted; what was done before is in the data set, and the same command goes on from there\n"
        )
    for left in scratch.iterdir():
        os.utime(left, (0, 0))
    jobs = read_plan(str(recordings), [quick_file])
    monkeypatch.setattr("tempfile.tempdir", str(scratch))
    with executor_of("threads", 1) as executor:
        report = run_corpus(jobs, str(place), executor)
        run_corpus(jobs, expected, executor)
    assert report.kept and len(report.done) + len(report.kept) == 3
    assert content(str(place)) == content(expected)
    assert not list(scratch.glob("mapgraft-corpus-*"))  # what the dead had left is gone


def test_nothing_heavy_is_loaded_for_help() -> None:
    code = "import sys, mapgraft.cli; print({'numpy', 'pyarrow', 'fsspec', 'distributed'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
