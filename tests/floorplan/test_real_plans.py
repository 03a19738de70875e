"""Real maps against real plans: known and unknown scale."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mapgraft.contracts import GridMessage, Observation, Transform
from mapgraft.matching.pixels import frame_of, in_pixels, moved, planar
from mapgraft_floorplan import raster_file
from mapgraft_floorplan.grid_conversion import PlanToGrid
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.matcher import PlanCorrelation
from mapgraft_floorplan.plan import Plan
from mapgraft_grid import image_map
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.map_type import OccupancyGrid

HERE = Transform.identity()
RIGHT_M, RIGHT_RAD = 0.15, math.radians(3.0)


def seen(message: GridMessage) -> tuple[OccupancyGrid, GridMap]:
    grid = OccupancyGrid(resolution_m=message.resolution_m)
    layer = grid.new_layer()
    grid.integrate(layer, Observation("robot", 0, 0, "map", "grid_message", message, HERE, HERE))
    return grid, grid.view(layer)


def on_grid(grid: OccupancyGrid, plan: Plan) -> GridMap:
    layer = PlanLayer(Walls.of_metres(plan.segments_m), scale_known=plan.scale_known)
    return grid.view(PlanToGrid().convert(layer, FloorPlanType(), grid))


@pytest.fixture(scope="module")
def arena(shared_data: Path) -> dict[str, Transform]:
    """``T_plan_robot`` of maps of one arena, by map."""
    folder = shared_data / "maps" / "grid_pairs"
    plan = raster_file.read(shared_data / "floorplans" / "mrl_arena.yaml")
    described: dict[str, tuple[float, Any]] = {}
    for pair in json.loads((folder / "pairs.json").read_text()):
        for side in "ab":
            described[pair[side]] = pair[f"res_{side}"], pair[f"origin_{side}"]
    found = {}
    wanted = [f"m_three_robots_sim_robot{n}.png" for n in (1, 2, 3)]
    for name in (*wanted, "m_arena_gmapping_1.png", "m_arena_gmapping_2.png", "m_arena_karto_2.png"):
        resolution_m, origin = described[name]
        grid, robot = seen(image_map.read(folder / name, resolution_m=resolution_m, origin=origin))
        best = PlanCorrelation().match(robot, on_grid(grid, plan))[0]
        assert best.margin > 0.5 * best.score
        found[name] = best.T_receiver_donor.inverse()
    return found


@pytest.mark.slow
def test_simulated_robots_lie_on_the_plan_they_drove_in(arena: dict[str, Transform]) -> None:
    truth = Transform.planar(1.0247, 1.2827, math.radians(0.159))  # of robot 2; the maps of all three share a frame
    for n in (1, 2, 3):
        shift_m, turn_rad = truth.difference(arena[f"m_three_robots_sim_robot{n}.png"])
        assert shift_m < RIGHT_M
        assert turn_rad < RIGHT_RAD


@pytest.mark.slow
def test_real_robots_on_the_plan_agree_with_each_other(shared_data: Path, arena: dict[str, Transform]) -> None:
    """Each was matched to the plan by itself; how the maps lie to each other is known independently."""
    known = {
        (p["a"], p["b"]): p["T_m_b2a"] for p in json.loads((shared_data / "maps/grid_pairs/pairs.json").read_text())
    }
    for a, b in (("gmapping_1", "gmapping_2"), ("gmapping_2", "karto_2")):
        told = known[f"m_arena_{a}.png", f"m_arena_{b}.png"]
        T_a_b = Transform.planar(told["x"], told["y"], math.radians(told["yaw_deg"]))
        found = arena[f"m_arena_{a}.png"].inverse() @ arena[f"m_arena_{b}.png"]
        shift_m, turn_rad = T_a_b.difference(found)
        assert shift_m < RIGHT_M
        assert turn_rad < RIGHT_RAD


SECOND = pytest.mark.xfail(reason="the right place comes second, by 27 nats of 1105: the verdict is not a merge")
LAYOUTS = [
    pytest.param(place, n, marks=SECOND) if (place, n) == ("KPT4A", 3) else (place, n)
    for place in ("HIH", "KPT4A")
    for n in (1, 2, 3, 4)
]


@pytest.mark.slow
@pytest.mark.parametrize(("place", "number"), LAYOUTS)
def test_flats_against_their_layouts_of_unknown_scale(shared_data: Path, place: str, number: int) -> None:
    folder = shared_data / "maps" / "halmstad"
    pairs = {pair["id"]: pair for pair in json.loads((folder / "pairs.json").read_text())}
    pair = pairs[f"{place}_0{number}__{place}_layout"]
    message, plan = image_map.read(folder / pair["a"], resolution_m=0.025), raster_file.read(folder / pair["b"])
    assert not plan.scale_known
    grid, robot = seen(message)
    best = PlanCorrelation(scale="unknown").match(robot, on_grid(grid, plan))[0]
    frames = frame_of(message), frame_of(plan)
    assert frames[0] is not None
    assert frames[1] is not None
    T_px = in_pixels(frames[0], frames[1], planar(best.T_receiver_donor, best.scale))
    off = moved(T_px, np.array(pair["keypoints_b"])) - np.array(pair["keypoints_a"])
    assert math.sqrt(float((off**2).sum(axis=1).mean())) < 40.0
