"""Drives with a spinning lidar: the same every time, and what it sees is where it stands."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapgraft.contracts import Cloud
from mapgraft_recordings.buildings import building, record
from mapgraft_recordings.buildings.cloud_messages import cloud_messages, first_place
from mapgraft_recordings.buildings.spatial import (
    Heights,
    SpinningLidar,
    cast_rings,
    outlines_of,
    record_spatial,
    spatial_observations,
)


@pytest.fixture(scope="module")
def made():
    return record_spatial(building(4), 0, 12)


def test_a_drive_is_the_same_every_time_and_longer_ones_begin_alike(made):
    again, longer = record_spatial(building(4), 0, 12), record_spatial(building(4), 0, 15)
    for other in (again, longer):
        for a, b in zip(made.sweeps, other.sweeps, strict=False):
            assert a.pose == b.pose
            assert a.points_m.tobytes() == b.points_m.tobytes()
    assert np.array_equal(made.believed, again.believed)


def test_it_goes_the_way_that_the_planar_lidar_goes(made):
    planar = record(building(4), 0, 12)
    assert [sweep.pose for sweep in made.sweeps] == [sighting.pose for sighting in planar.sightings]


def test_rings_meet_what_is_high_enough_and_the_floor_and_the_ceiling():
    walls = np.array([[2.0, -1.0, 2.0, 1.0], [5.0, -1.0, 5.0, 1.0]])  # a low thing before a wall
    slopes = np.array([-0.5, -0.1, 0.0, 0.3, 1.0])
    met = cast_rings(0.0, 0.0, 1.0, np.array([[1.0, 0.0]]), slopes, walls, np.array([0.9, 3.0]), 3.0)[:, 0]
    assert met.tolist() == pytest.approx([2.0, 2.0, 5.0, 5.0, 2.0])
    met = cast_rings(0.0, 0.0, 1.0, np.array([[-1.0, 0.0]]), slopes, walls, np.array([0.9, 3.0]), 3.0)[:, 0]
    assert met.tolist() == pytest.approx([2.0, 10.0, math.inf, 2.0 / 0.3, 2.0])


def test_points_lie_between_floor_and_ceiling_and_near_something(made):
    house = building(4)
    ceiling_m = Heights.of(house).ceiling_m
    for sweep in made.sweeps:
        z = sweep.points_m[:, :, 2][np.isfinite(sweep.points_m[:, :, 2])] + made.lidar.height_m
        assert z.min() > -0.1
        assert z.max() < ceiling_m + 0.1
        assert np.abs(z).min() < 0.05  # some lie on the floor


def test_heights_are_those_of_walls_doors_and_things():
    house = building(4)
    heights = Heights.of(house)
    tops = heights.tops(house.solid)
    assert (tops[: heights.walls] == heights.ceiling_m).all()
    assert (tops[heights.walls :] < 2.0).all()
    assert outlines_of(np.array([[0, 0, 1, 0], [1, 0, 0, 0], [5, 5, 6, 5]], float)).tolist() == [0, 0, 1]


def test_observations_leave_out_what_did_not_come_back(made):
    observations = spatial_observations(made)
    for observation, sweep in zip(observations, made.sweeps, strict=True):
        assert isinstance(observation.payload, Cloud)
        total = len(observation.payload.points_m) + observation.payload.dropped
        assert total == sweep.points_m.shape[0] * sweep.points_m.shape[1]
        assert observation.T_map_sensor.z_m == made.lidar.height_m


def test_messages_are_organised_and_begin_where_the_map_does(made):
    messages = list(cloud_messages(made, "ada", first_place(made)))
    assert [message.topic for message in messages[:3]] == ["/tf_static", "/tf", "/ada/points"]
    fields = messages[2].fields
    assert (fields["height"], fields["width"], fields["is_dense"]) == (16, 360, False)
    assert len(fields["data"]) == 16 * 360 * 20
    first = messages[1].fields["transforms"][0]["transform"]
    assert first["translation"]["x"] == pytest.approx(0.0, abs=1e-9)
    assert first["rotation"]["w"] == pytest.approx(1.0)


def test_a_lidar_of_other_rings():
    lidar = SpinningLidar(rings=4, columns=90)
    assert record_spatial(building(4), 0, 2, lidar).sweeps[0].points_m.shape == (4, 90, 3)
