"""Where the page comes from and goes to: runs that write it, the command, and folders that have none."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from plots import provenance, tell, told

import mapgraft
from mapgraft.cli import invoke
from mapgraft.commands import report as command
from mapgraft.config import Config, load_config
from mapgraft.errors import OutputError, UsageError
from mapgraft.job import essence_of
from mapgraft.outputs.report import page_of, publish
from mapgraft.outputs.run_folder import RunFolder
from mapgraft_recordings import demo_files

Summary = Callable[[Path], dict[str, object]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole demo, replayed once."""
    out = tmp_path_factory.mktemp("demo") / "out"
    mapgraft.run(out=out)
    return out


def test_a_run_writes_the_page_and_lists_it(run: Path, summary: Summary, read) -> None:
    page = (run / "report.html").read_text(encoding="utf-8")
    assert page == page_of(run)
    assert "report.html" in summary(run)["files"]
    assert not list(run.rglob("*.partial"))
    assert 100_000 < len(page) < 5_000_000
    text = read(page).text
    for merge in summary(run)["merges"]:
        assert merge["merge_id"] in text and merge["reason"] in text
    assert "Exact: alpha’s map is, bit for bit, what it would be had this merge never happened." in text
    assert "log_odds_wrong" in text and "reverted at 6.903" in text


def test_every_merge_of_the_demo_is_shown_at_the_merge_and_later(run: Path, summary: Summary, read) -> None:
    alts = read((run / "report.html").read_text(encoding="utf-8")).attributes("alt")
    merges = summary(run)["merges"]
    reverted = sum(merge["state"] == "reverted" for merge in merges)
    assert reverted == 2
    assert sum(alt.endswith("on each other at the merge") for alt in alts) == len(merges)
    assert sum(alt.endswith("on each other just before it was reverted") for alt in alts) == reverted
    assert sum(alt.endswith("on each other at the end") for alt in alts) == len(merges) - reverted


def test_where_one_map_is_kept_it_says_whose_it_holds(tmp_path: Path, read) -> None:
    """There is no own map to show: what is held against a donor's has its share, and that of earlier ones."""
    files, config, _ = demo_files()
    given = load_config(config).model_copy(update={"reversal": "single_map"})
    events = mapgraft.run(files, given, tmp_path / "out").events
    text = read((tmp_path / "out" / "report.html").read_text(encoding="utf-8")).text
    first = next(event for event in events if event.kind == "merged")
    assert f"blue is {first.receiver}’s alone, orange {first.donor}’s alone" in text
    assert re.search(r"map, which holds something of \w+, and \w+’s on it", text)
    assert "already, so that they agree where nobody else looked" in text


def test_the_command_writes_it_again_or_elsewhere(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    before = (run / "report.html").read_bytes()
    assert invoke(["report", str(run)]) == 0
    assert str(run / "report.html") in capsys.readouterr().out.replace("\n", "")
    assert invoke(["report", str(run), "-o", str(tmp_path / "new" / "page.html")]) == 0
    assert before == (run / "report.html").read_bytes() == (tmp_path / "new" / "page.html").read_bytes()


@pytest.mark.parametrize("wanted", (True, False))
def test_the_page_is_left_out_when_nobody_wants_it(wanted: bool, tmp_path: Path, summary: Summary) -> None:
    (alpha, *_), _, _ = demo_files()
    out = tmp_path / "out"
    option = "--report" if wanted else "--no-report"
    for given in ([], [option]):  # an earlier run's page does not stay beside a run that has none
        assert invoke(["run", str(alpha), "--end", "5", "-q", "-o", str(out), *given]) == 0
    assert (out / "report.html").exists() == wanted == ("report.html" in summary(out)["files"])


def test_with_or_without_the_page_it_is_the_same_run() -> None:
    texts = {essence_of([], Config.model_validate({"output": {"report": wanted}}), ()) for wanted in (True, False)}
    assert len(texts) == 1


def test_a_page_that_cannot_be_made_takes_nothing_from_the_run(tmp_path: Path, summary: Summary) -> None:
    out = tmp_path / "out"
    with (
        pytest.raises(OutputError, match=r"the run is whole in .*, but its report\.html could not be made: .*mission"),
        RunFolder(out, "demo", "r1", provenance(), report=True) as sink,
    ):
        tell(sink, told())  # and no mission.json is kept
    assert "report.html" not in summary(out)["files"]
    assert not list(out.rglob("*.partial")) and (out / "demo.merge.mcap").is_file()
    with RunFolder(out, "demo", "r1", provenance()):  # its lock was given back
        pass


def test_a_page_is_written_whole_or_not_at_all(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="in the way"):
        publish(folder, "page", tmp_path / "file" / "page.html")
    assert publish(folder, "a page \ud800", tmp_path / "page.html").read_text() == "a page ?"


def test_folders_without_a_run_are_told_apart(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    def said(path: Path) -> str:
        assert invoke(["report", str(path)]) == 2
        return capsys.readouterr().err

    assert "there is no folder" in said(tmp_path / "nothing")
    (tmp_path / "a.txt").touch()
    assert "a.txt is a file: give the folder that mapgraft run wrote" in said(tmp_path / "a.txt")
    (tmp_path / "empty").mkdir()
    assert "is not the folder of a run: it has no summary.json" in said(tmp_path / "empty")
    (tmp_path / "empty" / "demo.merge.mcap.partial").touch()
    assert "is not finished (demo.merge.mcap.partial is there): wait for it, or" in said(tmp_path / "empty")
    for name in ("demo.merge.mcap", "mission.json", "events"):
        broken = tmp_path / name
        shutil.copytree(folder, broken)
        shutil.rmtree(broken / name) if (broken / name).is_dir() else (broken / name).unlink()
        assert "is not whole" in said(broken)


@pytest.mark.parametrize("name", ("summary.json", "mission.json", "demo.merge.mcap"))
@pytest.mark.parametrize("content", (b"", b"{}", b"[1]", b"\xff\xfe", b'{"files": 3, "run_id": 1, "config": 2}'))
def test_folders_that_are_damaged_give_one_sentence(name: str, content: bytes, folder: Path, tmp_path: Path) -> None:
    broken = tmp_path / "out"
    shutil.copytree(folder, broken)
    (broken / name).write_bytes(content)
    with pytest.raises(UsageError, match=r"run (it )?again$"):
        page_of(broken)


def test_a_target_that_is_a_folder_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="name the file to write"):
        command.report_and_show(folder, tmp_path)


@pytest.mark.parametrize("held", sorted(command.PAGES))
def test_every_kind_of_folder_has_a_function_that_is_there(held: str) -> None:
    module, _, function = command.PAGES[held].partition(":")
    assert callable(getattr(__import__(module, fromlist=[function]), function))


def test_the_summary_stays_what_it_was_but_for_the_list(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(folder, out)
    before = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    publish(out, "page")
    after = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert after == before | {"files": sorted([*before["files"], "report.html"])}
