"""The examples of a corpus: those that single runs would write, for whoever reads a run's."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import mapgraft
from mapgraft.annotate.desk import Answer, Desk
from mapgraft.annotate.opened import open_folders
from mapgraft.calibrate import read_labels
from mapgraft.cli import invoke
from mapgraft.corpus import Dataset, read_plan, run_corpus
from mapgraft.corpus.dataset import PART
from mapgraft.examples import ExampleFolder


def corpus(recordings: Path, place: Path, config: Any, tmp_path: Path) -> None:
    file = tmp_path / "config.yaml"
    file.write_text(json.dumps(config))
    with ThreadPoolExecutor(1) as executor:
        report = run_corpus(read_plan(str(recordings), [str(file)]), str(place), executor)
    assert not report.failed


@pytest.fixture(scope="module")
def config(quick: Any) -> dict[str, Any]:
    """Three missions in one building."""
    return {**quick, "examples": {"environments": {"attic": "house", "cellar": "house", "hall": "house"}}}


@pytest.fixture(scope="module")
def place(recordings: Path, config: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("examples")
    corpus(recordings, folder / "set", config, folder)
    return folder / "set"


def test_they_are_those_of_single_runs(place: Path, recordings: Path, config: Any, tmp_path: Path) -> None:
    result = mapgraft.run([recordings / "attic.mcap"], config, tmp_path / "out")
    single, many = ExampleFolder(tmp_path / "out"), ExampleFolder(place)
    assert {key.run_id for key in many.keys} == Dataset(str(place)).runs() and len(single) > 0
    assert {key for key in many.keys if key.run_id == result.run_id} == {*single.keys}
    (part,) = single.files
    assert (place / "examples" / f"run_id={result.run_id}" / PART).read_bytes() == part.read_bytes()
    assert sorted(path.name for path in place.glob("examples/*/*")) == [PART] * 3
    assert Dataset(str(place)).table("examples", ["example_id"]).num_rows == len(many)


def test_people_label_them_and_they_are_published(place: Path, tmp_path: Path) -> None:
    """As the page says: the folder of a corpus goes wherever that of a run goes."""
    desk = Desk(open_folders([place]))
    n = desk.next("ann")
    assert n is not None
    desk.say(n, "ann", Answer("right"))
    folder = ExampleFolder(place)
    assert [word.label for word in folder.labels().values()] == ["right"]
    assert [example.right for example in read_labels([place]).labelled] == [True]
    assert invoke(["labels", "export", str(place), "-o", str(tmp_path / "labels.csv")]) == 0
    assert len((tmp_path / "labels.csv").read_text().splitlines()) == 2
    assert invoke(["dataset", str(place), "-o", str(tmp_path / "data"), "--split", "house=train"]) == 0
    rows = ExampleFolder(tmp_path / "data").rows(["environment", "split", "label"]).to_pylist()
    assert len(rows) == len(folder) and {(row["environment"], row["split"]) for row in rows} == {("house", "train")}
    assert [row["label"] for row in rows if row["label"]] == ["right"]
    assert Dataset(str(place)).table("labels")["label"].to_pylist() == ["right"]


def test_a_configuration_may_leave_them_out(recordings: Path, quick: Any, tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "hall.mcap").symlink_to(recordings / "hall.mcap")
    corpus(tmp_path / "one", tmp_path / "set", {**quick, "output": {"examples": False}}, tmp_path)
    assert len(Dataset(str(tmp_path / "set")).runs()) == 1 and not (tmp_path / "set" / "examples").exists()
