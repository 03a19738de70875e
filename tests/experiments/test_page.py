"""The document and the page: the same every time but for times, complete, and nothing is markup that should not be."""

from __future__ import annotations

import dataclasses
import json
import re
from html.parser import HTMLParser
from itertools import islice
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from mapgraft.commands.app import app
from mapgraft.errors import OutputError, UsageError
from mapgraft.experiments.andersone2021.outcome import Cost
from mapgraft.experiments.andersone2021.telling.charts import costs_figure
from mapgraft.experiments.andersone2021.telling.detection import curves
from mapgraft.experiments.andersone2021.telling.document import document, statements_in, tables_in, timing_told
from mapgraft.experiments.andersone2021.telling.page import SECTIONS, page, page_of
from mapgraft.experiments.andersone2021.telling.presentation import json_bytes, table_files, tables_of
from mapgraft.experiments.andersone2021.telling.statements import statements
from mapgraft.experiments.andersone2021.telling.summary import show
from mapgraft.experiments.andersone2021.telling.tables import csv_text, markdown
from mapgraft.experiments.andersone2021.timing import timing


@pytest.fixture
def content(files):
    return json.loads(files["experiment.json"])


@pytest.fixture
def pngs(files):
    return {name: file for name, file in files.items() if name.endswith(".png")}


def test_tables_and_statements_come_back_from_the_document(experiment, content):
    found = curves(experiment)
    tables = tables_of(experiment, found)
    again = tables_in(content)
    assert [table.name for table in again] == [table.name for table in tables]
    for ours, theirs in zip(tables, again, strict=True):
        assert markdown(theirs) == markdown(ours)
        assert csv_text(theirs) == csv_text(ours)
    assert statements_in(content) == statements(experiment, found)


def test_all_but_times_is_the_same_again(experiment, provenance, content):
    slower = {
        strategy: dataclasses.replace(kept, cost=dataclasses.replace(kept.cost, update_s=3.0), revert_s=7.0)
        for strategy, kept in experiment.merges[0].by.items()
    }
    merges = [dataclasses.replace(experiment.merges[0], by=slower), *experiment.merges[1:]]
    later = dataclasses.replace(experiment, merges=merges, elapsed_s=99.0)
    before, other = (document_of(one, provenance) for one in (experiment, later))
    assert before == {**content, "figures": []}
    assert other["times"] != content["times"]
    del other["times"], before["times"]
    assert json.dumps(other) == json.dumps(before)


def test_the_files_that_depend_on_the_clock_are_those_that_are_documented(experiment, files):
    slower = {
        strategy: dataclasses.replace(kept, cost=Cost(*(3.0 + 0.7 * n * k for k in range(3))), revert_s=7.0)
        for n, (strategy, kept) in enumerate(experiment.merges[0].by.items())
    }
    later = dataclasses.replace(experiment, merges=[_timed_as(m, slower) for m in experiment.merges])
    found = curves(later)
    tables = tables_of(later, found)
    again = {**table_files(tables, statements(later, found)), "figures/costs.png": costs_figure(later).png}
    assert {name for name, content in again.items() if content != files[name]} == {
        "tables.md",
        "tables.parquet",
        "figures/costs.png",
        *(
            f"tables/{name}.{kind}"
            for name in ("table1", "table2", "table3", "costs", "ways")
            for kind in ("md", "csv")
        ),
    }


def _timed_as(merge, slower):
    by = {way: dataclasses.replace(kept, cost=slower[way].cost, revert_s=7.0) for way, kept in merge.by.items()}
    return dataclasses.replace(merge, by=by)


def document_of(experiment, provenance):
    """The document as it comes back from its file, without figures."""
    found = curves(experiment)
    tables = tables_of(experiment, found)
    told = document(experiment, tables, statements(experiment, found), found, [], provenance, "nobody named another")
    return json.loads(json_bytes(told))


def test_the_page_can_be_made_again_from_the_folder(files, content, pngs):
    assert page(content, pngs).encode() == files["report.html"]


