"""``mapgraft calibrate`` as a person calls it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import pytest

from mapgraft.calibrate import Labelled
from mapgraft.cli import invoke
from mapgraft.errors import OutputError
from mapgraft.outputs.lock import LOCK, RUN, locked, require_kind

Make = Callable[..., list[Labelled]]
WriteFolder = Callable[..., Path]


class Page(HTMLParser):
    """What a page loads, and whether its tags close."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.loads += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]
        if tag not in ("meta", "img", "link", "br", "input"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture
def folder(made: Make, write_folder: WriteFolder) -> Path:
    return write_folder("examples-of-<b>two</b>", made("a", 400, 1, watched=True) + made("b", 400, 2, watched=True))


def test_it_writes_rules_json_and_a_page_the_same_each_time(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for out in ("one", "two"):
        assert invoke(["calibrate", str(folder), "-o", str(tmp_path / out), "--false-accept", "0.02"]) == 0
    told = capsys.readouterr().out
    assert "accept above" in told
    assert "for other buildings on an assumption" in told
    names = ("calibration.json", "report.html", "rules.yaml")
    assert sorted(path.name for path in (tmp_path / "one").iterdir() if path.name != LOCK) == list(names)
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    content = json.loads((tmp_path / "one" / "calibration.json").read_text("utf-8"))
    assert content["format"] == "mapgraft calibration 1"
    assert content["asked"]["false_accept"] == 0.02
    assert content["rules"][0]["groups"][0]["accept"]["environments"][0]["environment"] == "a"
    page = (tmp_path / "one" / "report.html").read_text("utf-8")
    parser = Page()
    parser.feed(page)
    assert not parser.open
    assert all(target.startswith("#") for target in parser.loads)
    assert "<script" not in page
    assert "<b>two" not in page
    for chart in ("ROC", "Reliability", "Precision and recall", "Thresholds by resolution", "Thresholds by quality"):
        assert chart in page
    assert not re.search(r"\b(nan|inf)\b", page)


def test_decide_takes_what_it_wrote(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke(["calibrate", str(folder), "-o", str(tmp_path / "out"), "--false-accept", "0.02"]) == 0
    capsys.readouterr()
    told = ["type=occupancy_grid", "resolution_m=0.07", "known_area_m2=50", "scale_known=true"]
    question = [part for side in ("--own", "--other") for fact in told for part in (side, fact)]
    for way in ("-c", "--rules"):
        assert invoke(["decide", way, str(tmp_path / "out" / "rules.yaml"), *question]) == 0
        assert "occupancy_grid 0.07 m ← occupancy_grid 0.07 m, ledger" in " ".join(capsys.readouterr().out.split())


def test_what_is_not_installed_is_left_out_so_that_the_table_can_be_read(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    without = ["--no-plugin", "line_segments"]
    out, collecting = tmp_path / "out", tmp_path / "collecting.yaml"
    for arguments in ([str(folder), "-o", str(out), "--false-accept", "0.02"], ["--collecting", str(collecting)]):
        assert invoke(["calibrate", *arguments, *without]) == 0
        assert "the rule 'a cloud into line segments' is left out, " in " ".join(capsys.readouterr().err.split())
    types = ["--own", "type=occupancy_grid", "--other", "type=occupancy_grid"]
    for path in (out / "rules.yaml", collecting):
        assert invoke(["decide", "--rules", str(path), *types, *without]) == 0


def test_the_configuration_says_what_is_promised_and_the_command_line_goes_before(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "config.yaml"
    config.write_text("calibrate: {false_accept: 0.05, false_revert: 0.1}\n", encoding="utf-8")
    arguments = ["calibrate", str(folder), "-o", str(tmp_path / "out"), "-c", str(config), "--json"]
    assert invoke([*arguments, "--false-revert", "0.2"]) == 0
    asked = json.loads(capsys.readouterr().out)["asked"]
    assert (asked["false_accept"], asked["false_confirm"], asked["false_revert"]) == (0.05, 0.001, 0.2)


def test_maps_that_are_unlike_take_the_guarantee_away(
    folder: Path, made: Make, write_folder: WriteFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    meant = write_folder("meant", made("c", 300, 3, wrong_at=2.0), truth=False)
    out = str(tmp_path / "out")
    assert invoke(["calibrate", str(folder), "-o", out, "--false-accept", "0.02", "--for", str(meant)]) == 0
    assert "no guarantee for other buildings: Of c the scores are" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "name labelled examples and a folder to write to"),
        (["{folder}"], "name labelled examples and a folder to write to"),
        (["{tmp}/none", "-o", "{tmp}/out"], "there is no folder {tmp}/none"),
        (["{folder}", "-o", "{tmp}/out", "--false-accept", "0"], "false-accept must be a rate between 0 and 1"),
        (["{folder}", "-o", "{tmp}/out", "--cost-miss", "-1"], "cost-miss must be above 0"),
        (["{folder}", "-o", "{tmp}/out", "--without", "a", "--without", "b"], "(800 left out by name)"),
        (
            ["{folder}", "-o", "{tmp}/out", "--without", "bb"],
            "no example is of 'bb', which is to be left out: the buildings are a, b",
        ),
        (["{folder}", "-o", "{tmp}/out", "--score", "no.such"], "no example tells the number no.such"),
        (["{folder}", "--collecting", "{tmp}/c.yaml"], "goes without examples"),
        (["--collecting", "{tmp}"], "--collecting {tmp}: that is a folder; name a file"),
    ],
)
def test_what_does_not_fit_is_told_in_one_sentence(
    arguments: list[str], said: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [argument.format(folder=folder, tmp=tmp_path) for argument in arguments]
    assert invoke(["calibrate", *given]) == 2
    told = capsys.readouterr().err
    assert said.replace("{tmp}", str(tmp_path)) in told
    assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "held"),
    [("summary.json", "a run"), ("dataset.json", "a dataset"), ("corpus.json", "a corpus"), ("experiment.json", "an")],
)
def test_a_folder_that_holds_something_else_is_not_written_to(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, held: str
) -> None:
    """A run has a ``report.html``, too; and examples are calibrated where they lie by a slip of the keyboard."""
    for out in (folder, tmp_path / "other"):
        out.mkdir(exist_ok=True)
        for file in (name, "report.html"):
            (out / file).write_text("{}")
        assert invoke(["calibrate", str(folder), "-o", str(out)]) == 1
        assert f"{out} holds {held}" in (told := capsys.readouterr().err) and "choose another folder" in told
        assert (out / "report.html").read_text() == "{}" and not (out / "rules.yaml").exists()


def test_a_calibration_may_be_written_anew_but_nothing_else_over_it(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    for rate in ("0.02", "0.05"):
        assert invoke(["calibrate", str(folder), "-o", str(out), "--false-accept", rate]) == 0
        assert json.loads((out / "calibration.json").read_text("utf-8"))["asked"]["false_accept"] == float(rate)
    with pytest.raises(OutputError, match="holds a calibration: choose another folder"):
        require_kind(out, RUN)
    with locked(out):
        assert invoke(["calibrate", str(folder), "-o", str(out)]) == 1
    assert "is being written by another run" in capsys.readouterr().err


def test_rules_for_collecting_are_written_and_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "collecting.yaml"
    assert invoke(["calibrate", "--collecting", str(path)]) == 0
    assert "--examples" in capsys.readouterr().out
    assert invoke(["decide", "-c", str(path), "--own", "type=occupancy_grid", "--other", "type=occupancy_grid"]) == 0
