"""How the laws are tried on what the kit cannot drive by itself, and where something of ours cannot keep one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from mapgraft.contracts import MapType, Matcher, Metric
from mapgraft.testing import MatcherLaws, MetricLaws
from mapgraft_grid.carpin import Carpin
from mapgraft_grid.evidence.bayes_factor import BayesFactor
from mapgraft_grid.map_type import OccupancyGrid


class CarpinLaws(MatcherLaws):
    """``carpin`` on grids of 0.1 m."""

    expected_failures: ClassVar[Mapping[str, str]] = {
        "the_best_comes_first": "hypotheses with few walls in common are returned, and are no rivals in the margin"
    }

    def make_map_type(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)

    def make_matcher(self) -> Matcher:
        return Carpin()


class BayesFactorLaws(MetricLaws):
    """``bayes_factor`` on grids of 0.1 m."""

    metric_name = "bayes_factor"
    expected_failures: ClassVar[Mapping[str, str]] = {
        "measurements_are_well_formed": "walls beside each other agree, too; its support is the cells that both know"
    }

    def make_map_type(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)

    def make_metric(self) -> Metric:
        return BayesFactor()