def test_the_report_command_makes_it_from_the_folder(files, tmp_path):
    for name, content in files.items():
        if name != "report.html":
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_bytes(content)
    result = CliRunner().invoke(app, ["report", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "report.html").read_bytes() == files["report.html"]


def test_damage_is_said(files, tmp_path, content):
    with pytest.raises(UsageError, match="cannot be read"):
        page_of(tmp_path)
    place = tmp_path / "experiment.json"
    del content["tables"][3]["rows"][0]["cells"]
    for damaged in ("{", "[]", '{"figures": []}', json.dumps(content)):
        place.write_text(damaged)
        with pytest.raises(OutputError, match="damaged or of another version"):
            page_of(tmp_path)


def _damaged(value):
    """The value with one of its parts gone or of another type, part by part; of lists the first part alone."""
    if isinstance(value, dict):
        for key in value:
            yield {name: part for name, part in value.items() if name != key}
            yield from ({**value, key: part} for part in _damaged(value[key]))
    elif isinstance(value, list) and value:
        yield from ([part, *value[1:]] for part in _damaged(value[0]))
    yield from (other for other in (None, 7, "seven", [[]], {"": {}}) if type(other) is not type(value))


def test_no_damage_is_an_internal_error(tmp_path, content):
    """Whatever is missing or of another type: a page, or one sentence."""
    content["figures"], content["curves"] = content["figures"][:1], []
    content["tables"] = [{**table, "rows": table["rows"][:3]} for table in content["tables"]]
    place, refused = tmp_path / "experiment.json", 0
    place.write_text(json.dumps(content))
    assert page_of(tmp_path).startswith("<!")
    for damaged in islice(_damaged(content), 0, None, 31):
        place.write_text(json.dumps(damaged))
        try:
            page_of(tmp_path)
        except OutputError as error:
            refused += 1
            assert "\n" not in str(error) and error.exit_code == 1
    assert refused > 10
    place.write_text("[" * 100_000)
    with pytest.raises(OutputError, match="damaged"):
        page_of(tmp_path)


def test_the_time_of_everything_is_told_beside_the_machine(content, pngs):
    taken = timing(61.24)
    content["times"] |= timing_told(taken)
    assert content["times"]["whole_s"] == 61.24 and content["times"]["machine"]["cpus"] >= 1
    text = page(content, pngs)
    assert "61.2 s, from reading to written files" in text and "everything 61 s" in text
    assert set(content["times"]["machine"]) == {"cpus", "processor", "load"}
    assert "from reading to written files" not in page({**content, "times": content["times"] | timing_told(None)}, pngs)


def test_no_file_outside_of_the_folder_becomes_a_figure(content, pngs, tmp_path):
    (tmp_path / "secret.png").write_bytes(next(iter(pngs.values())))
    folder = tmp_path / "out"
    folder.mkdir()
    content["figures"] = [{**content["figures"][0], "file": "../secret.png"}]
    (folder / "experiment.json").write_text(json.dumps(content))
    assert seen(page_of(folder)).tags.count("img") == 0


def test_another_format_is_no_page():
    with pytest.raises(ValueError, match="andersone2021"):
        page({"format": "something else"}, {})


class _Seen(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.links, self.ids = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "data", "action", "srcset"):
                self.links.append(value)
            if name == "id":
                self.ids.append(value)
            assert not name.startswith("on"), f"{tag} has {name}"


def seen(text):
    parser = _Seen()
    parser.feed(text)
    return parser


def test_the_page_is_complete_in_itself(files):
    text = files["report.html"].decode()
    found = seen(text)
    assert not {"script", "link", "iframe", "object", "embed", "base", "form"} & set(found.tags)
    assert all(link.startswith(("data:image/png;base64,", "#")) for link in found.links)
    assert "url(" not in re.sub(r"<style>.*?</style>", "", text, flags=re.DOTALL) and "@import" not in text
    assert len(found.ids) == len(set(found.ids))
    assert {link[1:] for link in found.links if link.startswith("#")} <= set(found.ids)
    assert found.tags.count("img") == 11
    assert len(files["report.html"]) < 5_000_000


def test_every_table_claim_and_figure_is_on_the_page(files, content):
    found = seen(files["report.html"].decode())
    ids = set(found.ids)
    assert {f"table-{table['name']}" for table in content["tables"]} <= ids
    assert {f"figure-{figure['name']}" for figure in content["figures"]} <= ids
    assert {f"claim-{one['name']}" for one in content["statements"]} <= ids
    assert {section.anchor for section in SECTIONS} <= ids
    assert files["report.html"].decode().count("this is no held-out test") == 3  # claims, evidence, verdicts


def test_curves_keep_their_points_but_for_details_of_evidence(content):
    for curve in content["curves"]:
        is_detail = "." in curve["number"] and not curve["number"].startswith("verifier.")
        assert ("points" in curve) is not is_detail, curve["number"]
    assert "verifier.log_odds_wrong" in {curve["number"] for curve in content["curves"]}


def test_names_are_text(content, pngs):
    evil = "<script>alert(1)</script>\"' onload=x .log"
    content["files"][0]["path"] = evil
    content["remarks"] = [evil]
    content["why"] = content["config"] = evil
    content["figures"][0]["caption"] = evil
    content["tables"][0]["rows"][0]["labels"] = [evil]
    found = seen(page(content, pngs))
    assert "script" not in found.tags


def test_a_figure_that_is_gone_is_said(content, pngs):
    del pngs["figures/figure7.png"]
    pngs["figures/roc.png"] = b"no picture"
    text = page(content, pngs)
    assert "The file figures/figure7.png is not there or no PNG." in text
    assert "The file figures/roc.png is not there or no PNG." in text
    assert seen(text).tags.count("img") == 9


def test_tables_are_written_in_every_form(files, content):
    names = [table["name"] for table in content["tables"]]
    assert names[:5] == ["table1", "table2", "table3", "table4", "costs"]
    for name in names:
        assert files[f"tables/{name}.md"].decode() in files["tables.md"].decode()
        assert files[f"tables/{name}.csv"].startswith(b"row,")
    assert files["tables.parquet"][:4] == b"PAR1"


def test_the_console_tells_the_tables_the_claims_and_the_place(experiment, tmp_path):
    with (tmp_path / "out.txt").open("w+", encoding="utf-8") as file:
        show(experiment, Console(file=file, highlight=False), Path("some/where"))
        file.seek(0)
        text = file.read()
    assert "0.1-0.07" in text and "(0.986)" in text
    assert "✓ The ledger's metrics are those of two maps, bit for bit." in text
    assert "Written to some/where" in text
