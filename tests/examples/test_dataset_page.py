"""The page on datasets: its configuration is valid, its snippets run, its columns are there."""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path

import duckdb
import pytest
from ruamel.yaml import YAML

from mapgraft.config import parse_config
from mapgraft.examples import ExampleFolder
from mapgraft.examples.labels_csv import COLUMNS
from mapgraft.examples.publishing import publish

PAGE = (Path(__file__).parents[2] / "docs" / "dataset.md").read_text(encoding="utf-8")


def snippets(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, flags=re.DOTALL)


def test_the_configuration_is_valid():
    (text,) = snippets("yaml")
    config = parse_config(YAML(typ="safe", pure=True).load(text))
    assert config.examples.trusted_poses and len(config.examples.truth) == 2


def test_the_snippets_run(toys, tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    publish([toys], tmp_path / "DATASET", {"aces": "train"})
    monkeypatch.setattr("datasets.config.HF_DATASETS_CACHE", tmp_path / "cache")
    for code in snippets("python"):
        if "import torch" in code and find_spec("torch") is None:
            continue
        exec(compile(code, "docs/dataset.md", "exec"), {})
    for query in snippets("sql"):
        assert duckdb.sql(query).fetchall()


def test_what_it_names_is_there():
    for name in ("example_id", "label", "annotator", "comment", "labelled_at", "elapsed_s", "judged_x_m", "recording"):
        assert name in COLUMNS and f"`{name}`" in PAGE
    for name in re.findall(r"`(\w+)(?:\([^`]*\))?`", PAGE.split("In Python of mapgraft")[1].split("##")[0]):
        assert hasattr(ExampleFolder, name) or name == "keys"
