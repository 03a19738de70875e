"""Two map files through the engine: where the donor lies, what is merged, and why others are not."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, MapError
from mapgraft.matching.folder import write_folder
from mapgraft.matching.pairing import Pairer
from mapgraft.matching.pixels import in_pixels, moved, planar
from mapgraft.matching.ready_map import Shelf
from mapgraft_grid.grid_map import GridMap

Image = NDArray[np.uint8]
Save = Callable[[str, Image], Path]
Bench = tuple[Shelf, Pairer]

CORNERS = np.array([(20.0, 20.0), (400.0, 30.0), (60.0, 280.0)])


@pytest.mark.parametrize("resolutions", [(0.05, 0.05), (0.05, 0.1), (0.1, 0.04)])
def test_b_lies_where_it_was_turned_to(bench: Bench, save: Save, floor, turn, similarity, resolutions) -> None:
    fine, coarse = resolutions
    scale = fine / coarse  # b's pixels per pixel of a
    T_px_b_a = similarity(33.0, 180.0 * scale, 40.0 * scale, scale)
    a = save("a.png", floor(fine))
    b = save("b.png", turn(floor(fine), T_px_b_a, (round(520 * scale * 0.05 / fine), round(560 * scale * 0.05 / fine))))
    shelf, pairer = bench
    ours, theirs = shelf.read(a, {"resolution_m": fine}), shelf.read(b, {"resolution_m": coarse})
    pairing = pairer.pair(ours, theirs)
    assert pairing.verdict == "provisional", pairing.reason
    assert pairing.accepted is not None
    assert ours.image is not None
    assert theirs.image is not None
    T_px = in_pixels(ours.image, theirs.image, planar(pairing.accepted.match.T_receiver_donor))
    there = CORNERS * 0.05 / fine
    off_m = np.linalg.norm(moved(T_px, moved(T_px_b_a, there)) - there, axis=1) * fine
    assert off_m.max() < 0.3
    assert isinstance(pairing.merged, GridMap)
    assert pairing.merged.resolution_m == fine
    assert pairing.merged.lattice == ours.view.lattice, "the receiver's cells stay where they are"
    assert sum(hypothesis.accepted for hypothesis in pairing.hypotheses) == 1


def test_what_only_b_knows_comes_into_as_map_and_leaves_a_as_it_was(bench: Bench, save: Save, floor) -> None:
    whole = floor(0.05)
    left, right = whole.copy(), whole.copy()
    left[:, 270:], right[:, :120] = 205, 205
    shelf, pairer = bench
    a, b = (shelf.read(save(f"{n}.png", image), {"resolution_m": 0.05}) for n, image in (("a", left), ("b", right)))
    before = a.map_type.encode(a.layer)
    pairing = pairer.pair(a, b)
    assert pairing.accepted is not None
    assert pairing.accepted.match.T_receiver_donor.difference(_identity())[0] < 0.1
    assert pairing.merged is not None
    assert pairing.merged.known() > 1.3 * a.view.known()
    assert a.map_type.encode(a.layer) == before
    assert pairer.pair(a, b).merged is not None, "the same pair may be matched again"


def test_the_same_file_twice_is_the_identity(bench: Bench, save: Save, floor) -> None:
    shelf, pairer = bench
    path = save("a.png", floor(0.05))
    a, b = (shelf.read(path, {"resolution_m": 0.05}) for _ in range(2))
    assert a is b
    pairing = pairer.pair(a, b)
    assert pairing.accepted is not None
    shift_m, turn_rad = pairing.accepted.match.T_receiver_donor.difference(_identity())
    assert shift_m < 0.05
    assert math.degrees(turn_rad) < 0.2


def test_resolutions_too_far_apart_are_rejected_with_every_rules_reason(bench: Bench, save: Save, floor) -> None:
    shelf, pairer = bench
    path = save("a.png", floor(0.1))
    pairing = pairer.pair(shelf.read(path, {"resolution_m": 1.2}), shelf.read(path, {"resolution_m": 0.1}))
    assert pairing.verdict == "rejected"
    assert "resolution_ratio is 12, the rule wants at most 10" in pairing.reason
    assert [finding.rule for finding in pairing.ruling.findings] == ["grids", "never"]
    assert (pairing.hypotheses, pairing.merged, pairing.best) == ((), None, None)


def test_maps_of_two_places_give_hypotheses_that_are_not_accepted(bench: Bench, save: Save, floor) -> None:
    other = np.full((300, 300), 254, np.uint8)
    other[50:250, 60:64] = other[80:84, 60:280] = other[200:204, 10:200] = other[10:90, 150:153] = 0
    shelf, pairer = bench
    a = shelf.read(save("a.png", floor(0.05)), {"resolution_m": 0.05})
    pairing = pairer.pair(a, shelf.read(save("b.png", other), {"resolution_m": 0.05}))
    assert pairing.verdict in ("unmatched", "ambiguous")
    assert pairing.reason
    assert (pairing.accepted, pairing.merged) == (None, None)
    assert pairing.best is pairing.hypotheses[0]
    assert pairing.best.measurements, "what was measured of it is told all the same"


def test_maps_of_two_types_are_turned_away(with_beacons: Bench, save: Save, floor, tmp_path: Path) -> None:
    shelf, pairer = with_beacons
    line = tmp_path / "line.beacons"
    line.write_text("1\n3\n7\n")
    a, b = shelf.read(save("a.png", floor(0.1)), {"resolution_m": 0.1}), shelf.read(line, {})
    assert (b.map_type.name, b.image) == ("beacons", None)
    pairing = pairer.pair(a, b)
    assert pairing.verdict == "rejected"
    assert pairing.reason.startswith("no rule takes a map of type beacons into one of type occupancy_grid, ")


def test_any_registered_format_and_type_is_matched(with_beacons: Bench, tmp_path: Path) -> None:
    shelf, pairer = with_beacons
    for name, places in (("a", "1 3 7 12"), ("b", "101 103 107 115")):
        (tmp_path / f"{name}.beacons").write_text(places.replace(" ", "\n"))
    pairing = pairer.pair(shelf.read(tmp_path / "a.beacons", {}), shelf.read(tmp_path / "b.beacons", {}))
    assert pairing.accepted is not None
    assert pairing.accepted.match.T_receiver_donor.x_m == -100.0
    assert pairing.merged is not None
    assert pairing.merged.known() == 5
    out = tmp_path / "out"
    assert write_folder(out, pairing, pairer.workshop) == ["match.json", "merged.csv", "overlay.png"]
    assert (out / "merged.csv").read_text() == "1,2\n3,2\n7,2\n12,1\n15,1\n"
    told = json.loads((out / "match.json").read_text())
    assert (told["T_px_b2a"], told["a"]["width_px"]) == (None, None), "what has no pixels tells none"


@pytest.mark.parametrize(
    ("image", "said"),
    [
        (np.full((20, 20), 205, np.uint8), "knows nothing"),
        (np.full((20, 20), 254, np.uint8), "has no walls"),
    ],
)
def test_maps_that_cannot_be_matched_are_said(bench: Bench, save: Save, image: Image, said: str) -> None:
    with pytest.raises(MapError, match=said):
        bench[0].read(save("a.png", image), {"resolution_m": 0.05})


def test_files_that_are_no_maps_are_said(bench: Bench, save: Save, floor, tmp_path: Path) -> None:
    shelf, _ = bench
    with pytest.raises(MapError, match="there is no file"):
        shelf.read(tmp_path / "none.png", {})
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(MapError, match="is a folder: name a map file"):
        shelf.read(tmp_path / "folder.png", {})
    (tmp_path / "log.txt").write_text("FLASER")
    with pytest.raises(MapError, match="mapgraft run"):
        shelf.read(tmp_path / "log.txt", {})
    with pytest.raises(ConfigError, match=r"resolution_m: 0\.05"):
        shelf.read(save("a.png", floor(0.1)), {})


def _identity():
    from mapgraft.contracts import Transform

    return Transform.identity()
