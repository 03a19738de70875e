"""Line segments keep the laws of map types, matchers, fusers, metrics and conversions."""

from __future__ import annotations

from typing import ClassVar, cast

from mapgraft.contracts import Conversion, Fuser, MapType, Matcher, Metric
from mapgraft.plugins import load_plugins
from mapgraft.testing import ConversionLaws, FuserLaws, MapTypeLaws, MatcherLaws, MetricLaws, Supply
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.grid_to_lines import GridToLines
from mapgraft_lines.line_association import LineAssociation
from mapgraft_lines.lines_to_grid import LinesToGrid
from mapgraft_lines.map_type import LineSegments
from mapgraft_lines.union import LineUnion

PLUGINS = load_plugins()


class Lines(Supply):
    def make_map_type(self) -> MapType:
        return LineSegments()

    def make_fuser(self) -> Fuser:
        return LineUnion()


class TestMaps(Lines, MapTypeLaws):
    pass


class TestWeightedMaps(Lines, MapTypeLaws):
    examples: ClassVar[int] = 8

    def make_map_type(self) -> MapType:
        return LineSegments(cell_m=0.5, share_min=0.1)

    def make_fuser(self) -> Fuser:
        return LineUnion(weight=3)


class TestMatcher(Lines, MatcherLaws):
    uses_prior = True

    def make_matcher(self) -> Matcher:
        return LineAssociation()


class TestFuser(Lines, FuserLaws):
    pass


class OfLines(Lines, MetricLaws):
    def make_metric(self) -> Metric:
        return cast("Metric", PLUGINS.make("metric", str(self.metric_name)))


class TestExplained(OfLines):
    metric_name = "line_explained"


class TestContradiction(OfLines):
    metric_name = "line_contradiction"


class TestResidual(OfLines):
    metric_name = "line_residual"


class TestLinePosterior(OfLines):
    metric_name = "line_posterior"


class TestNews(OfLines):
    metric_name = "line_news"
    stream = True


class TestLinesToGrid(Lines, ConversionLaws):
    def make_target(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)

    def make_conversion(self) -> Conversion:
        return LinesToGrid()


class TestGridToLines(ConversionLaws):
    def make_map_type(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)

    def make_target(self) -> MapType:
        return LineSegments()

    def make_conversion(self) -> Conversion:
        return GridToLines()
