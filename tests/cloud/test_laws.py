"""The laws of plugins, on everything that mapgraft_cloud offers."""

from __future__ import annotations

from typing import ClassVar

import pytest

from mapgraft.contracts import CLOUD, CLOUD_MAP
from mapgraft.testing import FuserLaws, MapTypeLaws, MatcherLaws, MetricLaws
from mapgraft_cloud.conformance import CloudToGrid, GicpLaws, GridToSlice
from mapgraft_cloud.evidence import CloudContradiction, CloudOverlap
from mapgraft_cloud.kiss import Kiss
from mapgraft_cloud.map_type import PointCloud
from mapgraft_cloud.voxels import Voxels


class TestPointCloud(MapTypeLaws):
    kind: ClassVar[str] = CLOUD
    examples: ClassVar[int] = 3

    def make_map_type(self) -> PointCloud:
        return PointCloud()

    def make_fuser(self) -> Voxels:
        return Voxels()


class TestReadyMadePointCloud(MapTypeLaws):
    kind: ClassVar[str] = CLOUD_MAP
    examples: ClassVar[int] = 2

    def make_map_type(self) -> PointCloud:
        return PointCloud()

    def make_fuser(self) -> Voxels:
        return Voxels()


class TestWeighedVoxelsOfAnotherSize(MapTypeLaws):
    kind: ClassVar[str] = CLOUD
    examples: ClassVar[int] = 2

    def make_map_type(self) -> PointCloud:
        return PointCloud(resolution_m=0.15, l_hit=0.7, l_miss=-0.3)

    def make_donor_map_type(self) -> PointCloud:
        return PointCloud(resolution_m=0.1)

    def make_fuser(self) -> Voxels:
        return Voxels(weight=2)


class TestVoxels(FuserLaws):
    kind: ClassVar[str] = CLOUD
    examples: ClassVar[int] = 2

    def make_map_type(self) -> PointCloud:
        return PointCloud()

    def make_fuser(self) -> Voxels:
        return Voxels()


class TestCloudOverlap(MetricLaws):
    kind: ClassVar[str] = CLOUD
    metric_name: ClassVar[str | None] = "cloud_overlap"
    examples: ClassVar[int] = 3

    def make_map_type(self) -> PointCloud:
        return PointCloud()

    def make_metric(self) -> CloudOverlap:
        return CloudOverlap()


class TestCloudContradiction(MetricLaws):
    kind: ClassVar[str] = CLOUD
    metric_name: ClassVar[str | None] = "cloud_contradiction"
    examples: ClassVar[int] = 2

    def make_map_type(self) -> PointCloud:
        return PointCloud()

    def make_metric(self) -> CloudContradiction:
        return CloudContradiction()


class TestCloudToGrid(CloudToGrid):
    """As ``mapgraft plugins check`` tries them."""


class TestGridToSlice(GridToSlice):
    """As ``mapgraft plugins check`` tries them."""


class TestKiss(MatcherLaws):
    kind: ClassVar[str] = CLOUD
    examples: ClassVar[int] = 1
    uses_prior: ClassVar[bool] = True

    @pytest.fixture(autouse=True)
    def _installed(self) -> None:
        pytest.importorskip("kiss_matcher", reason="needs the extra cloud")
        pytest.importorskip("small_gicp", reason="needs the extra cloud")

    def make_map_type(self) -> PointCloud:
        return PointCloud()

    def make_matcher(self) -> Kiss:
        return Kiss()


class TestGicp(GicpLaws):
    """As ``mapgraft plugins check`` tries them."""

    @pytest.fixture(autouse=True)
    def _installed(self) -> None:
        pytest.importorskip("small_gicp", reason="needs the extra cloud")
