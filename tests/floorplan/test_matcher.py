"""Finding a plan's place, its scale included."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, EmptyMapError, Prior, Transform
from mapgraft_floorplan.grid_conversion import PlanToGrid
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.matcher import PlanCorrelation
from mapgraft_floorplan.scaled import PlanGrid
from mapgraft_floorplan.search import rotations
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.prepared import prepare


def plan_map(walls: NDArray[np.float64], turn_deg: float, scale: float, known: bool) -> tuple[GridMap, Transform]:
    """The plan turned and stretched, and where a stretched plan lies in the robot's map."""
    T = Transform.planar(3.0, -2.0, math.radians(turn_deg))
    ends = T.inverse().apply(walls.reshape(-1, 2)) / scale
    layer = PlanLayer(Walls.of_metres(ends.reshape(-1, 4)), scale_known=known)
    grid = OccupancyGrid()
    return grid.view(PlanToGrid().convert(layer, FloorPlanType(), grid)), T


@pytest.mark.parametrize("turn_deg", [0.0, 137.0, -60.0])
def test_a_plan_of_known_scale(walls: NDArray[np.float64], robot_map: GridMap, turn_deg: float) -> None:
    source, T = plan_map(walls, turn_deg, 1.0, True)
    found = PlanCorrelation().match(robot_map, source)
    shift_m, turn_rad = found[0].T_receiver_donor.difference(T)
    assert shift_m < 0.1
    assert turn_rad < math.radians(0.6)
    assert found[0].scale == 1.0
    assert len(found) >= 2
    assert found[0].margin == pytest.approx(found[0].score - found[1].score)
    assert found[0].evidence["lead"] == pytest.approx(found[0].margin / found[0].score)
    assert found[1].evidence["lead"] == pytest.approx(max(-1.0, -found[0].margin / abs(found[1].score)))
    assert found[0].evidence["common_m"] > 15.0


@pytest.mark.parametrize(("turn_deg", "scale"), [(25.0, 0.31), (190.0, 1.0), (-75.0, 1.9)])
def test_a_plan_of_unknown_scale(walls: NDArray[np.float64], robot_map: GridMap, turn_deg: float, scale: float) -> None:
    source, T = plan_map(walls, turn_deg, scale, False)
    best = PlanCorrelation(scale="unknown").match(robot_map, source)[0]
    assert best.scale == pytest.approx(scale, rel=0.01)
    ends = walls.reshape(-1, 2)
    placed = best.T_receiver_donor.apply(best.scale * T.inverse().apply(ends) / scale)
    assert np.hypot(*(placed - ends).T).mean() < 0.1
    assert 0.0 < best.evidence["sigma_scale"] < 0.05
    assert best.covariance is not None
    assert np.linalg.eigvalsh(best.covariance[np.ix_([0, 1, 5], [0, 1, 5])]).min() > 0.0


def test_each_of_many_plans_is_turned_by_its_own_walls(walls: NDArray[np.float64], robot_map: GridMap) -> None:
    """What is kept of one plan never serves another that came to lie in its memory."""
    robot = prepare(robot_map, 0.1)
    sources = [plan_map(walls, turn_deg, 1.0, True)[0] for turn_deg in (5.0, 30.0, 52.0)]
    for _ in range(5):
        for turn_deg, source in zip((5.0, 30.0, 52.0), sources, strict=True):
            plan = PlanGrid.of(source)
            found = rotations(robot, plan)
            del plan
            assert any(abs(math.degrees(yaw) - turn_deg) < 2.0 for yaw in found)


def test_furniture_and_missing_walls_change_nothing(walls: NDArray[np.float64], robot_map: GridMap) -> None:
    crowded = np.vstack((walls[[0, 1, 2, 3, 4, 5, 6, 8, 9]], [[1, 1, 2, 1], [2, 1, 2, 2]]))
    source, T = plan_map(crowded, 70.0, 1.0, True)
    shift_m, turn_rad = PlanCorrelation().match(robot_map, source)[0].T_receiver_donor.difference(T)
    assert shift_m < 0.15
    assert turn_rad < math.radians(1.0)


def test_a_prior_restricts_the_search_and_tells_its_score(walls: NDArray[np.float64], robot_map: GridMap) -> None:
    source, T = plan_map(walls, 10.0, 1.0, True)
    sure = np.diag([0.04, 0.04, 0.0, 0.0, 0.0, 0.01])
    best = PlanCorrelation().match(robot_map, source, Prior(T, sure, "a person"))[0]
    assert best.T_receiver_donor.difference(T)[0] < 0.1
    assert best.score >= best.evidence["prior_score"] > 0.0
    assert "lead" not in best.evidence  # a search around a prior knows no rivals elsewhere
    assert -1.0 <= best.evidence["lead_here"] <= 1.0
    elsewhere = Prior(T @ Transform.planar(60.0, 60.0, 2.0), sure, "a person")
    assert not PlanCorrelation().match(robot_map, source, elsewhere)


def test_a_prior_gates_plans_of_unknown_scale(walls: NDArray[np.float64], robot_map: GridMap) -> None:
    """Where a plan's origin lies and how it is turned can be known while nobody knows its scale."""
    source, T = plan_map(walls, 25.0, 0.31, False)
    sure = np.diag([0.04, 0.04, 0.0, 0.0, 0.0, 0.0004])
    matcher = PlanCorrelation(scale="unknown")
    best = matcher.match(robot_map, source, Prior(T, sure, "a person"))[0]
    assert best.scale == pytest.approx(0.31, rel=0.01)
    assert best.T_receiver_donor.difference(T)[0] < 0.2
    turned = Prior(T @ Transform.planar(0.0, 0.0, math.pi / 2), sure, "a person")
    for match in matcher.match(robot_map, source, turned):
        shift_m, turn_rad = match.T_receiver_donor.difference(turned.T_receiver_donor)
        assert shift_m < 2.0  # 3.5 sigmas, and what the fit moves
        assert turn_rad < 0.3


def test_equal_maps_give_equal_matches(walls: NDArray[np.float64], robot_map: GridMap) -> None:
    source, _ = plan_map(walls, 33.0, 0.7, False)
    one, other = (PlanCorrelation(scale="unknown").match(robot_map, source) for _ in range(2))
    assert [(m.T_receiver_donor, m.scale, m.score) for m in one] == [
        (m.T_receiver_donor, m.scale, m.score) for m in other
    ]


def test_maps_without_walls_are_refused(robot_map: GridMap) -> None:
    empty = OccupancyGrid().view(None)
    with pytest.raises(EmptyMapError):
        PlanCorrelation().match(robot_map, empty)
    with pytest.raises(EmptyMapError):
        PlanCorrelation().match(empty, robot_map)


@pytest.mark.parametrize("scale", ["maybe", [1.0], [2.0, 1.0], [0.0, 1.0], 3])
def test_impossible_scales_are_refused(scale: object) -> None:
    with pytest.raises(ConfigError, match="scale"):
        PlanCorrelation(scale=scale)
