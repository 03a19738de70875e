"""Floor plans keep the laws of plugins."""

from __future__ import annotations

from typing import ClassVar, cast

from mapgraft.contracts import GRID_MESSAGE, Fuser, MapType, Matcher, Metric
from mapgraft.plugins import load_plugins
from mapgraft.testing import MapTypeLaws, MatcherLaws, MetricLaws, Supply
from mapgraft_floorplan.conformance import (
    DrawnPlans,
    PlanOfUnknownScaleToGridLaws,
    PlanOfUnknownScaleToLinesLaws,
    PlanToGridLaws,
    PlanToLinesLaws,
    PriorsInGrids,
    PriorsInLines,
)
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.matcher import PlanCorrelation
from mapgraft_floorplan.prior_fuser import PlanPrior
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.map_type import LineSegments

PLUGINS = load_plugins()


class TestPlans(DrawnPlans):
    examples: ClassVar[int] = 5


class TestPlansFromGrids(MapTypeLaws):
    kind: ClassVar[str] = GRID_MESSAGE
    examples: ClassVar[int] = 3
    moved_share: ClassVar[float] = 0.8

    def make_map_type(self) -> MapType:
        return FloorPlanType()


class TestPlanToGrid(PlanToGridLaws):
    examples: ClassVar[int] = 5


class TestPlanOfUnknownScaleToGrid(PlanOfUnknownScaleToGridLaws):
    examples: ClassVar[int] = 2


class TestPlanToLines(PlanToLinesLaws):
    examples: ClassVar[int] = 5


class TestPlanOfUnknownScaleToLines(PlanOfUnknownScaleToLinesLaws):
    examples: ClassVar[int] = 3


class OnGrids(Supply):
    def make_map_type(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)


class TestPriorsInGrids(PriorsInGrids):
    examples: ClassVar[int] = 4


class TestPriorsInLines(PriorsInLines):
    examples: ClassVar[int] = 4


class TestGridsWithPriors(OnGrids, MapTypeLaws):
    examples: ClassVar[int] = 2

    def make_fuser(self) -> Fuser:
        return PlanPrior()


class TestLinesWithPriors(MapTypeLaws):
    examples: ClassVar[int] = 2

    def make_map_type(self) -> MapType:
        return LineSegments()

    def make_fuser(self) -> Fuser:
        return PlanPrior()


class TestMatcher(OnGrids, MatcherLaws):
    examples: ClassVar[int] = 2
    uses_prior = True

    def make_matcher(self) -> Matcher:
        return PlanCorrelation()


class OfGrids(OnGrids, MetricLaws):
    examples: ClassVar[int] = 3

    def make_metric(self) -> Metric:
        return cast("Metric", PLUGINS.make("metric", str(self.metric_name)))


class TestPlanPosterior(OfGrids):
    metric_name = "plan_posterior"


class TestPlanAgreement(OfGrids):
    metric_name = "plan_agreement"


class TestPlanDeviations(OfGrids):
    metric_name = "plan_deviations"
