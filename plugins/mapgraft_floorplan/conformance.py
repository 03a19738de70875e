"""How the laws are tried on what this plugin offers: plans of known and unknown scale, as grids, lines and priors."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from hypothesis import strategies as st

from mapgraft.contracts import Observation, Transform
from mapgraft.testing import ConversionLaws, FuserLaws, MapTypeLaws, rooms
from mapgraft_floorplan.grid_conversion import PlanToGrid
from mapgraft_floorplan.lines_conversion import PlanToLines
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.plan import PLAN, Plan
from mapgraft_floorplan.prior_fuser import PlanPrior
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.map_type import LineSegments

_HERE = Transform.identity()


@st.composite
def plans(draw: st.DrawFn, scale_known: bool = True) -> Observation:
    """A drawing of a room, some of its walls left out."""
    segments = draw(rooms()).segments()
    kept = draw(st.lists(st.booleans(), min_size=len(segments), max_size=len(segments)))
    walls = segments[np.array(kept)] if any(kept) else segments
    return Observation("robot", 0, 0, "plan.svg", PLAN, Plan(walls, scale_known), _HERE, _HERE)


class DrawnPlans(MapTypeLaws):
    """Plans from files."""

    examples: ClassVar[int] = 8

    def make_map_type(self) -> FloorPlanType:
        return FloorPlanType()

    def observations(self) -> st.SearchStrategy[Observation]:
        return plans()


class PlanToGridLaws(ConversionLaws):
    """Plans as grids."""

    examples: ClassVar[int] = 6

    def make_map_type(self) -> FloorPlanType:
        return FloorPlanType()

    def observations(self) -> st.SearchStrategy[Observation]:
        return plans()

    def make_target(self) -> OccupancyGrid:
        return OccupancyGrid(resolution_m=0.1)

    def make_conversion(self) -> PlanToGrid:
        return PlanToGrid()


class PlanOfUnknownScaleToGridLaws(PlanToGridLaws):
    """Plans of unknown scale: their cells are theirs, whatever the target's are."""

    examples: ClassVar[int] = 4

    def observations(self) -> st.SearchStrategy[Observation]:
        return plans(scale_known=False)


class PlanToLinesLaws(ConversionLaws):
    """Plans as line segments."""

    examples: ClassVar[int] = 6

    def make_map_type(self) -> FloorPlanType:
        return FloorPlanType()

    def observations(self) -> st.SearchStrategy[Observation]:
        return plans()

    def make_target(self) -> LineSegments:
        return LineSegments()

    def make_conversion(self) -> PlanToLines:
        return PlanToLines()


class PlanOfUnknownScaleToLinesLaws(PlanToLinesLaws):
    """Plans of unknown scale as line segments: their cells are theirs, too."""

    examples: ClassVar[int] = 4

    def observations(self) -> st.SearchStrategy[Observation]:
        return plans(scale_known=False)


class PriorsInGrids(FuserLaws):
    """A prior in a grid."""

    examples: ClassVar[int] = 5

    def make_map_type(self) -> OccupancyGrid:
        return OccupancyGrid(resolution_m=0.1)

    def make_fuser(self) -> PlanPrior:
        return PlanPrior()


class PriorsInLines(FuserLaws):
    """A prior among line segments."""

    examples: ClassVar[int] = 5

    def make_map_type(self) -> LineSegments:
        return LineSegments()

    def make_fuser(self) -> PlanPrior:
        return PlanPrior()
