"""What scans tell: segments with their variances, and cells that were looked through."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mapgraft.contracts import ConfigError, MapError, Observation, Scan, Transform
from mapgraft_lines.extraction import SensorModel, segments_in
from mapgraft_lines.map_type import LineSegments

ROOM = np.array([[(0, 0), (6, 0)], [(6, 0), (6, 4)], [(6, 4), (0, 4)], [(0, 4), (0, 0)]], np.float64)


def test_a_room_has_four_walls_seen_from_inside(look):
    observation = look(ROOM, (2.0, 1.5, 0.7), beams=720)
    found = segments_in(observation.payload.rays(observation.T_map_sensor), SensorModel())
    assert len(found.ends) == 4
    along = found.ends[:, 2:] - found.ends[:, :2]
    to_sensor = np.array([2.0, 1.5]) - found.ends[:, :2]
    assert (along[:, 0] * to_sensor[:, 1] - along[:, 1] * to_sensor[:, 0] > 0.0).all()  # the sensor is on the left
    assert np.hypot(*along.T).sum() == pytest.approx(20.0, abs=0.5)


@pytest.mark.parametrize("noise_m", [0.01, 0.03])
def test_offsets_err_as_their_variance_says(look, noise_m):
    """A wall at a distance of 2 m, seen many times: the standardised offsets have about unit variance."""
    wall = np.array([[(-1.5, 2.0), (1.5, 2.0)]])
    model = SensorModel(range_sigma_m=noise_m, pose_sigma_m=0.0, pose_sigma_rad=0.0, across_m=0.2, split_m=0.3)
    off = []
    for seed in range(60):
        observation = look(wall, (0.0, 0.0, 0.0), noise_m=noise_m, seed=seed)
        found = segments_in(observation.payload.rays(observation.T_map_sensor), model)
        assert len(found.ends) == 1
        y0, y1 = found.ends[0, 1], found.ends[0, 3]
        v0, v1, t1, v3, t4 = found.variance[0]
        off.append((0.5 * (y0 + y1) - 2.0) / math.sqrt(v0 + v1 * t1**2 + v3 * t4**2))
    assert 0.5 < np.mean(np.square(off)) < 1.6


def test_what_is_behind_a_wall_is_not_free(look):
    kind = LineSegments()
    layer = kind.new_layer()
    kind.integrate(layer, look(ROOM, (2.0, 1.5, 0.0)))
    cells = kind.view(layer).cells
    assert cells.at(np.array([[2.1, 1.6], [4.0, 2.0]])).tolist() == [1, 1]
    assert cells.at(np.array([[-0.6, 1.0], [6.6, 2.0], [3.0, 4.6]])).tolist() == [0, 0, 0]


def test_walls_without_a_side_do_not_mix_with_those_that_have_one(look):
    """A thin wall seen from both sides is two walls, each facing its room."""
    thin = np.array([[(-2.0, 0.0), (2.0, 0.0)]])
    kind = LineSegments()
    layer = kind.new_layer()
    kind.integrate(layer, look(thin, (0.0, 1.5, 0.0)))
    kind.integrate(layer, look(thin - np.array([0.0, 0.1]), (0.0, -1.6, 0.0)))
    walls = kind.view(layer).walls
    assert len(walls) == 2 and walls.faced.all()
    assert abs(math.remainder(walls.angles_rad[0] - walls.angles_rad[1], math.tau)) == pytest.approx(math.pi, abs=0.02)


def test_the_order_of_scans_changes_nothing(look, office):
    kind = LineSegments()
    forward, backward = kind.new_layer(), kind.new_layer()
    for observation in office[:20]:
        kind.integrate(forward, observation)
    for observation in reversed(office[:20]):
        kind.integrate(backward, observation)
    assert kind.encode(forward) == kind.encode(backward)


def test_a_person_who_walks_by_is_no_wall(look):
    kind = LineSegments()
    layer = kind.new_layer()
    person = np.array([[(2.0, 2.0), (2.0, 2.6)]])
    kind.integrate(layer, look(np.concatenate((ROOM, person)), (4.5, 2.2, 0.0)))
    assert len(kind.view(layer).walls) > 4
    for _ in range(12):
        kind.integrate(layer, look(ROOM, (4.5, 2.2, 0.0)))
    walls = kind.view(layer).walls
    middle = walls.ends_m.mean(axis=1)
    assert not ((abs(middle[:, 0] - 2.0) < 0.3) & (abs(middle[:, 1] - 2.3) < 0.3)).any()


def test_poses_that_are_none_leave_the_layer_as_it_was(look, office):
    kind = LineSegments()
    layer = kind.new_layer()
    kind.integrate(layer, office[0])
    before = kind.encode(layer)
    wrong = office[1]
    for T in (Transform.planar(1e9, 0.0, 0.0), Transform(np.full((4, 4), np.nan))):
        with pytest.raises(MapError, match="check its pose"):
            kind.integrate(layer, Observation("ann", 0, 0, "scan", wrong.kind, wrong.payload, T, T))
    assert kind.encode(layer) == before


def test_a_scan_without_returns_tells_free_space_only(office):
    scan = office[0].payload
    blind = Scan(scan.directions, scan.ranges_m, np.zeros_like(scan.hits))
    kind = LineSegments(free_range_m=3.0)
    layer = kind.new_layer()
    T = Transform.planar(1.0, 2.0, 0.3)
    kind.integrate(layer, Observation("ann", 0, 0, "scan", "scan", blind, T, T))
    seen = kind.view(layer)
    assert len(seen.walls) == 0 and seen.known() > 50


def test_a_map_is_not_made_from_anything_else(office):
    kind = LineSegments()
    T = Transform.identity()
    with pytest.raises(MapError, match="choose another map type"):
        kind.integrate(kind.new_layer(), Observation("ann", 0, 0, "x", "grid_message", object(), T, T))


@pytest.mark.parametrize(
    "wrong",
    [{"cell_m": 0.01}, {"cell_m": 0.3}, {"looks_min": 0}, {"share_min": 1.5}, {"split_m": math.nan}, {"points_min": 1}],
)
def test_impossible_parameters_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        LineSegments(**wrong)
