"""Where to look to tell hypotheses apart: a corridor whose far end nobody has seen."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Match, Transform
from mapgraft.deciding import CELL_M, REACH_M, deciding_place
from mapgraft_grid.map_type import OccupancyGrid

RESOLUTION_M = 0.125
LONG = 160  # cells: 20 m
HERE = Transform.identity()


def corridor(from_m: float, to_m: float, door_m: float | None = None) -> np.ndarray:
    """Cells (-1 unknown, 0 free, 100 wall) of a corridor 2 m wide along x, known between two places.

    With a door there is a room behind its upper wall, 2 m wide and deep, there.
    """
    cells = np.full((64, LONG), -1, np.int8)
    a, b = round(from_m / RESOLUTION_M), round(to_m / RESOLUTION_M)
    cells[16:32, a:b] = 0
    cells[15, a:b] = cells[32, a:b] = 100
    if door_m is not None:
        c = round(door_m / RESOLUTION_M)
        cells[32:49, c : c + 16] = 0
        cells[49, c : c + 16] = 100
        cells[33:49, c - 1] = cells[33:49, c + 16] = 100
    return cells


@pytest.fixture(scope="module")
def seen(message_of):
    """Makes a map of cells."""
    grids = OccupancyGrid(resolution_m=RESOLUTION_M)

    def make(cells):
        layer = grids.new_layer()
        grids.integrate(layer, message_of(cells, RESOLUTION_M))
        return grids.view(layer)

    make.map_type = grids
    return make


def match(x_m: float = 0.0, y_m: float = 0.0, yaw_rad: float = 0.0) -> Match:
    return Match(Transform.planar(x_m, y_m, yaw_rad), 1.0, 1.0)


def test_it_is_where_the_door_would_be(seen):
    """The donor has seen the corridor with a door at 13 m; it may also lie 3 m farther back, with the door at 10 m."""
    own, donor = seen(corridor(0, 9)), seen(corridor(2, 20, door_m=13))
    at = Transform.planar(1.0, 3.0, 0.0)
    place = deciding_place(seen.map_type, own, donor, [match(), match(-3.0)], at)
    assert place is not None and place.has_rival
    assert 4.0 < place.x_m < 9.0 and 2.0 < place.y_m < 4.0
    assert 9.5 < place.look_x_m < 15.5 and 3.5 < place.look_y_m < 6.5
    assert place.blocks >= 3 and place.nats == pytest.approx(place.blocks * 0.8 * math.log(9), abs=1.0)
    told = place.measurement
    assert told.value == place.nats and told.findings[0].start_m == (place.x_m, place.y_m, 0.0)
    assert "would best tell the two apart" in place.sentence
    assert place.evidence["deciding_nats"] == place.nats


def test_what_is_known_already_decides_nothing(seen):
    own, donor = seen(corridor(0, 20, door_m=13)), seen(corridor(2, 20, door_m=13))
    assert deciding_place(seen.map_type, own, donor, [match(), match(-3.0)], HERE) is None


def test_what_cannot_be_seen_from_where_one_can_go_decides_nothing(seen):
    cells = corridor(0, 6)
    cells[15:33, 40:44] = 100  # a wall across, and the robot before it
    own, donor = seen(cells), seen(corridor(2, 20, door_m=13))
    at = Transform.planar(1.0, 3.0, 0.0)
    assert deciding_place(seen.map_type, own, donor, [match(), match(-3.0)], at) is None


def test_hypotheses_that_differ_by_a_cell_are_the_same(seen):
    own, donor = seen(corridor(0, 9)), seen(corridor(2, 20, door_m=13))
    place = deciding_place(seen.map_type, own, donor, [match(), match(0.1, 0.1)], HERE)
    assert place is not None and not place.has_rival  # but whether the first is right can be seen


def test_of_one_hypothesis_it_tells_whether_it_is_right(seen):
    own, donor = seen(corridor(0, 9)), seen(corridor(2, 20, door_m=13))
    place = deciding_place(seen.map_type, own, donor, [match()], None)
    assert place is not None and not place.has_rival
    assert place.look_x_m > 8.5 and place.nats == pytest.approx(place.blocks * 0.226, rel=0.1)
    assert "tell whether it is right" in place.sentence


def test_maps_that_know_nothing_tell_nothing(seen):
    empty = seen.map_type.view(seen.map_type.new_layer())
    donor = seen(corridor(2, 20, door_m=13))
    assert deciding_place(seen.map_type, empty, donor, [match()], HERE) is None
    assert deciding_place(seen.map_type, donor, empty, [match()], HERE) is None
    assert deciding_place(seen.map_type, donor, donor, [], HERE) is None


@given(st.floats(-20, 20), st.floats(-20, 20), st.integers(0, 3))
@settings(max_examples=15, deadline=None)
def test_in_which_frame_the_donor_maps_makes_no_difference(x_m, y_m, quarters):
    """The donor's cells are told in another frame, and the hypotheses with it."""
    from mapgraft.deciding import _Lattice
    from mapgraft.outputs.report.rasters import Raster

    seen_m = corridor(2, 20, door_m=13)
    classes = np.where(seen_m < 0, 0, np.where(seen_m == 0, 1, 2)).astype(np.uint8)
    lattice = _Lattice(-REACH_M, -REACH_M, CELL_M, 120, 160)
    plain = lattice.cells_of(Raster(classes, 0.0, 0.0, RESOLUTION_M), match())
    h, w = (side * RESOLUTION_M for side in classes.shape)
    cells, corner = {
        0: (classes, (0.0, 0.0)),
        1: (classes.T[::-1], (w, 0.0)),
        2: (classes[::-1, ::-1], (w, h)),
        3: (classes.T[:, ::-1], (0.0, h)),
    }[quarters]
    turned, T = Raster(cells, 0.0, 0.0, RESOLUTION_M), Transform.planar(*corner, math.pi / 2 * quarters)
    again = lattice.cells_of(turned, match(T.x_m, T.y_m, T.yaw_rad))
    assert (again == plain).mean() > 0.98
    shifted = lattice.cells_of(Raster(classes, x_m, y_m, RESOLUTION_M), match(-x_m, -y_m))
    assert (shifted == plain).mean() > 0.98


def test_it_is_the_same_every_time(seen):
    own, donor = seen(corridor(0, 9)), seen(corridor(2, 20, door_m=13))
    made = [deciding_place(seen.map_type, own, donor, [match(), match(-3.0)], HERE) for _ in range(3)]
    assert made[0] == made[1] == made[2]
