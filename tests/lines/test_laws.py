"""Line segments keep the laws of map types, matchers, fusers, metrics and conversions."""

from __future__ import annotations

from typing import ClassVar, cast

from hypothesis.strategies import SearchStrategy

from mapgraft.contracts import Fuser, MapType, Matcher, Metric, Observation
from mapgraft.plugins import load_plugins
from mapgraft.testing import FuserLaws, MapTypeLaws, MatcherLaws, MetricLaws, Supply
from mapgraft_lines.conformance import GridToLinesLaws, LinesToGridLaws, ReadySegments, ScannedLines
from mapgraft_lines.line_association import LineAssociation
from mapgraft_lines.map_type import SEGMENTS, LineSegments
from mapgraft_lines.union import LineUnion

PLUGINS = load_plugins()


class Lines(Supply):
    def make_map_type(self) -> MapType:
        return LineSegments()

    def make_fuser(self) -> Fuser:
        return LineUnion()


class TestScannedMaps(ScannedLines):
    examples: ClassVar[int] = 5


class TestReadyMaps(ReadySegments):
    examples: ClassVar[int] = 4


class TestWeightedMaps(Lines, MapTypeLaws):
    examples: ClassVar[int] = 4

    def make_map_type(self) -> MapType:
        return LineSegments(cell_m=0.5, share_min=0.1)

    def make_fuser(self) -> Fuser:
        return LineUnion(weight=3)


class TestMatcher(Lines, MatcherLaws):
    examples: ClassVar[int] = 5
    uses_prior = True

    def make_matcher(self) -> Matcher:
        return LineAssociation()


class TestFuser(Lines, FuserLaws):
    examples: ClassVar[int] = 6


class TestFuserOfReadyMaps(Lines, FuserLaws):
    kind = SEGMENTS
    examples: ClassVar[int] = 4

    def observations(self) -> SearchStrategy[Observation] | None:
        return ReadySegments().observations()


class OfLines(Lines, MetricLaws):
    examples: ClassVar[int] = 4

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
    examples: ClassVar[int] = 10  # of fewer it hears nothing
    metric_name = "line_news"
    stream = True


class TestLinesToGrid(LinesToGridLaws):
    pass


class TestReadyLinesToGrid(LinesToGridLaws):
    kind = SEGMENTS
    examples: ClassVar[int] = 4

    def observations(self) -> SearchStrategy[Observation] | None:
        return ReadySegments().observations()


class TestGridToLines(GridToLinesLaws):
    pass
