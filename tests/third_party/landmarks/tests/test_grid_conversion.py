"""Landmarks as occupancy grids: counts survive."""

from __future__ import annotations

import numpy as np
import pytest
from mapgraft_landmarks.cells import keys_at
from mapgraft_landmarks.grid_conversion import GridConversion
from mapgraft_landmarks.layer import LandmarkLayer
from mapgraft_landmarks.map_type import PointLandmarks

from mapgraft.contracts import MapError, Observation, Transform
from mapgraft_grid.cells import HITS, cells_of
from mapgraft_grid.map_type import OccupancyGrid

TwoWalks = tuple[list[Observation], list[Observation], Transform]
TYPE = PointLandmarks()
RESOLUTIONS_M = [0.05, 0.07, 0.25, 0.4]


@pytest.fixture(scope="module")
def layer(two_walks: TwoWalks) -> LandmarkLayer:
    layer = TYPE.new_layer()
    for observation in two_walks[0][:30]:
        TYPE.integrate(layer, observation)
    return layer


@pytest.mark.parametrize("resolution_m", RESOLUTIONS_M)
def test_every_sighting_of_what_stands_is_a_hit(layer: LandmarkLayer, resolution_m: float) -> None:
    target = OccupancyGrid(resolution_m=resolution_m)
    grid = GridConversion().convert(layer, TYPE, target)
    hits = cells_of(grid)[1][:, HITS]
    assert hits.sum() == TYPE.view(layer).landmarks.sightings.sum() > 100
    assert target.metadata(grid).observations == 30


@pytest.mark.parametrize("resolution_m", RESOLUTIONS_M)
def test_what_was_looked_at_is_free_and_the_rest_unknown(layer: LandmarkLayer, resolution_m: float) -> None:
    target = OccupancyGrid(resolution_m=resolution_m)
    view = target.view(GridConversion().convert(layer, TYPE, target)).dense()
    h, w = view.classes.shape
    x, y = np.meshgrid(np.arange(w) + 0.5, np.arange(h) + 0.5)
    centres = np.stack((x, y), axis=-1).reshape(-1, 2) * resolution_m + view.origin_m
    looks = layer.cells.at(keys_at(centres, layer.cell_m))[:, 0].reshape(h, w)
    occupied = view.classes == 2
    assert 5 <= occupied.sum() <= 80
    assert (view.classes[(looks >= 4) & ~occupied] == 1).mean() > 0.99
    assert (view.classes[(looks == 0) & ~occupied] == 0).all()


def test_landmarks_are_occupied_cells(layer: LandmarkLayer) -> None:
    target = OccupancyGrid(resolution_m=0.05)
    view = target.view(GridConversion().convert(layer, TYPE, target)).dense()
    strong = TYPE.view(layer).landmarks.strongest(5).positions_m
    rows, columns = np.nonzero(view.classes == 2)
    centres = np.stack((columns + 0.5, rows + 0.5), axis=1) * 0.05 + view.origin_m
    nearest = np.hypot(*(strong[:, None] - centres[None]).transpose(2, 0, 1)).min(axis=1)
    assert nearest.max() < 0.1


def test_an_empty_layer_becomes_an_empty_grid() -> None:
    target = OccupancyGrid()
    assert target.view(GridConversion().convert(TYPE.new_layer(), TYPE, target)).known() == 0


def test_converting_is_repeatable(layer: LandmarkLayer) -> None:
    target = OccupancyGrid(resolution_m=0.07)
    once, again = (target.encode(GridConversion().convert(layer, TYPE, target)) for _ in range(2))
    assert once == again


def test_another_target_is_refused(layer: LandmarkLayer) -> None:
    with pytest.raises(MapError, match="found the target point_landmarks"):
        GridConversion().convert(layer, TYPE, TYPE)
