"""``mapgraft match`` as a person uses it: what it prints, what it writes, and its exit codes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.cli import invoke
from mapgraft.commands.match_list import shortened
from mapgraft.commands.match_text import shown
from mapgraft_grid import map_server
from mapgraft_grid.grid_map import FREE, OCCUPIED, DenseGrid

Image = NDArray[np.uint8]
Said = Callable[..., tuple[int, str, str]]
SHAPE = (520, 560)
PICTURE = b"\x89PNG"


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str], rules: Path) -> Said:
    """Runs ``mapgraft match`` by rules of the tests' own: exit code, stdout, stderr."""

    def run(*arguments: object) -> tuple[int, str, str]:
        code = invoke(["match", "--rules", str(rules), *map(str, arguments)])
        out, err = capsys.readouterr()
        assert "Traceback" not in err
        return code, out, err

    return run


@pytest.fixture
def pair(save, floor, turn, similarity) -> tuple[Path, Path, NDArray[np.float64]]:
    """A floor, the same one turned, and T_px_a_b."""
    T_px_b_a = similarity(70.0, 420.0, 30.0)
    b = save("b.png", turn(floor(0.05), T_px_b_a, SHAPE))
    return save("a.png", floor(0.05)), b, np.linalg.inv(T_px_b_a)


@pytest.fixture
def stranger(save) -> Path:
    image = np.full((300, 300), 254, np.uint8)
    image[50:250, 60:64] = image[80:84, 60:280] = image[200:204, 10:200] = image[10:90, 150:153] = 0
    return save("stranger.png", image)


def test_an_accepted_pair_is_told_and_written(said: Said, pair, tmp_path: Path) -> None:
    a, b, T_px_a_b = pair
    out = tmp_path / "out"
    code, text, _ = said(a, b, "--resolution", 0.05, "-o", out)
    assert code == 0
    for word in (
        "accepted",
        "provisionally",
        "T_a_b",
        "x_a =",
        "centres at whole numbers",
        "score",
        "similarity",
        "rule",
    ):
        assert word in text
    names = {"match.json", "merged.pgm", "merged.yaml", "overlay.png"}
    assert {path.name for path in out.glob("[!.]*")} == names
    told = json.loads((out / "match.json").read_text())
    assert set(told["files"]) == names
    assert told["accepted"] is True
    found = np.array([*told["T_px_b2a"], 0, 0, 1]).reshape(3, 3)
    assert abs((found - T_px_a_b)[:2, :2]).max() < 0.01
    merged = map_server.read(out / "merged.yaml")
    assert merged.resolution_m == 0.05
    assert (out / "overlay.png").read_bytes().startswith(PICTURE)


def test_the_same_files_give_the_same_bytes(said: Said, pair, tmp_path: Path) -> None:
    a, b, _ = pair
    for name in ("one", "two"):
        assert said(a, b, "--resolution", 0.05, "-o", tmp_path / name)[0] == 0
    for path in (tmp_path / "one").glob("[!.]*"):
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes(), path.name


def test_json_tells_the_same_with_the_time(said: Said, pair) -> None:
    a, b, _ = pair
    code, text, _ = said(a, b, "--resolution", 0.05, "--json")
    told = json.loads(text)
    assert code == 0
    assert told["verdict"] == "provisional"
    assert told["match_s"] <= told["elapsed_s"]
    assert told["a"]["width_px"] == 440
    assert told["procedure"] == {
        "match": "carpin",
        "accept": "thresholds",
        "fuse": "log_odds",
        "metrics": ["similarity"],
    }
    assert told["files"] == []
    assert told["hypotheses"][0]["accepted"]
    assert not any(hypothesis["accepted"] for hypothesis in told["hypotheses"][1:])


def test_what_is_not_accepted_is_shown_and_not_merged(said: Said, pair, stranger: Path, tmp_path: Path) -> None:
    a, b, _ = pair
    out = tmp_path / "out"
    assert said(a, b, "--resolution", 0.05, "-o", out)[0] == 0
    code, text, _ = said(a, stranger, "--resolution", 0.05, "-o", out, "--hypotheses")
    assert code == 0
    assert "NOT accepted" in text
    assert "not merged" in text
    assert re.search(r"^ +score +margin +x m +y m +yaw °", text, re.MULTILINE)
    assert re.search(r"^1 +\S+ +\S+( +-?\d+\.\d+){3}", text, re.MULTILINE)
    assert "evidence." in text and "similarity" in text and "nan" not in text
    assert {path.name for path in out.glob("[!.]*")} == {"candidate.png", "match.json"}, (
        "nothing of the earlier match stays"
    )
    told = json.loads((out / "match.json").read_text())
    assert (told["accepted"], told["T_a_b"], told["T_px_b2a"]) == (False, None, None)
    assert told["hypotheses"][0]["T_a_b"]["x_m"] is not None


