"""Plans from files: DXF, SVG, images; and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import ezdxf
import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, MapError
from mapgraft_floorplan import dxf_file, raster_file, svg_file
from mapgraft_floorplan.drawing import svg
from mapgraft_floorplan.layer import Walls
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.plan import MOST_SEGMENTS, NOMINAL_M

Write = Callable[[str, str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(name: str, text: str) -> Path:
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def drawing(body: str, head: str = 'width="12000mm" height="8000mm" viewBox="0 0 12000 8000"') -> str:
    return f'<svg xmlns="http://www.w3.org/2000/svg" {head}>{body}</svg>'


def rows(segments: NDArray[np.float64]) -> NDArray[np.int32]:
    return Walls.of_metres(segments).rows


def test_an_svg_of_ours_reads_back(write: Write, walls: NDArray[np.float64]) -> None:
    plan = svg_file.read(write("plan.svg", svg(walls).decode()))
    assert plan.scale_known
    assert np.array_equal(rows(plan.segments_m), rows(walls))


def test_shapes_and_transforms_of_svg(write: Write) -> None:
    body = (
        '<g transform="translate(1000 0) scale(2)"><line x1="0" y1="0" x2="1000" y2="0"/></g>'
        '<polyline points="0,1000 1000,1000 1000,2000"/><polygon points="5000,5000 6000,5000 6000,6000"/>'
        '<rect x="100" y="100" width="200" height="300"/><path d="m 0 7000 h 500 v 500 z"/>'
        '<g style="display: none"><line x1="0" y1="0" x2="9" y2="9"/></g>'
        '<defs><line x1="0" y1="0" x2="9" y2="9"/></defs>'
    )
    found = svg_file.read(write("a.svg", drawing(body))).segments_m
    assert len(found) == 1 + 2 + 3 + 4 + 3
    assert found[0] == pytest.approx([1.0, 0.0, 3.0, 0.0])
    assert found[1] == pytest.approx([0.0, -1.0, 1.0, -1.0])
    assert found[-1] == pytest.approx([0.5, -7.5, 0.0, -7.0])


def test_curves_of_svg_are_followed(write: Write) -> None:
    curve = '<path d="M 0 0 A 2000 2000 0 0 1 4000 0 C 5000 0 5000 1000 6000 1000"/>'
    body = curve + '<circle cx="9000" cy="4000" r="1000"/>'
    ends = svg_file.read(write("a.svg", drawing(body))).segments_m.reshape(-1, 2)
    arc = ends[(ends[:, 0] <= 4.0) & (ends[:, 0] >= 0.0)]
    assert np.hypot(arc[:, 0] - 2.0, arc[:, 1]) == pytest.approx(2.0, abs=1e-6)
    round_ = ends[ends[:, 0] > 7.9]
    assert np.hypot(round_[:, 0] - 9.0, round_[:, 1] + 4.0) == pytest.approx(1.0)


def test_groups_of_svg_can_be_selected(write: Write) -> None:
    body = '<g id="A-WALL"><path d="M0 0H9000V5000"/></g><g id="furniture"><rect x="1" y="1" width="9" height="9"/></g>'
    path = write("a.svg", drawing(body))
    assert len(svg_file.read(path, layers=["*WALL*"]).segments_m) == 2
    with pytest.raises(MapError, match=r"no walls in groups named doors: its groups are A-WALL, furniture"):
        svg_file.read(path, layers=["doors"])


@pytest.mark.parametrize("head", ["", 'width="900" height="600"', 'width="297mm" viewBox="0 0 12000 8000"'])
def test_an_svg_without_a_believable_unit_has_no_scale(write: Write, head: str) -> None:
    path, said = write("a.svg", drawing('<path d="M0 0H9000V5000"/>', head)), []
    plan = svg_file.read(path, warn=said.append)
    assert not plan.scale_known
    assert np.ptp(plan.segments_m.reshape(-1, 2), axis=0).max() == pytest.approx(NOMINAL_M)
    assert bool(said) == ("mm" in head)
    told = svg_file.read(path, unit_m=0.001)
    assert told.scale_known
    assert np.ptp(told.segments_m.reshape(-1, 2), axis=0) == pytest.approx([9.0, 5.0])


WALL = '<path d="M0 0H9000V5000"/>'


@pytest.mark.parametrize(
    ("how", "size_m", "said"),
    [
        ("", (4.5, 2.5), "0.0005 m is taken"),
        ('preserveAspectRatio="xMinYMax slice"', (9.0, 5.0), "0.001 m is taken"),
        ('preserveAspectRatio="none"', (9.0, 2.5), "stretched along one axis"),
    ],
)
def test_a_sheet_of_other_proportions_than_its_view_box(
    write: Write, how: str, size_m: tuple[float, float], said: str
) -> None:
    head = f'width="12000mm" height="4000mm" viewBox="0 0 12000 8000" {how}'
    path, warned = write("a.svg", drawing(WALL, head)), []
    plan = svg_file.read(path, warn=warned.append)
    assert np.ptp(plan.segments_m.reshape(-1, 2), axis=0) == pytest.approx(size_m)
    assert len(warned) == 1
    assert said in warned[0]


@pytest.mark.parametrize(
    ("inner", "ends_m"),
    [
        ('x="1000" y="2000"', [1.0, -2.0, 10.0, -2.0]),
        ('x="1000" y="2000" width="900" height="900" viewBox="0 0 9000 9000"', [1.0, -2.0, 1.9, -2.0]),
        ('width="900" height="1000" viewBox="0 0 9000 5000"', [0.0, -0.25, 0.9, -0.25]),  # in the middle
        ('width="900" height="1000" viewBox="0 0 9000 5000" preserveAspectRatio="xMidYMax"', [0.0, -0.5, 0.9, -0.5]),
        (
            'width="900" height="1000" viewBox="0 0 9000 5000" preserveAspectRatio="xMinYMin slice"',
            [0.0, 0.0, 1.8, 0.0],
        ),
        ('width="900" height="1000" viewBox="0 0 9000 5000" preserveAspectRatio="none"', [0.0, 0.0, 0.9, 0.0]),
        ('width="50%" height="100%" viewBox="0 0 12000 16000" preserveAspectRatio="none"', [0.0, 0.0, 4.5, 0.0]),
        ('y="1in" viewBox="0 0 12000 8000"', [0.0, -0.096, 9.0, -0.096]),
    ],
)
def test_drawings_inside_a_drawing(write: Write, inner: str, ends_m: list[float]) -> None:
    found = svg_file.read(write("a.svg", drawing(f"<svg {inner}>{WALL}</svg>")), unit_m=0.001).segments_m
    assert found[0] == pytest.approx(ends_m)


BOMB = '<!DOCTYPE svg [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>' + drawing("<text>&b;</text>")
OUTSIDE = '<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + drawing("<text>&x;</text>")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (BOMB, "declares a document type"),
        (OUTSIDE, "declares a document type"),
        ("<html><body/></html>", "no SVG drawing: its outermost element is 'html'"),
        ("no xml at all", "is no XML"),
        (drawing(""), "has no walls"),
        (drawing("<g>" * 300 + "</g>" * 300), "elements inside each other"),
        (drawing('<path d="M 0 0 L nonsense 5"/>'), "cannot be read|has no walls"),
        (drawing('<line x1="a" x2="9"/>'), "a line in a.svg cannot be read"),
        (
            drawing('<line x1="0" x2="1e308" y2="1e308"/><line x1="-1e308" x2="5"/>'),
            "finite|walls .* m from its origin",
        ),
        (drawing(WALL, 'viewBox="0 0 5"'), "view box '0 0 5' in a.svg is no four numbers"),
        (drawing(WALL, 'viewBox="0 0 5 0"'), "has no area"),
        (drawing(f'<svg width="wide">{WALL}</svg>'), "length 'wide' in a.svg cannot be read"),
        (drawing(f'<svg viewBox="0 0 5 5">{WALL}</svg>', ""), "size nobody tells"),
        (drawing('<g transform="matrix(1,2"><line x2="9"/></g>'), "transform .* cannot be read"),
    ],
)
def test_bad_svg_is_one_sentence(write: Write, text: str, said: str) -> None:
    with np.errstate(all="ignore"), pytest.raises(MapError, match=said) as error:
        svg_file.read(write("a.svg", text), unit_m=1.0)
    assert "\n" not in str(error.value)


def test_a_million_segments_are_too_many(write: Write) -> None:
    one = "0 0 " * 60_000
    body = f'<polyline points="{one}"/>' * (MOST_SEGMENTS // 60_000 + 2)
    with pytest.raises(MapError, match="more than 1000000 pieces of wall"):
        svg_file.read(write("a.svg", drawing(body)))


def saved(path: Path, unit: int, draw: Callable[[ezdxf.document.Drawing], None]) -> Path:
    document = ezdxf.new()
    document.header["$INSUNITS"] = unit
    draw(document)
    document.saveas(path)
    return path


def test_dxf_with_blocks_layers_and_curves(tmp_path: Path) -> None:
    def draw(document: ezdxf.document.Drawing) -> None:
        space = document.modelspace()
        document.layers.add("WALLS")
        document.layers.add("TEXT")
        document.layers.add("OLD").off()
        space.add_lwpolyline([(0, 0), (12000, 0), (12000, 8000), (0, 8000)], close=True, dxfattribs={"layer": "WALLS"})
        space.add_line((0, 0), (500, 500), dxfattribs={"layer": "TEXT"})
        space.add_line((0, 0), (900, 500), dxfattribs={"layer": "OLD"})
        block = document.blocks.new("PIECE")
        block.add_line((0, 0), (1000, 0))
        space.add_blockref(
            "PIECE", (2000, 3000), dxfattribs={"layer": "WALLS", "rotation": 90, "xscale": 2, "yscale": 2}
        )
        space.add_circle((6000, 4000), 1000, dxfattribs={"layer": "WALLS"})
        space.add_arc((3000, 4000), 500, 0, 180, dxfattribs={"layer": "WALLS"})
        space.add_spline([(8000, 1000), (9000, 2000), (10000, 1000)], dxfattribs={"layer": "WALLS"})
        space.add_text("a room", dxfattribs={"layer": "TEXT"})

    path, said = saved(tmp_path / "a.dxf", 4, draw), []
    plan = dxf_file.read(path, layers=["wall*"], warn=said.append)
    assert plan.scale_known
    found = plan.segments_m
    assert found[0] == pytest.approx([0.0, 0.0, 12.0, 0.0])
    assert any(np.allclose(row, [2.0, 3.0, 2.0, 5.0]) for row in found)
    assert not any(np.allclose(row, [0.0, 0.0, 0.5, 0.5]) for row in found)
    round_ = found[np.hypot(found[:, 0] - 6.0, found[:, 1] - 4.0) < 1.01, :2]
    assert len(round_) > 8
    assert np.hypot(*(round_ - [6.0, 4.0]).T) == pytest.approx(1.0, abs=0.02)
    everything = dxf_file.read(path, warn=said.append)
    assert len(everything.segments_m) == len(found) + 1  # a layer that is off stays off
    assert any("the option layers selects some of TEXT (1), WALLS" in sentence for sentence in said)
    assert any("1 TEXT" in sentence for sentence in said)
    with pytest.raises(MapError, match=r"no walls on the layers DOORS: it has TEXT \(1\), WALLS"):
        dxf_file.read(path, layers="DOORS")


@pytest.mark.parametrize(("unit", "known", "across_m"), [(6, True, 12000.0), (5, True, 120.0), (0, False, NOMINAL_M)])
def test_units_of_dxf(tmp_path: Path, unit: int, known: bool, across_m: float) -> None:
    path = saved(tmp_path / "a.dxf", unit, lambda d: d.modelspace().add_line((0, 0), (12000, 0)))
    said: list[str] = []
    plan = dxf_file.read(path, warn=said.append)
    assert plan.scale_known == known
    assert np.ptp(plan.segments_m.reshape(-1, 2), axis=0).max() == pytest.approx(across_m)
    assert bool(said) == (unit == 6)  # twelve kilometres are not believed without a word
    assert np.ptp(dxf_file.read(path, unit_m=0.001).segments_m[:, [0, 2]]) == pytest.approx(12.0)


def test_a_block_that_holds_itself_is_refused(tmp_path: Path) -> None:
    def draw(document: ezdxf.document.Drawing) -> None:
        block = document.blocks.new("LOOP")
        block.add_line((0, 0), (1, 0))
        block.add_blockref("LOOP", (1, 1))
        document.modelspace().add_blockref("LOOP", (0, 0))

    with pytest.raises(MapError, match="blocks inside each other, or one inside itself"):
        dxf_file.read(saved(tmp_path / "a.dxf", 6, draw))


def test_blocks_that_multiply_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dxf_file, "_ENTITIES", 5_000)

    def draw(document: ezdxf.document.Drawing) -> None:
        inner = document.blocks.new("B0")
        inner.add_line((0, 0), (1, 0))
        for depth in range(1, 6):
            block = document.blocks.new(f"B{depth}")
            for n in range(10):
                block.add_blockref(f"B{depth - 1}", (n, depth))
        document.modelspace().add_blockref("B5", (0, 0))

    with pytest.raises(MapError, match="unfolds to more than 5000 entities"):
        dxf_file.read(saved(tmp_path / "a.dxf", 6, draw))


@pytest.mark.parametrize(
    "data", [b"", b"not a drawing", b"  0\nSECTION\n  2\nENTITIES\n  0\nLINE\n 10\nabc\n", bytes(900)]
)
def test_files_that_are_no_dxf(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "a.dxf"
    path.write_bytes(data)
    with pytest.raises(MapError, match=r"a\.dxf|no walls") as error:
        dxf_file.read(path)
    assert "\n" not in str(error.value)


def test_a_dxf_without_walls(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"the plan a\.dxf has no walls"):
        dxf_file.read(saved(tmp_path / "a.dxf", 6, lambda d: d.modelspace().add_text("empty")))


@pytest.mark.parametrize("unit_m", [0.0, -1.0, float("nan"), True])
def test_an_impossible_unit(write: Write, unit_m: float) -> None:
    with pytest.raises(ConfigError, match="must be above 0 m"):
        svg_file.read(write("a.svg", drawing('<path d="M0 0H9000V5000"/>')), unit_m=unit_m)


def test_raster_plans_with_and_without_a_scale(tmp_path: Path) -> None:
    image = np.full((100, 140), 255, np.uint8)
    cv2.rectangle(image, (20, 10), (119, 79), 0, 2)
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), image)
    plan = raster_file.read(path, resolution_m=0.1)
    assert plan.scale_known
    assert plan.shape_px == (100, 140)
    low, high = plan.segments_m.reshape(-1, 2).min(axis=0), plan.segments_m.reshape(-1, 2).max(axis=0)
    assert low == pytest.approx([1.9, 1.9], abs=0.11)
    assert high == pytest.approx([12.1, 9.1], abs=0.11)
    unknown = raster_file.read(path)
    assert not unknown.scale_known
    assert np.ptp(unknown.segments_m.reshape(-1, 2), axis=0).max() == pytest.approx(NOMINAL_M)
    # the pixels' frame goes along: the same corner, told in pixels, is the same place
    in_px = (unknown.segments_m.reshape(-1, 2).min(axis=0) - unknown.T_map_origin.matrix[:2, 3]) / unknown.resolution_m
    assert in_px == pytest.approx(low / 0.1, abs=0.02)


def test_a_raster_plan_without_walls(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.full((50, 50), 255, np.uint8))
    with pytest.raises(MapError, match=r"the plan a\.png has no walls"):
        raster_file.read(path)


def test_map_server_plans(tmp_path: Path) -> None:
    image = np.full((60, 60), 255, np.uint8)
    image[10:50, 20:22] = 0
    cv2.imwrite(str(tmp_path / "a.pgm"), image)
    (tmp_path / "a.plan.yaml").write_text("image: a.pgm\nresolution: 0.05\norigin: [1.0, 2.0, 0.0]\n")
    ends = raster_file.read(tmp_path / "a.plan.yaml").segments_m.reshape(-1, 2)
    assert ends.min(axis=0) == pytest.approx([2.0, 2.5], abs=0.013)  # outlines lie within a quarter of a pixel
    assert ends.max(axis=0) == pytest.approx([2.1, 4.5], abs=0.013)


@pytest.mark.parametrize("told", ["[" * 3000, '{"walls": [Infinity, 0]}', '{"walls": 5}', "{}"])
def test_bytes_whose_head_nobody_would_write_are_no_plan(told: str) -> None:
    sound = FloorPlanType().encode(FloorPlanType().new_layer())
    assert FloorPlanType().encode(FloorPlanType().decode(sound)) == sound
    form = '"format": "mapgraft-floor-plan 1", "observations": 0, "scale_known": true, "sensors": []'
    head = told.replace("}", f", {form}}}").replace("{, ", "{")
    with pytest.raises(MapError, match="this is no floor plan"):
        FloorPlanType().decode(head.encode() + b"\n")
