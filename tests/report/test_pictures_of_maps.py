"""Maps as cells from above, and two of them held against each other."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.ndimage import binary_dilation

from mapgraft.outputs.messages import MessageEncoder
from mapgraft.outputs.report import rasters
from mapgraft.outputs.report.paintings import difference_picture, fused_picture, near
from mapgraft.outputs.report.rasters import FREE, OCCUPIED, UNKNOWN, Canvas, Raster, drawable_of, raster_of
from mapgraft.outputs.report.scenes import Look

GRID, CLOUD, MARKERS = (
    "nav_msgs/msg/OccupancyGrid",
    "sensor_msgs/msg/PointCloud2",
    "visualization_msgs/msg/MarkerArray",
)
ENCODER = MessageEncoder()
CELLS = arrays(np.uint8, (9, 7), elements=st.integers(0, 2))


def said(message_type: str, fields: dict[str, Any]) -> Any:
    """A message as a reader of the file gets it."""
    return ENCODER.decode(message_type, ENCODER.encode(message_type, fields, 0, "map"))


def grid(values: np.ndarray, yaw_rad: float = 0.0, resolution_m: float = 0.05) -> Any:
    turned = {"z": math.sin(yaw_rad / 2), "w": math.cos(yaw_rad / 2)}
    origin = {"position": {"x": 1.0, "y": -2.0}, "orientation": turned}
    info = {"resolution": resolution_m, "width": values.shape[1], "height": values.shape[0], "origin": origin}
    return said(GRID, {"info": info, "data": values.astype(np.int8).ravel()})


def test_a_grid_is_read_as_viewers_read_it() -> None:
    raster = raster_of(GRID, grid(np.array([[-1, 0, 35], [36, 64, 65], [100, -1, -1]])))
    assert raster is not None
    assert raster.cells.tolist() == [
        [UNKNOWN, FREE, FREE],
        [UNKNOWN, UNKNOWN, OCCUPIED],
        [OCCUPIED, UNKNOWN, UNKNOWN],
    ]
    assert (raster.x_m, raster.y_m, raster.cell_m) == (1.0, -2.0, 0.05)


def test_unknown_edges_are_cut_off_and_nothing_gives_nothing() -> None:
    values = np.full((8, 9), -1)
    assert raster_of(GRID, grid(values)) is None
    values[3:5, 4] = 100
    raster = raster_of(GRID, grid(values))
    assert raster is not None and raster.cells.shape == (2, 1)
    assert (raster.x_m, raster.y_m) == pytest.approx((1.2, -1.85))


@pytest.mark.parametrize(("yaw_rad", "turns"), [(math.pi / 2, 1), (math.pi, 2), (-math.pi / 2, 3)])
def test_a_grid_that_lies_askew_is_put_upright(yaw_rad: float, turns: int) -> None:
    values = np.array([[0, 0, 100], [0, 100, 0]])
    raster = raster_of(GRID, grid(values, yaw_rad))
    assert raster is not None
    upright = np.where(values == 100, OCCUPIED, FREE)
    assert raster.cells.tolist() == np.rot90(upright[::-1], turns)[::-1].tolist()


def test_points_are_seen_from_above() -> None:
    points = np.array([[0.0, 0.0, 9.0], [4.0, 2.0, 1.0], [math.nan, 0.0, 0.0]], np.float32)
    fields = [{"name": axis, "offset": 4 * n, "datatype": 7, "count": 1} for n, axis in enumerate("xyz")]
    cloud = {"height": 1, "width": 3, "fields": fields, "point_step": 12, "row_step": 36, "data": points.view(np.uint8)}
    raster = raster_of(CLOUD, said(CLOUD, cloud))
    assert raster is not None and int((raster.cells == OCCUPIED).sum()) == 2
    assert raster.bounds_m == pytest.approx((0.0, 0.0, 4.01, 2.01))
    assert raster_of(CLOUD, said(CLOUD, cloud | {"fields": fields[1:]})) is None
    assert raster_of(CLOUD, said(CLOUD, cloud | {"width": 4})) is None


def test_markers_are_seen_where_they_were_left() -> None:
    at = {"pose": {"position": {"x": 2.0, "y": 1.0}}}
    line = {"ns": "line", "points": [{"x": 0.0, "y": 0.0}, {"x": 3.0, "y": 1.0}]}
    markers = [{"ns": "old", **at}, {"action": 3}, line, {"ns": "gone", **at}, {"ns": "gone", "action": 2}]
    raster = raster_of(MARKERS, said(MARKERS, {"markers": markers}))
    assert raster is not None and int((raster.cells == OCCUPIED).sum()) == 2
    assert raster.bounds_m[0] == 0.0 and raster.bounds_m[2] == pytest.approx(3.0, abs=0.02)


def test_lines_are_drawn_as_they_run_and_cubes_of_free_space_are_free() -> None:
    ends = [{"x": 0.0, "y": 0.0}, {"x": 4.0, "y": 0.0}, {"x": 0.0, "y": 3.0}, {"x": 4.0, "y": 3.0}]
    for kind, shown in ((5, 800), (4, 1_360)):  # two lines; one more that leads from one to the other
        raster = raster_of(MARKERS, said(MARKERS, {"markers": [{"type": kind, "points": ends}]}))
        assert raster is not None and (raster.cells == OCCUPIED).sum() == pytest.approx(shown, rel=0.1)
    cube = {"type": 6, "color": {"a": 0.4}, "points": [{"x": 2.0, "y": 1.5}], "scale": {"x": 2.0, "y": 1.0}}
    turned = {"pose": {"position": {"x": 1.0}, "orientation": {"z": math.sin(0.3), "w": math.cos(0.3)}}}
    for namespace, kind in (("free", FREE), ("walls", OCCUPIED)):
        markers = [{"type": 5, "points": ends}, {**cube, "ns": namespace}]
        raster = raster_of(MARKERS, said(MARKERS, {"markers": [{**marker, **turned} for marker in markers]}))
        assert raster is not None
        lines = (raster.cells == OCCUPIED).sum() * raster.cell_m**2 if kind == FREE else 0.0
        assert lines < 0.3
        assert (raster.cells == kind).sum() * raster.cell_m**2 > 1.0
        assert raster.bounds_m[3] == pytest.approx(3.0 * math.cos(0.6) + 4.0 * math.sin(0.6), abs=0.05)


def test_what_says_most_is_drawn_and_what_has_no_picture_is_known() -> None:
    event = "mapgraft_msgs/msg/MergeEvent"
    assert drawable_of([CLOUD, event, MARKERS, GRID]) == GRID
    assert drawable_of([CLOUD, MARKERS]) == MARKERS
    assert drawable_of([event]) is None
    assert raster_of(event, SimpleNamespace()) is None


def test_a_map_that_says_how_it_looks_from_above_is_drawn_so() -> None:
    info = {"resolution": 0.5, "width": 2, "height": 1, "origin": {}}
    above = ENCODER.encode(GRID, {"info": info, "data": np.array([0, 100], np.int8)}, 0, "map")
    lines = ENCODER.encode(MARKERS, {"markers": [{"type": 5, "points": [{"x": 0.0}, {"x": 4.0}]}]}, 0, "map")
    look = Look(ENCODER, {"a": (MARKERS, lines), "b": (GRID, above)}, {"a": (MARKERS, lines)}, {})
    own, fused = look.own_raster(), look.fused_raster()
    assert own is not None and own.cells.tolist() == [[FREE, OCCUPIED]]
    assert fused is not None and (fused.cells == OCCUPIED).all()
    assert look.undrawn() == []


@given(CELLS, CELLS, st.integers(-6, 6), st.integers(-6, 6))
def test_on_one_lattice_no_cell_is_lost_or_changed(a: np.ndarray, b: np.ndarray, dx: int, dy: int) -> None:
    first, second = Raster(a, 0.3, -0.7, 0.05), Raster(b, 0.3 + 0.05 * dx, -0.7 + 0.05 * dy, 0.05)
    canvas = Canvas.around(first, second)
    assert canvas is not None
    for raster in (first, second):
        drawn = canvas.cells_of(raster)
        assert [(drawn == kind).sum() for kind in (FREE, OCCUPIED)] == [
            (raster.cells == kind).sum() for kind in (FREE, OCCUPIED)
        ]
        row = round((raster.y_m - canvas.y_m) / canvas.cell_m)
        column = round((raster.x_m - canvas.x_m) / canvas.cell_m)
        assert (drawn[row : row + 9, column : column + 7] == raster.cells).all()


@given(CELLS)
def test_walls_survive_coarser_cells(cells: np.ndarray) -> None:
    fine, coarse = Raster(cells, 0.0, 0.0, 0.05), Raster(np.ones((3, 3), np.uint8), 0.0, 0.0, 0.15)
    canvas = Canvas.around(coarse, fine)
    assert canvas is not None
    drawn = canvas.cells_of(fine)
    for row, column in np.argwhere(cells == OCCUPIED).tolist():
        at = [math.floor((0.05 * (n + 0.5) - low) / 0.15) for n, low in ((row, canvas.y_m), (column, canvas.x_m))]
        assert drawn[tuple(at)] == OCCUPIED


@given(CELLS)
def test_a_large_map_is_drawn_a_few_rows_at_a_time_as_if_at_once(cells: np.ndarray) -> None:
    fine, coarse = Raster(cells, 0.0, 0.0, 0.05), Raster(np.ones((3, 3), np.uint8), 0.0, 0.0, 0.15)
    canvas = Canvas.around(coarse, fine)
    assert canvas is not None
    with pytest.MonkeyPatch.context() as patch:
        at_once = canvas.cells_of(fine)
        patch.setattr(rasters, "_CELLS_AT_ONCE", 10)
        assert (canvas.cells_of(fine) == at_once).all()


@given(CELLS, CELLS)
def test_the_counts_of_a_difference_add_up(own: np.ndarray, donor: np.ndarray) -> None:
    picture, counted = difference_picture(own, donor, 0.1, "both")
    assert counted.joint == ((own > 0) & (donor > 0)).sum() == counted.free + counted.occupied + counted.against
    assert 0 <= counted.edge <= counted.against
    assert counted.joint_m2 == pytest.approx(counted.joint * 0.01)
    swapped = difference_picture(donor, own, 0.1, "both")[1]
    assert swapped == counted
    assert picture.uri.startswith("data:image/png;base64,")


@given(CELLS)
def test_a_map_does_not_differ_from_itself(cells: np.ndarray) -> None:
    counted = difference_picture(cells, cells, 0.1, "both")[1]
    assert counted.against == 0 and counted.percent(counted.free + counted.occupied) in ("100.0 %", "–")


@given(CELLS)
def test_nothing_is_from_others_where_the_own_map_says_the_same(cells: np.ndarray) -> None:
    assert fused_picture(cells, cells, 0.1, "a").uri == fused_picture(cells, cells.copy(), 0.1, "b").uri


@given(arrays(np.bool_, (6, 8)))
def test_near_is_what_touches(mask: np.ndarray) -> None:
    assert (near(mask) == binary_dilation(mask, np.ones((3, 3)))).all()