def test_a_rejected_pair_gives_every_rules_reason(said: Said, pair, tmp_path: Path) -> None:
    a, b, _ = pair
    code, text, _ = said(a, b, "--resolution", 1.0, "--other-resolution", 0.05, "-o", tmp_path / "out")
    assert code == 0
    assert "rejected" in text
    assert "✗ grids: resolution_ratio is 20" in text
    assert [path.name for path in (tmp_path / "out").glob("[!.]*")] == ["match.json"]


def test_a_described_map_tells_its_resolution_itself(said: Said, save, floor, tmp_path: Path) -> None:
    classes = np.zeros((160, 220), np.uint8)
    small = cv2.resize(floor(0.05), (220, 160), interpolation=cv2.INTER_NEAREST)[::-1]
    classes[small == 254], classes[small == 0] = FREE, OCCUPIED
    grid = DenseGrid(classes, np.zeros((160, 220), np.int32), (0, 0), (-5.0, 3.0), 0.1)
    for name, content in map_server.files(grid, "described").items():
        (tmp_path / name).write_bytes(content)
    image = save("a.png", floor(0.05))
    code, text, _ = said(tmp_path / "described.yaml", image, "--resolution", 0.05, "--json")
    told = json.loads(text)
    assert code == 0
    assert (told["a"]["resolution_m"], told["b"]["resolution_m"]) == (0.1, 0.05)
    assert told["T_a_b"]["x_m"] == pytest.approx(-5.0, abs=0.15)
    assert told["T_a_b"]["y_m"] == pytest.approx(3.0, abs=0.15)
    code, _, err = said(tmp_path / "described.yaml", tmp_path / "described.yaml", "--resolution", 0.05)
    assert code == 2
    assert "--resolution is of no use" in err


def test_wrong_usage_and_unusable_files(said: Said, pair, save, tmp_path: Path) -> None:
    a, b, _ = pair
    colour = np.zeros((50, 50, 3), np.uint8)
    colour[..., 2] = 200
    wrong = save("colour.png", colour)
    for code, arguments, sentence in (
        (2, (a,), "two map files"),
        (2, (a, b), "{resolution_m: 0.05}}}; for this command --resolution METRES does, too"),
        (2, (a, b, "--resolution", 0), "above 0"),
        (2, (a, b, "--resolution", 0.05, "--unknown-gray", 300), "0 … 255"),
        (2, (a, b, "--resolution", 0.05, "--matcher", "carpine"), "did you mean 'carpin'"),
        (2, (a, b, "--resolution", 0.05, "--pairs", tmp_path / "x.json"), "without A and B"),
        (2, ("--pairs", tmp_path / "x.json"), "cannot be read"),
        (2, (a, b, "--across"), "--across needs a list"),
        (2, ("--unrelated", tmp_path / "x.json", "--hypotheses"), "without --hypotheses"),
        (1, (a, tmp_path / "none.png", "--resolution", 0.05), "there is no file"),
        (1, (a, tmp_path, "--resolution", 0.05), "is a folder: name a map file in it"),
        (2, ("--pairs", tmp_path / "x.json", "--unknown-gray", -1), "--unknown-gray must lie in 0 … 255"),
        (1, (a, wrong, "--resolution", 0.05), "in colour"),
    ):
        found, out, err = said(*arguments)
        assert (found, out) == (code, ""), (arguments, err)
        assert sentence in err, (arguments, err)


def test_a_folder_that_cannot_be_written_is_said(said: Said, pair) -> None:
    a, b, _ = pair
    code, _, err = said(a, b, "--resolution", 0.05, "-o", a)
    assert code == 1
    assert "cannot be written" in err


