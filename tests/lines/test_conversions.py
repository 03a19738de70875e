"""Line segments as grids, grids as line segments: walls and free space stay where they are, and counts survive."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mapgraft.contracts import MapError, Transform
from mapgraft_grid.cells import cells_at, cells_of, window_of
from mapgraft_grid.grid_map import FREE, OCCUPIED
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.grid_to_lines import GridToLines
from mapgraft_lines.lines_to_grid import LinesToGrid
from mapgraft_lines.map_type import LineSegments
from mapgraft_lines.segments import from_segments

ROOM = np.array([[(0, 0), (6, 0)], [(6, 0), (6, 4)], [(6, 4), (0, 4)], [(0, 4), (0, 0)]], np.float64)
LINES = LineSegments()


def mapped(kind, observations):
    layer = kind.new_layer()
    for observation in observations:
        kind.integrate(layer, observation)
    return layer


def share_near(points, others, within_m):
    return float(np.mean(cKDTree(others).query(points)[0] <= within_m))


@pytest.mark.parametrize("resolution_m", [0.05, 0.1])
def test_a_drive_is_the_same_place_as_grid_and_as_lines(office, resolution_m):
    grids = OccupancyGrid(resolution_m=resolution_m)
    lines, grid = mapped(LINES, office[:80]), mapped(grids, office[:80])
    drawn, traced = LinesToGrid().convert(lines, LINES, grids), GridToLines().convert(grid, grids, LINES)
    walls, cells = LINES.structure(LINES.view(lines)), grids.structure(grids.view(grid))
    assert share_near(LINES.structure(LINES.view(traced)), cells, 1.5 * resolution_m) > 0.95
    assert share_near(grids.structure(grids.view(drawn)), walls, 1.5 * resolution_m + 0.05) > 0.95
    assert share_near(walls, LINES.structure(LINES.view(traced)), 0.25) > 0.75
    assert share_near(walls, grids.structure(grids.view(drawn)), 1.5 * resolution_m + 0.05) > 0.95
    ours, theirs = grids.view(drawn).dense(), grids.view(grid)
    height, width = ours.classes.shape
    same = theirs.dense_over(ours.origin_cell, (height, width)).classes
    both = (ours.classes == FREE) & (same != 0)
    assert np.mean(same[both] == FREE) > 0.97  # what lines say is free, is


def test_traced_walls_face_where_the_grid_is_free(look):
    grids = OccupancyGrid(resolution_m=0.05)
    grid = mapped(grids, [look(ROOM, (2.0 + 0.1 * k, 1.5, 0.2 * k), beams=720) for k in range(5)])
    walls = LINES.view(GridToLines().convert(grid, grids, LINES)).walls
    long = walls.lengths_m > 2.0
    assert long.sum() == 4 and walls.faced[long].all()
    along = walls.ends_m[:, 1] - walls.ends_m[:, 0]
    inside = np.array([3.0, 2.0]) - walls.ends_m[:, 0]
    assert (along[:, 0] * inside[:, 1] - along[:, 1] * inside[:, 0] > 0.0)[long].all()


def test_counts_survive(look):
    grids = OccupancyGrid(resolution_m=0.1)
    scans = [look(ROOM, (2.0, 1.5, 0.0)) for _ in range(7)]
    drawn = LinesToGrid().convert(mapped(LINES, scans), LINES, grids)
    assert cells_of(drawn)[1].max(axis=0).tolist() == [7, 7]
    traced = GridToLines().convert(mapped(grids, scans), grids, LINES)
    assert traced.own.pieces.counts[:, 0].max() == 7
    assert traced.own.space.counts.max() == 7


def test_a_plan_has_walls_and_no_free_space():
    grids = OccupancyGrid(resolution_m=0.05)
    drawn = grids.view(LinesToGrid().convert(from_segments(LINES, ROOM, looks=5), LINES, grids)).dense()
    assert (drawn.classes == OCCUPIED).sum() > 300
    assert not (drawn.classes == FREE).any()


def test_a_turned_map_converts_to_a_turned_grid(office):
    grids = OccupancyGrid(resolution_m=0.1)
    lines, T = mapped(LINES, office[:50]), Transform.planar(3.0, -2.0, 0.7)
    straight = grids.structure(grids.view(LinesToGrid().convert(lines, LINES, grids)))
    turned = grids.structure(grids.view(LinesToGrid().convert(LINES.place(lines, T), LINES, grids)))
    assert share_near(T.apply(straight), turned, 0.2) > 0.97


def test_grids_are_read_as_the_robot_that_mapped_them_does(look):
    """A wall that was seen twice is none for a robot that asks for more, and its free space takes many looks."""
    careful, quick = OccupancyGrid(occupied=0.95), OccupancyGrid(free=0.4)
    grid = mapped(quick, [look(ROOM, (2.0, 1.5, 0.1 * k), beams=720) for k in range(2)])
    assert LINES.view(GridToLines().convert(grid, quick, LINES)).walls.lengths_m.sum() > 15.0
    assert len(GridToLines().convert(grid, careful, LINES).own.pieces) == 0
    assert len(GridToLines().convert(grid, quick, LINES).own.space) > 100
    assert len(GridToLines().convert(grid, careful, LINES).own.space) == 0


def test_lines_are_read_as_the_robot_that_mapped_them_does(look):
    """Where a robot takes a wall for gone, what was looked through counts, but not where it takes it for standing."""
    grids, lasting = OccupancyGrid(resolution_m=0.1), LineSegments(share_min=0.0)
    beams = np.stack(np.meshgrid(np.arange(0.1, 6.0, 0.2), np.arange(-0.3, 4.0, 0.2)), axis=-1).reshape(-1, 2)
    gone = from_segments(LINES, ROOM[:1], looks=1, free_m=beams, free_looks=20)
    on_wall = np.column_stack((np.arange(0.2, 5.8, 0.1), np.full(56, 0.05)))
    told = {}
    for name, kind in (("gone", LINES), ("standing", lasting)):
        drawn = LinesToGrid().convert(gone, kind, grids)
        cells = cells_at(on_wall, drawn.lattice)
        counts = window_of(drawn, (0, 0), (1, 60))[:, cells[:, 1], cells[:, 0]]
        told[name] = np.unique(counts, axis=1).tolist()
    assert told == {"gone": [[0], [20]], "standing": [[1], [0]]}


def test_too_large_a_grid_is_refused_in_one_sentence():
    lines = from_segments(LINES, ROOM * 400.0)
    with pytest.raises(MapError, match="take a coarser one"):
        LinesToGrid().convert(lines, LINES, OccupancyGrid(resolution_m=0.001))
    far = from_segments(LINES, ROOM + 9e5)
    with pytest.raises(MapError, match="coarser"):
        LinesToGrid().convert(far, LINES, OccupancyGrid(resolution_m=0.0005))


def test_other_types_are_refused():
    grids = OccupancyGrid()
    for conversion, layer, target in (
        (LinesToGrid(), LINES.new_layer(), LINES),
        (LinesToGrid(), grids.new_layer(), grids),
        (GridToLines(), grids.new_layer(), grids),
        (GridToLines(), LINES.new_layer(), LINES),
    ):
        with pytest.raises(MapError):
            conversion.convert(layer, LINES if isinstance(conversion, LinesToGrid) else grids, target)
    for conversion, layer, source, target in (
        (LinesToGrid(), LINES.new_layer(), grids, grids),
        (GridToLines(), grids.new_layer(), LINES, LINES),
    ):
        with pytest.raises(MapError, match="read as"):
            conversion.convert(layer, source, target)


def test_nothing_converts_to_nothing():
    grids = OccupancyGrid()
    assert grids.view(LinesToGrid().convert(LINES.new_layer(), LINES, grids)).is_empty
    assert LINES.view(GridToLines().convert(grids.new_layer(), grids, LINES)).known() == 0


def test_round_things_are_no_walls(look):
    turn = np.linspace(0.0, 2.0 * math.pi, 40)
    ring = np.column_stack((np.cos(turn), np.sin(turn))) * 0.25 + (2.0, 0.0)
    post = np.stack((ring[:-1], ring[1:]), axis=1)
    grids = OccupancyGrid(resolution_m=0.05)
    grid = mapped(grids, [look(post, (4.0 * math.cos(k), 3.0 * math.sin(k), 0.0), beams=720) for k in range(8)])
    assert LINES.view(GridToLines().convert(grid, grids, LINES)).walls.lengths_m.sum() < 1.0
