"""A damaged part of the labels is named by every command that makes something of what persons say."""

from __future__ import annotations

from pathlib import Path

import pytest
from toy_examples import RUN, write_toys

from mapgraft.cli import invoke
from mapgraft.examples import ExampleFolder, transform_of
from mapgraft.outputs.label_parts import unread_parts
from mapgraft.outputs.labels import label


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Sixty examples and two words, one of which is cut off."""
    write_toys(tmp_path / "out", 60)
    folder = ExampleFolder(tmp_path / "out")
    for key in folder.keys[:2]:
        T = transform_of(folder.row(key)["T_receiver_donor"])
        about = {"merge_id": key.example_id, "receiver": "alpha", "donor": "beta"}
        label(folder.path, RUN, **about, verdict="wrong", by="ann", T_receiver_donor=T)
    assert not unread_parts(folder.path)
    cut = sorted((folder.path / "labels").glob("*/part-*"))[0]
    cut.write_bytes(cut.read_bytes()[:300])
    return folder.path


def told(capsys: pytest.CaptureFixture[str], out: Path) -> bool:
    said = capsys.readouterr().err
    ((path, reason),) = unread_parts(out).items()
    assert said.count(f"{path} cannot be read, and what was said there is missing here ({reason})") <= 1
    return f"{path} cannot be read" in said


def test_every_command_names_it_once(out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["labels", "export", str(out), str(out), "-o", str(tmp_path / "labels.csv")]) == 0
    assert told(capsys, out)
    assert invoke(["labels", "import", str(out), str(tmp_path / "labels.csv")]) == 0
    assert told(capsys, out)
    assert invoke(["dataset", str(out), "-o", str(tmp_path / "data"), "--json"]) == 0
    assert told(capsys, out)
    assert invoke(["calibrate", str(out), "-o", str(tmp_path / "rules"), "--false-accept", "0.2"]) == 0
    assert told(capsys, out)


def test_words_that_can_be_read_are_told_as_ever(out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also of those that were said on a dataset itself."""
    assert invoke(["labels", "export", str(out), "-o", str(tmp_path / "labels.csv")]) == 0
    assert "1 words written" in capsys.readouterr().out
    next(iter(unread_parts(out))).unlink()
    assert invoke(["dataset", str(out), "-o", str(tmp_path / "data")]) == 0
    assert "cannot be read" not in capsys.readouterr().err
    damaged = tmp_path / "data" / "labels" / f"run_id={RUN}" / "part-00000-cut.parquet"
    damaged.parent.mkdir(parents=True)
    damaged.write_bytes(b"PAR1")
    assert invoke(["dataset", str(out), "-o", str(tmp_path / "data")]) == 0
    assert told(capsys, tmp_path / "data")
