"""The page on corpora: its examples run, and it names every option."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import duckdb
import pytest

from mapgraft.commands.app import corpus
from mapgraft.corpus import read_plan
from mapgraft.corpus.dataset import PART, TABLES
from mapgraft.corpus.document import CorpusDocument, MissionEntry
from mapgraft.corpus.stores import UNFINISHED
from mapgraft.recording.containers.octets import BLOCK_BYTES

PAGE = (Path(__file__).parents[2] / "docs" / "corpora.md").read_text(encoding="utf-8")
DEFAULTED = {
    "quiet",
    "as_json",
    "no_plugin",
    "debug",
    "json",
    "source",
    "dataset",
}  # as in all commands, or in each example


def examples(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, flags=re.DOTALL)


def test_the_document_is_one(tmp_path: Path, s3: Any) -> None:
    (text,) = examples("yaml")
    for name in ("office/alice.mcap", "office/bob.bag", "yard/2026-03-01.mcap", "yard/2026-03-02.mcap"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "corridors").mkdir()
    for name in ("corridors/a.mcap", "corridors/b.mcap", "ledger.yaml", "halls.yaml"):
        (tmp_path / name).touch()
    s3.makedirs("recordings", exist_ok=True)
    s3.pipe_file("recordings/halls/north.mcap", b"x")
    (tmp_path / "corpus.yaml").write_text(text)
    jobs = read_plan(str(tmp_path / "corpus.yaml"))
    missions = list(dict.fromkeys((job.mission, len(job.files)) for job in jobs))
    assert missions == [("office", 2), ("2026-03-01", 2), ("a", 1), ("b", 1), ("north", 1)]
    assert len(jobs) == 10 and jobs[0].content["mission"] == {"common_event": "/diagnostics"}
    assert all(job.time_limit_s == 3600 for job in jobs)


def test_the_examples_run(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recordings").mkdir()
    shutil.copy(recordings / "attic.mcap", tmp_path / "recordings")
    run, read = examples("python")
    exec(run, {})
    assert capsys.readouterr().out == "1 0 []\n"
    exec(read, {})
    assert re.fullmatch(r"[1-9]\d* \[\]\n", capsys.readouterr().out)
    by_config, reasons = (duckdb.sql(query).fetchall() for query in examples("sql"))
    assert [(row[0], row[3]) for row in by_config] == [("default", 1)]
    assert all(kind in ("rejected", "unmatched", "ambiguous") and times > 0 for kind, _, times in reasons)
    assert {path.name for path in (tmp_path / "dataset").iterdir()} == {*TABLES, "runs", "corpus.json", UNFINISHED}


def test_every_option_and_number_of_the_code_is_on_the_page() -> None:
    for name in set(corpus.__annotations__) - DEFAULTED - {"return"}:
        spelt = {"config": "-c"}.get(name, f"--{name.replace('_', '-')}")
        assert f"`{spelt}`" in PAGE, spelt
    for name in (*CorpusDocument.model_fields, *MissionEntry.model_fields):
        assert re.search(rf"\b{name}:", PAGE), name
    assert f"blocks of {BLOCK_BYTES >> 10} KiB" in PAGE
    assert f"`dataset/{UNFINISHED}`" in PAGE and f"run_id=<run>/{PART}`" in PAGE
