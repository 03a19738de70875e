"""How the laws are tried on what this plugin offers: maps from scans and ready-made ones, read in more than one way."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from hypothesis import strategies as st

from mapgraft.contracts import Observation, Transform
from mapgraft.testing import ConversionLaws, MapTypeLaws, Room, planar_moves, rooms
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.grid_to_lines import GridToLines
from mapgraft_lines.lines_to_grid import LinesToGrid
from mapgraft_lines.map_type import SEGMENTS, LineSegments, SegmentMap
from mapgraft_lines.union import LineUnion

_OUTLINE = 6  # walls of a room that come first
_FREE_M = 0.25
_LOOKS = 3


class ScannedLines(MapTypeLaws):
    """Maps from scans."""

    examples: ClassVar[int] = 8

    def make_map_type(self) -> LineSegments:
        return LineSegments()

    def make_fuser(self) -> LineUnion:
        return LineUnion()


class ReadySegments(ScannedLines):
    """Ready-made maps, each in the place of the one before."""

    kind: ClassVar[str] = SEGMENTS

    def observations(self) -> st.SearchStrategy[Observation]:
        return _ready_made()


class LinesToGridLaws(ConversionLaws):
    """Line segments, also read by somebody who wants everything to be seen twice, as grids."""

    examples: ClassVar[int] = 6

    def make_map_type(self) -> LineSegments:
        return LineSegments()

    def make_other_source(self) -> LineSegments:
        return LineSegments(looks_min=2, wall_min_m=2.0)

    def make_target(self) -> OccupancyGrid:
        return OccupancyGrid(resolution_m=0.1)

    def make_conversion(self) -> LinesToGrid:
        return LinesToGrid()


class GridToLinesLaws(ConversionLaws):
    """Grids, also read by somebody who wants everything to be seen twice, as line segments."""

    examples: ClassVar[int] = 6

    def make_map_type(self) -> OccupancyGrid:
        return OccupancyGrid(resolution_m=0.1)

    def make_other_source(self) -> OccupancyGrid:
        return OccupancyGrid(resolution_m=0.1, occupied=0.8)

    def make_target(self) -> LineSegments:
        return LineSegments()

    def make_conversion(self) -> GridToLines:
        return GridToLines()


@st.composite
def _ready_made(draw: st.DrawFn) -> Observation:
    """The walls of a room, or some of them, with free space."""
    room, T = draw(rooms()), draw(planar_moves())
    payload = _told(room, draw(st.integers(1, _LOOKS)), draw(st.integers(_OUTLINE, 99)))
    return Observation("robot", 1, 1, "drawing", SEGMENTS, payload, T, Transform.identity())


def _told(room: Room, looks: int, most: int) -> SegmentMap:
    walls = room.segments()[:most].reshape(-1, 2, 2)
    at = np.mgrid[0.0 : room.wide : _FREE_M, 0.0 : room.deep : _FREE_M].reshape(2, -1).T + 0.5 * _FREE_M
    return SegmentMap(
        points_m=walls,
        sigma_m=np.full(len(walls), 0.02),
        faced=np.arange(len(walls)) < _OUTLINE,  # the outline runs about the room with its inside on the left
        looks=np.full(len(walls), looks, np.int64),
        free_m=at[room.inside(at)],
    )
