"""The picture of two maps on each other."""

from __future__ import annotations

import warnings

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Points
from mapgraft.matching.overlay import BOTH, COLOURS, FREE, LARGEST_PX, OURS, THEIRS, UNKNOWN, paint, png
from mapgraft.matching.placing import Sketch

NONE = np.empty((0, 2))


def grid(*corners: tuple[float, float, float, float], cell_m: float = 0.1) -> Points:
    """The centres of the cells in some rectangles (x0, y0, x1, y1)."""
    parts = []
    for x0, y0, x1, y1 in corners:
        x, y = np.meshgrid(np.arange(x0 + cell_m / 2, x1, cell_m), np.arange(y0 + cell_m / 2, y1, cell_m))
        parts.append(np.column_stack((x.ravel(), y.ravel())))
    return np.concatenate(parts)


def test_every_kind_of_cell_has_its_colour() -> None:
    ours = Sketch(grid((0, 0, 5, 0.1)), grid((0, 0.1, 5, 1)), 0.1)
    theirs = Sketch(grid((0, 0, 2, 0.1), (0, 2, 2, 2.1)), grid((0, 1, 1, 2)), 0.1)
    picture, canvas = paint(ours, theirs)

    def at(x: float, y: float) -> int:
        rows, columns = canvas.cells(np.array([(x, y)]))
        return int(picture[rows[0], columns[0]])

    assert canvas.side_m == pytest.approx(0.1)
    assert at(1.05, 0.05) == BOTH
    assert at(4.05, 0.05) == OURS
    assert at(1.05, 2.05) == THEIRS
    assert at(4.05, 0.55) == FREE
    assert at(0.55, 1.55) == FREE
    assert at(4.05, 1.55) == UNKNOWN
    assert (picture == OURS).sum() == 29, "one cell beyond theirs still agrees"


def test_walls_within_a_cell_of_the_coarser_map_agree() -> None:
    fine, wall = Sketch(grid((0, 0, 2, 0.02), cell_m=0.01), NONE, 0.01), grid((0, 0.04, 2, 0.05), cell_m=0.01)
    picture, _ = paint(fine, Sketch(wall, NONE, 0.01))
    assert set(np.unique(picture)) == {UNKNOWN, OURS, THEIRS}
    picture, _ = paint(fine, Sketch(wall, NONE, 0.05))
    assert set(np.unique(picture)) == {UNKNOWN, BOTH}


@settings(deadline=None, max_examples=20)
@given(
    st.lists(st.tuples(st.floats(-300, 300), st.floats(-300, 300)), min_size=1, max_size=30),
    st.lists(st.tuples(st.floats(-300, 300), st.floats(-300, 300)), min_size=1, max_size=30),
    st.sampled_from([0.01, 0.05, 1.0, None]),
)
def test_every_wall_shows_however_large_the_maps(ours, theirs, cell_m) -> None:
    picture, canvas = paint(Sketch(np.array(ours), NONE, cell_m), Sketch(np.array(theirs), NONE, None))
    assert max(picture.shape) <= LARGEST_PX + 3
    for points in (ours, theirs):
        rows, columns = canvas.cells(np.array(points))
        assert (np.isin(picture[rows, columns], (OURS, THEIRS, BOTH))).all()
        centres = np.column_stack((columns, rows)) * canvas.side_m + (canvas.x_m, canvas.y_m) + canvas.side_m / 2
        assert abs(centres - np.array(points)).max() <= canvas.side_m / 2 + 1e-6


def test_the_png_shows_the_picture_pixel_by_pixel_under_any_name() -> None:
    picture, canvas = paint(
        Sketch(grid((0, 0, 5, 0.1)), grid((0, 0.1, 5, 4)), 0.1), Sketch(grid((0, 2, 2, 2.1)), NONE, 0.1)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        data = png(picture, canvas, "verdict: $x_1", ("a" * 80, "Büro_階_$1"))
    assert data == png(picture, canvas, "verdict: $x_1", ("a" * 80, "Büro_階_$1"))
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert max(image.shape) >= 900
    for kind in (UNKNOWN, OURS, THEIRS, FREE):
        colour = np.round(COLOURS[kind][::-1] * 255)
        share = (abs(image - colour) <= 1).all(axis=2).mean()
        assert share > 0.002, kind
