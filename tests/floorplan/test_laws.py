"""Floor plans keep the laws of plugins."""

from __future__ import annotations

from typing import ClassVar, cast

import numpy as np
from hypothesis import strategies as st

from mapgraft.contracts import (
    GRID_MESSAGE,
    Conversion,
    Fuser,
    MapType,
    Matcher,
    Metric,
    Observation,
    Transform,
)
from mapgraft.plugins import load_plugins
from mapgraft.testing import ConversionLaws, FuserLaws, MapTypeLaws, MatcherLaws, MetricLaws, Supply, rooms
from mapgraft_floorplan.grid_conversion import PlanToGrid
from mapgraft_floorplan.lines_conversion import PlanToLines
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.matcher import PlanCorrelation
from mapgraft_floorplan.plan import PLAN, Plan
from mapgraft_floorplan.prior_fuser import PlanPrior
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.map_type import LineSegments

PLUGINS = load_plugins()
HERE = Transform.identity()


@st.composite
def plans(draw: st.DrawFn, scale_known: bool = True) -> Observation:
    """A drawing of a room, some of its walls left out."""
    segments = draw(rooms()).segments()
    kept = draw(st.lists(st.booleans(), min_size=len(segments), max_size=len(segments)))
    walls = segments[np.array(kept)] if any(kept) else segments
    return Observation("robot", 0, 0, "plan.svg", PLAN, Plan(walls, scale_known), HERE, HERE)


class Plans(Supply):
    def make_map_type(self) -> MapType:
        return FloorPlanType()

    def observations(self) -> st.SearchStrategy[Observation]:
        return plans()


class TestPlans(Plans, MapTypeLaws):
    examples: ClassVar[int] = 12


class TestPlansFromGrids(MapTypeLaws):
    kind: ClassVar[str] = GRID_MESSAGE
    examples: ClassVar[int] = 6
    moved_share: ClassVar[float] = 0.8

    def make_map_type(self) -> MapType:
        return FloorPlanType()


class TestPlanToGrid(Plans, ConversionLaws):
    examples: ClassVar[int] = 8

    def make_target(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)

    def make_conversion(self) -> Conversion:
        return PlanToGrid()


class TestPlansOfUnknownScaleToGrid(TestPlanToGrid):
    """Their cells are theirs, whatever the target's are."""

    examples: ClassVar[int] = 4

    def observations(self) -> st.SearchStrategy[Observation]:
        return plans(scale_known=False)


class TestPlanToLines(Plans, ConversionLaws):
    examples: ClassVar[int] = 8

    def make_target(self) -> MapType:
        return LineSegments()

    def make_conversion(self) -> Conversion:
        return PlanToLines()


class OnGrids(Supply):
    def make_map_type(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)


class TestPlanPrior(OnGrids, FuserLaws):
    examples: ClassVar[int] = 8

    def make_fuser(self) -> Fuser:
        return PlanPrior()


class TestGridsWithPriors(OnGrids, MapTypeLaws):
    examples: ClassVar[int] = 6

    def make_fuser(self) -> Fuser:
        return PlanPrior()


class TestMatcher(OnGrids, MatcherLaws):
    examples: ClassVar[int] = 5
    uses_prior = True

    def make_matcher(self) -> Matcher:
        return PlanCorrelation()


class OfGrids(OnGrids, MetricLaws):
    examples: ClassVar[int] = 6

    def make_metric(self) -> Metric:
        return cast("Metric", PLUGINS.make("metric", str(self.metric_name)))


class TestPlanPosterior(OfGrids):
    metric_name = "plan_posterior"


class TestPlanAgreement(OfGrids):
    metric_name = "plan_agreement"


class TestPlanDeviations(OfGrids):
    metric_name = "plan_deviations"
