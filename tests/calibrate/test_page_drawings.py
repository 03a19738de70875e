"""How the drawings of a calibration's page name what they show, for however many groups there are."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from mapgraft.calibrate import Labelled
from mapgraft.calibrate.groups import Group
from mapgraft.cli import invoke

ROOM = 318.0  # between the ends of the axis, in drawing units
LETTER = 5.5


@pytest.fixture
def drawing(
    group: Callable[..., Group],
    made: Callable[..., list[Labelled]],
    write_folder: Callable[..., Path],
    tmp_path: Path,
) -> Callable[..., str]:
    """The drawing of the thresholds by resolution for as many groups as asked for, the last one with few labels."""

    def draw(groups: int) -> str:
        scales = [0.025 * (n + 1) for n in range(groups)]
        counts = [200] * (groups - 1) + [12]
        some = [made("a", count, n, of=group(0.05, m)) for n, (count, m) in enumerate(zip(counts, scales, strict=True))]
        folder, out = write_folder("a", [example for examples in some for example in examples]), tmp_path / "out"
        assert invoke(["calibrate", str(folder), "-o", str(out), "--false-accept", "0.02"]) == 0
        page = (out / "report.html").read_text("utf-8")
        return page[page.index("<h3>Thresholds by resolution") :].partition("</figure>")[0]

    return draw


@pytest.mark.parametrize("groups", [2, 5, 9])
def test_names_below_the_axis_do_not_run_into_each_other(drawing: Callable[..., str], groups: int) -> None:
    found = drawing(groups)
    names = re.findall(r"<text [^>]*>(0\.05 ← [\d.]+)</text>", found)
    assert len(names) == groups
    aslant = found.count("rotate(-40)")
    assert aslant == (groups if max(map(len, names)) * LETTER * groups > ROOM else 0)
    assert float(re.findall(r'viewBox="0 0 380.0 ([\d.]+)"', found)[0]) >= 264.0 + (40.0 if aslant else 0.0)


def test_a_threshold_of_a_coarser_group_is_as_grey_as_the_caption_says(drawing: Callable[..., str]) -> None:
    found = drawing(3)
    assert "grey: of a coarser one" in found
    assert re.search(r'<g class="dot plain"><title>[^<]*labels of a coarser group</title>', found)
    style = (Path(__file__).parents[2] / "pipeline/mapgraft/pages/templates/calibration.html").read_text("utf-8")
    assert ".dot.plain circle { fill: var(--muted); }" in style
