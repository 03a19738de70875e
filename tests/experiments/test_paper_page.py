"""docs/paper.md: what is measured on it is what the writers make of docs/paper.json, and the paper's own numbers."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import pytest

from mapgraft.experiments.andersone2021.settings import PAPER
from mapgraft.experiments.andersone2021.telling.as_published import quantities
from mapgraft.experiments.andersone2021.telling.document import FORMAT, statements_in, tables_in
from mapgraft.experiments.andersone2021.telling.published import published

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def writer():
    """The script that writes the page."""
    spec = importlib.util.spec_from_file_location("tables_of_paper", ROOT / "tests" / "bench" / "tables_of_paper.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def content():
    return json.loads((ROOT / "docs" / "paper.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def text():
    return (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")


def test_the_page_is_what_the_script_makes_of_the_run(writer, content, text):
    assert writer.filled(text, content) == text
    assert "<!-- measured: run -->\n\n```sh\nmapgraft experiment andersone2021" in text


def test_the_run_is_the_papers(content):
    assert content["format"] == FORMAT
    settings = content["settings"]
    assert (settings["right"], settings["wrong"], settings["seed"], settings["matcher"]) == (20, 20, 0, "carpin")
    tables = {table.name: table for table in tables_in(content)}
    for number, combination in enumerate(PAPER, start=1):
        table = tables[f"table{number}"]
        for quantity, *_ in quantities():
            for kind, right in (("right", True), ("wrong", False)):
                for short in ("1M", "2M"):
                    told = published().number(combination, right, short, quantity)
                    assert table.row(quantity).paper[f"{kind}_{short}"].value == told.value


def test_the_ledgers_promises_hold_in_the_run(content):
    said = {one.name: one for one in statements_in(content)}
    for name in ("ledger_metrics", "ledger_revert", "ledger_cost", "ledger_cost_of_metrics"):
        assert said[name].holds is True, said[name].found


def test_every_picture_of_the_page_is_there(text):
    pictures = re.findall(r"!\[[^]]+\]\((pictures/[^)]+)\)", text)
    assert len(pictures) == 3
    for picture in pictures:
        assert (ROOT / "docs" / picture).read_bytes().startswith(b"\x89PNG")


def test_others_are_refused(writer, tmp_path):
    with pytest.raises(SystemExit, match="no run of mapgraft experiment"):
        writer.read(tmp_path)
