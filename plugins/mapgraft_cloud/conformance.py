"""How the laws of plugins are tried on what the kit cannot make or judge by itself."""

from __future__ import annotations

from typing import ClassVar

from mapgraft.contracts import CLOUD, SCAN
from mapgraft.testing import ConversionLaws, MatcherLaws
from mapgraft_cloud.gicp import Gicp
from mapgraft_cloud.grid_conversion import GridConversion, SliceConversion
from mapgraft_cloud.map_type import PointCloud
from mapgraft_grid.map_type import OccupancyGrid


class CloudToGrid(ConversionLaws):
    """Sweeps only: of a ready-made cloud of one sweep half is floor and ceiling, which no grid has."""

    kind: ClassVar[str] = CLOUD
    examples: ClassVar[int] = 3

    def make_map_type(self) -> PointCloud:
        return PointCloud()

    def make_other_source(self) -> PointCloud:
        return PointCloud(occupied=0.9)

    def make_target(self) -> OccupancyGrid:
        return OccupancyGrid()

    def make_conversion(self) -> GridConversion:
        return GridConversion()


class GridToSlice(ConversionLaws):
    """Grids, also read by somebody who wants everything to be seen twice."""

    kind: ClassVar[str] = SCAN
    examples: ClassVar[int] = 3

    def make_map_type(self) -> OccupancyGrid:
        return OccupancyGrid()

    def make_other_source(self) -> OccupancyGrid:
        return OccupancyGrid(occupied=0.8)

    def make_target(self) -> PointCloud:
        return PointCloud()

    def make_conversion(self) -> SliceConversion:
        return SliceConversion()


class GicpLaws(MatcherLaws):
    """It refines a prior, and refuses to guess one."""

    kind: ClassVar[str] = CLOUD
    examples: ClassVar[int] = 2
    uses_prior: ClassVar[bool] = True
    needs_prior: ClassVar[bool] = True

    def make_map_type(self) -> PointCloud:
        return PointCloud()

    def make_matcher(self) -> Gicp:
        return Gicp()
