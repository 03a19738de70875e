"""Occupancy grids keep the laws of map types, from scans and ready-made; the other types do in tests of their own."""

from __future__ import annotations

from mapgraft.contracts import GRID_MESSAGE, Fuser, MapType
from mapgraft.testing import MapTypeLaws
from mapgraft_grid.log_odds import LogOdds
from mapgraft_grid.map_type import OccupancyGrid


class TestGridsFromScans(MapTypeLaws):
    examples = 5

    def make_map_type(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)

    def make_fuser(self) -> Fuser:
        return LogOdds()


class TestReadyMadeGrids(TestGridsFromScans):
    kind = GRID_MESSAGE
