"""The plugin keeps the laws of mapgraft's conformance kit."""

from __future__ import annotations

from mapgraft_landmarks.agreement import LandmarkAgreement
from mapgraft_landmarks.constellation import Constellation
from mapgraft_landmarks.grid_conversion import GridConversion
from mapgraft_landmarks.map_type import PointLandmarks
from mapgraft_landmarks.union import LandmarkUnion

from mapgraft.contracts import Conversion, Fuser, MapType, Matcher, Metric
from mapgraft.testing import (
    ConversionLaws,
    FuserLaws,
    MapTypeLaws,
    MatcherLaws,
    MetricLaws,
    PluginLaws,
    Supply,
)
from mapgraft_grid.map_type import OccupancyGrid


class Landmarks(Supply):
    examples = 8

    def make_map_type(self) -> MapType:
        return PointLandmarks(sightings_min=1)

    def make_fuser(self) -> Fuser:
        return LandmarkUnion(weight=2)


class TestPlugin(PluginLaws):
    module = "mapgraft_landmarks"


class TestMapType(Landmarks, MapTypeLaws):
    pass


class TestMatcher(Landmarks, MatcherLaws):
    def make_matcher(self) -> Matcher:
        return Constellation(looks_min=2)


class TestFuser(Landmarks, FuserLaws):
    pass


class TestMetric(Landmarks, MetricLaws):
    metric_name = "landmark_agreement"

    def make_metric(self) -> Metric:
        return LandmarkAgreement(looks_min=1, support_min=1)


class TestConversion(Landmarks, ConversionLaws):
    def make_conversion(self) -> Conversion:
        return GridConversion()

    def make_target(self) -> MapType:
        return OccupancyGrid(resolution_m=0.1)
