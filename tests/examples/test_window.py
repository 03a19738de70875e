"""Maps on each other under a transform: what lies where, and how much of it both know."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.examples.pictures import DONOR, LARGEST_PX, OWN, cells_of, map_png, overlay_png, reduced
from mapgraft.examples.window import LARGEST_PX as WINDOW_PX
from mapgraft.examples.window import placed, window_of
from mapgraft.outputs.report.rasters import Canvas, Raster

BLOCK = np.ones((40, 60), np.uint8)
BLOCK[[0, 39]] = BLOCK[:, [0, 59]] = 2  # a room, 6 m × 4 m


def room(x_m: float, y_m: float, cell_m: float = 0.1) -> Raster:
    return Raster(BLOCK, x_m, y_m, cell_m)


def test_a_map_on_itself_is_itself():
    window = window_of(room(0.0, 0.0), room(0.0, 0.0), Transform.identity())
    assert np.array_equal(window.own, window.donor) and window.overlap == 1.0
    assert window.own.max() == 2 and not window.own[[0, -1]].any()  # with its surroundings


@settings(deadline=None, max_examples=20)
@given(
    x_m=st.floats(-20.0, 20.0), y_m=st.floats(-20.0, 20.0), yaw=st.floats(-3.0, 3.0), coarse=st.sampled_from([1.0, 2.5])
)
def test_where_the_donor_was_put_it_is(x_m: float, y_m: float, yaw: float, coarse: float):
    """The donor's map was made in a frame of its own: the right transform puts it on the receiver's."""
    T = Transform.planar(x_m, y_m, yaw)
    back = T.inverse()
    canvas = Canvas(-15.0 - abs(x_m) - abs(y_m), -15.0 - abs(x_m) - abs(y_m), 0.1 * coarse, 2, 2)
    n = math.ceil(2.0 * -canvas.x_m / canvas.cell_m)
    wide = Canvas(canvas.x_m, canvas.y_m, canvas.cell_m, n, n)
    donor = Raster(placed(room(0.0, 0.0), wide, back), wide.x_m, wide.y_m, wide.cell_m)
    window = window_of(room(0.0, 0.0), donor, T)
    joint = (window.own > 0) & (window.donor > 0)
    assert window.overlap > 0.9 and np.mean(window.own[joint] == window.donor[joint]) > 0.6
    free = (window.own == 1) & joint
    assert np.mean(window.donor[free] == 1) > 0.7


def test_walls_never_vanish_where_cells_are_larger():
    canvas = Canvas(-1.0, -1.0, 1.0, 8, 10)
    cells = placed(room(0.0, 0.0), canvas, Transform.identity())
    assert (cells[1, 1:7] == 2).all() and (cells[1:5, 1] == 2).all()
    assert (cells[2:4, 2:6] == 1).all() and not cells[0].any()


def test_a_scaled_map_is_larger():
    window = window_of(room(0.0, 0.0, 0.2), room(0.0, 0.0), Transform.identity(), scale=2.0)
    assert window.overlap > 0.97


def test_maps_that_share_nothing_are_shown_whole():
    window = window_of(room(0.0, 0.0), room(0.0, 0.0), Transform.planar(50.0, 0.0, 0.0))
    assert window.overlap == 0.0 and (window.own > 0).any() and (window.donor > 0).any()
    assert max(window.own.shape) <= WINDOW_PX
    assert window.fine_own.shape == tuple(2 * side for side in window.own.shape)


def test_pictures_hold_what_was_painted():
    for palette in (OWN, DONOR):
        assert np.array_equal(cells_of(map_png(BLOCK, palette)), BLOCK)
    other = np.roll(BLOCK, 7, axis=1)
    seen = cells_of(overlay_png(BLOCK, other))
    assert set(np.unique(seen)) == {1, 2, 3, 4}
    assert (seen[0] == 4).all() and (seen[5:35, 0] == 2).all() and (seen[5:35, 7] == 3).all()
    assert cells_of(overlay_png(BLOCK, np.zeros_like(BLOCK))).max() == 2


def test_large_maps_are_reduced_and_keep_their_walls():
    large = Raster(np.pad(np.full((1, 3000), 2, np.uint8), ((700, 700), (0, 0)), constant_values=1), -5.0, 2.0, 0.05)
    small = reduced(large)
    assert max(small.cells.shape) <= LARGEST_PX and small.cell_m == pytest.approx(0.3)
    assert (small.x_m, small.y_m) == (-5.0, 2.0) and ((small.cells == 2).sum(axis=0) == 1).all()
    assert reduced(room(0.0, 0.0)).cells is BLOCK
