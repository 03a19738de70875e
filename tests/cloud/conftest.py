"""Clouds to map: little rooms in three dimensions, and simulated drives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mapgraft.contracts import CLOUD, CLOUD_MAP, Cloud, Observation, Transform
from mapgraft_cloud.cloud_map import CloudMap
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.map_type import PointCloud
from mapgraft_recordings.buildings import building
from mapgraft_recordings.buildings.spatial import record_spatial, spatial_observations

Observe = Callable[..., Observation]


@pytest.fixture
def observe() -> Observe:
    """Makes an observation of points (n, 3); ``seen_from`` None makes a ready-made map of them."""

    def make(
        points: object,
        T: Transform | None = None,
        seen_from: tuple[float, float, float] | None = (0.0, 0.0, 0.0),
        ready: bool = False,
    ) -> Observation:
        cloud = Cloud(np.asarray(points, np.float32).reshape(-1, 3), origin_m=seen_from)
        pose = T or Transform.identity()
        return Observation("r", 1, 1, "lidar", CLOUD_MAP if ready else CLOUD, cloud, pose, pose)

    return make


@pytest.fixture(scope="session")
def drives() -> tuple[CloudLayer, CloudLayer]:
    """The layers of two drives through one castle, in one frame."""
    layers = []
    for drive in (0, 1):
        kind = PointCloud()
        layer = kind.new_layer()
        for observation in spatial_observations(record_spatial(building(2), drive, 40)):
            kind.integrate(layer, observation)
        layers.append(layer)
    return layers[0], layers[1]


@pytest.fixture(scope="session")
def maps(drives: tuple[CloudLayer, CloudLayer]) -> tuple[CloudMap, CloudMap]:
    kind = PointCloud()
    return kind.view(drives[0]), kind.view(drives[1])
