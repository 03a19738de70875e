"""Lists of pairs: every form they come in, and what is wrong with those that cannot be used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mapgraft.errors import UsageError
from mapgraft.matching.pair_list import fitted, read_lists
from mapgraft.matching.pixels import moved

SAME = [1, 0, 0, 0, 1, 0]
KEYPOINTS = {"keypoints_a": [[0, 1], [2, 3]], "keypoints_b": [[4, 5], [6, 9]]}


def write(folder: Path, content: Any, name: str = "pairs.json") -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_both_spellings_of_resolutions_and_files_beside_the_list(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        [
            {"a": "x/a.png", "b": "b.png", "res_a": 0.05, "res_b": 0.01, "T_px_b2a": SAME, "note": "let be"},
            {"a": "b.png", "b": "c.yaml", "resolution_a_m": 0.01, **KEYPOINTS},
        ],
    )
    first, second = read_lists([path], []).pairs
    assert first.a.path == (tmp_path / "x" / "a.png").resolve()
    assert (first.a.resolution_m, first.b.resolution_m, first.kind, first.id) == (0.05, 0.01, "transform", "a__b")
    assert second.kind == "keypoints"
    assert second.T_px_a_b is not None
    assert second.b.resolution_m is None


def test_what_one_entry_leaves_out_another_one_tells(tmp_path: Path) -> None:
    path = write(tmp_path, [{"a": "a.png", "b": "b.png", "res_a": 0.05, "res_b": 0.1, "T_px_b2a": SAME}])
    other = write(tmp_path, [{"a": "b.png", "b": "a.png"}], "unrelated.json")
    listed = read_lists([path], [other])
    pair = listed.pairs[1]
    assert pair.kind == "unrelated"
    assert (listed.known(pair.a).resolution_m, listed.known(pair.b).resolution_m) == (0.1, 0.05)


def test_across_are_maps_that_nothing_connects(tmp_path: Path) -> None:
    def pair(a: str, b: str) -> dict[str, Any]:
        return {"a": a, "b": b, "T_px_b2a": SAME}

    pairs = [pair("a1.png", "a2.png"), pair("a2.png", "a3.png"), pair("b1.png", "b2.png"), pair("c1.png", "c2.png")]
    path = write(tmp_path, {"pairs": pairs, "groups": {"one place": ["b1.png", "c2.png"]}})
    across = {(p.a.path.stem, p.b.path.stem) for p in read_lists([path], []).across()}
    assert across == {(a, other) for a in ("a1", "a2", "a3") for other in ("b1", "b2", "c1", "c2")}
    again = read_lists([path], [write(tmp_path, [pair("a1.png", "b1.png")], "unrelated.json")])
    assert len(again.across()) == len(across) - 1, "listed pairs are not listed twice"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "not JSON"),
        ([{"a": "a.png"}], r"entry 1 \(a.png\), b: "),
        (
            [{"a": "a.png", "b": "b.png", "T_px_b2a": SAME}, {"id": "odd", "a": 1, "b": "b.png"}],
            r"entry 2 \(odd\), a: ",
        ),
        ([{"a": "a.png", "b": "b.png", "T_px_b2a": SAME}, 7], "entry 2: "),
        ([{"a": "a.png", "b": "b.png"}], "--unrelated"),
        ([{"a": "a.png", "b": "b.png", "T_px_b2a": [1, 0, 0, 0, -1, 0]}], r"entry 1 \(a.png, b.png\): .*rotation"),
        ([{"a": "a.png", "b": "b.png", "T_px_b2a": [1, 0.2, 0, 0.2, 1, 0]}], "rotation"),
        ([{"a": "a.png", "b": "b.png", "keypoints_a": [[0, 0], [1, 1]]}], "keypoints_b"),
        ([{"a": "a.png", "b": "b.png", "T_px_b2a": SAME, "unrelated": True}], "unrelated"),
        ([{"a": "a.png", "b": "b.png", "T_px_b2a": SAME, "res_a": -1}], "greater than 0"),
        ({"maps": []}, "pairs"),
        ([{"a": "a.png", "b": f"{n}.png", "T_px_b2a": SAME, "res_a": n} for n in (0.1, 0.2)], "elsewhere"),
    ],
)
def test_what_cannot_be_used_is_said(tmp_path: Path, content: Any, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        read_lists([write(tmp_path, content)], [])


def test_a_list_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read_lists([tmp_path / "none.json"], [])


def test_the_fit_of_keypoints_is_the_best_similarity() -> None:
    random = np.random.default_rng(1)
    b = random.uniform(0, 1000, (12, 2))
    S = np.array([[0.6, -0.8, 30.0], [0.8, 0.6, -20.0], [0.0, 0.0, 1.0]])
    assert fitted(moved(S, b), b) == pytest.approx(S)
    noisy = moved(S, b) + random.normal(0, 5, (12, 2))
    least = np.square(moved(fitted(noisy, b), b) - noisy).sum()
    for change in random.normal(0, 1e-3, (20, 2)):
        worse = fitted(noisy, b) + np.array([[change[0], -change[1], 0], [change[1], change[0], 0], [0, 0, 0]])
        assert np.square(moved(worse, b) - noisy).sum() > least


def test_the_real_lists_are_read_as_they_are(shared_data: Path) -> None:
    maps = shared_data / "maps"
    grid = read_lists([maps / "grid_pairs" / "pairs.json"], [maps / "grid_pairs" / "unrelated.json"])
    assert [pair.kind for pair in grid.pairs].count("transform") == 29
    assert [pair.kind for pair in grid.pairs].count("unrelated") == 4
    assert all(grid.known(file).resolution_m for pair in grid.pairs for file in (pair.a, pair.b))
    flats = read_lists([maps / "halmstad" / "pairs.json"], [])
    assert {pair.kind for pair in flats.pairs} == {"keypoints"}
    told = json.loads((maps / "halmstad" / "pairs.json").read_text())
    for pair, entry in zip(flats.pairs, told, strict=True):
        assert pair.keypoints is not None
        off = moved(fitted(*pair.keypoints), pair.keypoints[1]) - pair.keypoints[0]
        assert np.sqrt(np.square(off).sum(axis=1).mean()) == pytest.approx(entry["fit_rmse_px"], abs=0.02)
        assert pair.T_px_a_b == pytest.approx(fitted(*pair.keypoints), abs=0.05)
    assert len(flats.across()) == 5 * 5
