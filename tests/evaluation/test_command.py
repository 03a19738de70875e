"""``mapgraft evaluate`` as a person uses it, and the page about it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mapgraft.cli import invoke
from mapgraft_recordings import demo_files

PAGE = (Path(__file__).parents[2] / "docs" / "evaluate.md").read_text(encoding="utf-8")
SMALL = ("--scans", "20", "--further", "5", "--pairs", "4")
NAMED_BY_PLUGINS = ("numbers", "later", "auc", "plugins")


@pytest.fixture(scope="module")
def recording() -> Path:
    """One robot of the demo."""
    return demo_files()[0][0]


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = invoke(["evaluate", *arguments])
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return code, out, err


def keys_of(content: Any) -> Iterator[str]:
    """All keys of a document but those that plugins name."""
    for key, value in content.items() if isinstance(content, dict) else ():
        yield key
        if key not in NAMED_BY_PLUGINS:
            yield from keys_of(value)
    for value in content if isinstance(content, list) else ():
        yield from keys_of(value)


def test_tables_for_persons_and_json_for_machines(recording, tmp_path, capsys):
    out = tmp_path / "out.json"
    code, table, err = said(
        capsys, str(recording), *SMALL, "--resolution", "0.1", "--matcher", "carpin", "--json", str(out)
    )
    assert code == 0 and re.fullmatch(r"mapgraft: 4 pairs to do \(.*\)\n", err)
    assert re.search(r"carpin +carpin, the paper's rules", table)
    for line in ("pairs", "right hypothesis on top, by true overlap", "merged at once", "after further mapping"):
        assert re.search(rf"^{line}", table, re.MULTILINE)
    assert re.search(r"^  all +4 +4 *$", table, re.MULTILINE)
    assert re.search(r"^  match( +[\d.e+]+ ms \([\d.e+]+\), [\d.e+]+){2} *$", table, re.MULTILINE)
    assert table.endswith(f"\nWritten to {out}\n")
    content = json.loads(out.read_text())
    assert content["format"] == "mapgraft evaluation 1"
    assert [file["path"] for file in content["files"]] == [str(recording)]
    assert content["robots"][0]["robot"] == "alpha" and content["robots"][0]["scans"] == 240
    assert [pair["donor"]["robot"] for pair in content["pairs"]] == ["alpha"] * 4
    missing = sorted({key for key in keys_of(content) if not re.search(rf"`([\w.]+\.)?{key}`", PAGE)})
    assert missing == []
    code, printed, err = said(
        capsys, str(recording), *SMALL, "--resolution", "0.1", "--matcher", "carpin", "--json", "-", "-q"
    )
    again = json.loads(printed)
    assert (code, err) == (0, "")
    assert content.pop("times").keys() == again.pop("times").keys()
    assert content == again


def test_one_file_has_no_pairs_across_and_several_have(capsys):
    files = [str(file) for file in demo_files()[0][:2]]
    code, out, _ = said(capsys, *files, *SMALL, "--no-baseline", "--resolution", "0.1", "--json", "-")
    assert code == 0
    content = json.loads(out)
    assert [pair["across"] for pair in content["pairs"]] == [False, True, False, True]
    assert list(content["procedures"]) == ["judged"] and "baseline" not in content["pairs"][0]
    for pair in content["pairs"]:
        assert (pair["overlap"] is None) == pair["across"]
        if pair["across"] and pair["judged"]["best"]:
            assert pair["judged"]["best"]["right"] is False and pair["judged"]["best"]["error_m"] is None


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--scans", "200"], "no recording holds two windows: 460 scans in a row would do"),
        (["--scans", "200"], "take shorter windows with --scans and --further"),
        (["--pairs", "0"], "pairs must be at least 1, found 0"),
        (["--pairs", "1000000"], "different pairs of windows, 1000000 are wanted: ask for fewer pairs"),
        (["--matcher", "corelation"], "corelation"),
        (["--resolution", "-1"], "a resolution must be above 0 metres, found -1"),
        (["--jobs", "0"], "jobs must be at least 1"),
        (["--across", "2"], "across must be a share"),
        (["--json", "/nowhere/at/all.json"], "--json /nowhere/at/all.json: its folder does not exist"),
        (["--json", "."], "--json .: that is a folder"),
        (["--type", "sponge"], "there is no map type 'sponge': installed are "),
        (["--rules", "/nowhere.yaml"], "there is no file /nowhere.yaml"),
    ],
)
def test_wrong_usage_is_one_sentence(recording, capsys, arguments, sentence):
    code, out, err = said(capsys, str(recording), *arguments)
    assert code == 2 and out == "" and "[Errno" not in err
    assert err.startswith("mapgraft: ") and sentence in err and err.count("\n") == 1


def test_where_all_pairs_are_turned_away_only_that_is_said(recording, tmp_path, capsys):
    (tmp_path / "rules.yaml").write_text(
        "- {name: none, when: {own.type: occupancy_grid}, reject: nothing is wanted}\n"
    )
    options = ("--rules", str(tmp_path / "rules.yaml"), "--no-baseline", "--examples", str(tmp_path / "examples"))
    code, out, err = said(capsys, str(recording), *SMALL, *options, "-q")
    assert (code, out) == (0, f"Examples written to {tmp_path / 'examples'}\n")
    assert err.startswith("4 of 4 pairs were turned away by the decision table: ")


def test_without_a_file_there_is_nothing_to_judge(capsys):
    code, out, err = said(capsys)
    assert code == 2 and out == "" and "'files'" in err
    code, _, err = said(capsys, "/nowhere/at.mcap")
    assert code == 1 and "/nowhere/at.mcap" in err


def test_a_ready_map_cannot_be_cut_into_windows(tmp_path, capsys):
    (tmp_path / "floor.pgm").write_bytes(b"P5 40 40 255\n" + bytes([0, 254] * 800))
    floor = tmp_path / "floor.yaml"
    floor.write_text(
        "image: floor.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    code, out, err = said(capsys, str(floor))
    assert (code, out) == (1, "") and "floor holds ready-made maps, which cannot be cut into windows" in err


def test_the_same_recording_twice_is_refused(recording, tmp_path, capsys):
    copy = tmp_path / "beta.mcap"
    copy.write_bytes(recording.read_bytes())
    code, _, err = said(capsys, str(recording), str(copy), *SMALL)
    assert code == 2 and "alpha.mcap and beta.mcap hold the same recording" in err


def test_raw_odometry_is_remarked_upon(tmp_path, capsys):
    lines = []
    for k in range(90):
        ranges = " ".join(f"{2.0 + 0.01 * ((k + i) % 50):.2f}" for i in range(180))
        lines.append(f"ODOM {0.1 * k} 0 0 0 0 0 {k} host {k}")
        lines.append(f"FLASER 180 {ranges} {0.1 * k} 0 0 {0.1 * k} 0 0 {k} host {k}")
    path = tmp_path / "drive.log"
    path.write_text("\n".join(lines) + "\n")
    code, _, err = said(capsys, str(path), "--scans", "10", "--further", "0", "--pairs", "2", "--no-baseline")
    assert code == 0 and "raw odometry, which drifts" in err


def test_the_example_of_the_page_runs(recording, capsys, monkeypatch):
    (example,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    exec(compile(example.replace('"FILE"', repr(str(recording))), "page", "exec"), {})
    known, there = capsys.readouterr().out.splitlines()
    assert [int(word) > 0 for word in known.split()] == [True] * 3
    assert there.startswith("Transform(")


def test_a_real_log_with_the_papers_matcher(shared_data, capsys):
    log = shared_data / "carmen" / "intel-corrected.log.gz"
    arguments = (
        "--pairs",
        "8",
        "--resolution",
        "0.1",
        "--matcher",
        "carpin",
        "--no-baseline",
        "--seed",
        "3",
        "--json",
        "-",
        "--quiet",
    )
    code, out, err = said(capsys, str(log), *arguments)
    assert (code, err) == (0, "")
    content = json.loads(out)
    assert content["robots"] == [
        {
            "robot": "intel-corrected",
            "recording": "intel-corrected.log.gz",
            "scans": 910,
            "poses": "the pose in each scan line: corrected poses",
            "timed": True,
        }
    ]
    assert all(pair["judged"]["verdict"] in ("unmatched", "ambiguous", "provisional") for pair in content["pairs"])
    for pair in content["pairs"]:
        error = pair["judged"]["best"]
        assert error["right"] == (error["error_m"] <= 0.5 and error["error_deg"] <= 5.0)
    summary = content["procedures"]["judged"]["summary"]
    assert summary["right"] + summary["wrong"] == 8
    assert sum(bin_["recall"]["count"] for bin_ in summary["recall"]) == summary["right"]
    assert summary["auc"]["similarity"]["right"] == summary["right"]
