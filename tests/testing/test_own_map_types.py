"""The map types that come with mapgraft keep the laws."""

from __future__ import annotations

from mapgraft.contracts import GRID_MESSAGE, Fuser, MapType
from mapgraft.testing import MapTypeLaws
from mapgraft_grid.log_odds import LogOdds
from mapgraft_grid.map_type import OccupancyGrid


class TestGridsFromScans(MapTypeLaws):
    examples = 12

    def make_map_type(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)

    def make_fuser(self) -> Fuser:
        return LogOdds()


class TestReadyMadeGrids(TestGridsFromScans):
    kind = GRID_MESSAGE