def test_a_list_is_judged(said: Said, pair, stranger: Path, tmp_path: Path) -> None:
    *_, T = pair
    told = {"a": "a.png", "b": "b.png", "res_a": 0.05, "res_b": 0.05}
    (tmp_path / "pairs.json").write_text(json.dumps([{**told, "id": "turned", "T_px_b2a": T[:2].ravel().tolist()}]))
    (tmp_path / "others.json").write_text(json.dumps([{"a": "a.png", "b": "stranger.png"}]))
    lists = ("--pairs", tmp_path / "pairs.json", "--unrelated", tmp_path / "others.json", "--resolution", 0.05)
    code, text, _ = said(*lists, "-o", tmp_path / "out")
    assert code == 0
    for word in (
        "turned",
        "a__stranger",
        "provisional, right",
        "1 / 1 / 0",
        "100.0 % (2.5–100.0) 1/1",
        "0.0 % (0.0–97.5) 0/1",
        "longest",
    ):
        assert word in text
    assert [path.name for path in (tmp_path / "out").glob("[!.]*")] == ["turned.png"]
    code, text, _ = said(*lists, "--across", "--json")
    document = json.loads(text)
    assert code == 0
    assert [one["id"] for one in document["pairs"]] == ["turned", "a__stranger", "b__stranger"]
    assert document["pairs"][0]["best"]["right"] is True
    merged = document["summary"]["acceptance"]["wrong_across"]
    assert (merged["count"], merged["of"]) == (0, 2)


def test_of_a_list_that_is_turned_away_only_that_is_said(said: Said, pair, tmp_path: Path) -> None:
    entry = {"a": "a.png", "b": "b.png", "unrelated": True}
    (tmp_path / "pairs.json").write_text(json.dumps([entry]))
    sizes = ("--resolution", 1.0, "--other-resolution", 0.05)
    code, text, _ = said("--pairs", tmp_path / "pairs.json", *sizes)
    assert code == 0
    assert "turned away  1 of 1 pairs by the decision table; 1 of them: " in text
    assert "merged at once" not in text


@pytest.fixture
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal of 80 columns."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "80")


def lines_of(text: str) -> list[str]:
    return [re.sub(r"\x1b\[[\d;]*m", "", line) for line in text.splitlines()]


@pytest.mark.usefixtures("narrow")
def test_a_pair_fits_a_narrow_terminal(said: Said, pair, monkeypatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    a, b, _ = pair
    code, text, _ = said(a.name, b.name, "--resolution", 0.05)
    lines = lines_of(text)
    assert code == 0
    assert max(map(len, lines[2:])) <= 80
    assert any(re.match(r"  limits +\S", line) for line in lines)
    assert any(re.match(r"  metrics +similarity [\d.]+.*, overlap \d+ m²", line) for line in lines)
    assert not any("evidence" in line for line in lines)


@pytest.mark.usefixtures("narrow")
def test_a_list_fits_a_narrow_terminal(said: Said, pair, tmp_path: Path) -> None:
    name = "a_pair_whose_name_is_much_too_long_for_any_table_in_a_terminal"
    entry = {"a": "a.png", "b": "b.png", "T_px_b2a": pair[2][:2].ravel().tolist()}
    (tmp_path / "pairs.json").write_text(json.dumps([{**entry, "id": f"{name}_{number}"} for number in (1, 2)]))
    code, text, _ = said("--pairs", tmp_path / "pairs.json", "--resolution", 0.05)
    lines = lines_of(text)
    assert code == 0
    head, *rows = (line.split() for line in lines[:3])
    assert {"pair", "best", "score", "verdict"} <= set(head) and "s" not in head
    for number, (line, row) in enumerate(zip(lines[1:3], rows, strict=True), start=1):
        assert re.fullmatch(rf"a_pair\w+…\w+_{number}", row[0]) and len(row[0]) >= 24
        assert "provisional, right" in line and len(line.rstrip()) <= 80


def test_names_are_shortened_in_their_middle() -> None:
    assert [shortened("abcdefgh", width) for width in (9, 8, 7, 4)] == ["abcdefgh", "abcdefgh", "abc…fgh", "ab…h"]


def test_numbers_are_as_short_as_they_may_be() -> None:
    values = (11253.4, -8042.9, 0.97581, 0.99997737, 1.0, 0.0, float("nan"), float("inf"))
    assert list(map(shown, values)) == ["11253", "-8043", "0.976", "0.999977", "1", "0", "–", "–"]
