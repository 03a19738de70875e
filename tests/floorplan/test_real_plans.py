"""Real maps against real plans: known and unknown scale."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mapgraft
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
SIMULATED = Transform.planar(1.0247, 1.2827, math.radians(0.159))  # of robot 2; the maps of all three share a frame


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
    for n in (1, 2, 3):
        shift_m, turn_rad = SIMULATED.difference(arena[f"m_three_robots_sim_robot{n}.png"])
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


PLAN = {"mrl_arena": {"options": {"format": "plan_image"}}}


def laid(result: mapgraft.Result) -> dict[str, Transform]:
    """``T_plan_robot`` of the robots that have taken in the plan."""
    standing = result.standing.values()
    return {e.receiver: e.T_receiver_donor.inverse() for e in standing if e.donor == "mrl_arena" and e.T_receiver_donor}


@pytest.mark.slow
def test_three_robots_take_in_the_plan_while_they_map(shared_data: Path) -> None:
    bags = [shared_data / "bags/three_robots_sim" / f"robot{n}.bag" for n in (1, 2, 3)]
    found = laid(mapgraft.run([*bags, shared_data / "floorplans/mrl_arena.yaml"], {"robots": PLAN}))
    assert sorted(found) == ["robot1", "robot2", "robot3"]
    for T_plan_robot in found.values():  # the maps of all three share a frame
        shift_m, turn_rad = SIMULATED.difference(T_plan_robot)
        assert shift_m < RIGHT_M
        assert turn_rad < RIGHT_RAD


@pytest.mark.slow
def test_two_real_robots_take_in_the_plan_while_they_map(shared_data: Path) -> None:
    folder = shared_data / "bags/arena"
    robots = {f"arena_raw_{n}": {"poses": {"file": str(folder / f"arena_gmapping_{n}.bag")}} for n in (1, 2)}
    files = [folder / "arena_raw_1.bag", folder / "arena_raw_2.bag", shared_data / "floorplans/mrl_arena.yaml"]
    found = laid(mapgraft.run(files, {"robots": robots | PLAN}))
    assert sorted(found) == ["arena_raw_1", "arena_raw_2"]
    pairs = json.loads((shared_data / "maps/grid_pairs/pairs.json").read_text())
    sides = {"a": "m_arena_gmapping_1.png", "b": "m_arena_gmapping_2.png"}
    told = next(p["T_m_b2a"] for p in pairs if all(p[side] == name for side, name in sides.items()))
    T_1_2 = Transform.planar(told["x"], told["y"], math.radians(told["yaw_deg"]))
    shift_m, turn_rad = T_1_2.difference(found["arena_raw_1"].inverse() @ found["arena_raw_2"])
    assert shift_m < RIGHT_M
    assert turn_rad < RIGHT_RAD


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3])
def test_an_image_of_the_plan_tells_its_scale_by_the_map(shared_data: Path, number: int) -> None:
    """The image alone, without the 0.01 m of its pixels: the same place, and the scale."""
    described = {}
    for pair in json.loads((shared_data / "maps/grid_pairs/pairs.json").read_text()):
        described |= {pair[side]: (pair[f"res_{side}"], pair[f"origin_{side}"]) for side in "ab"}
    name = f"m_three_robots_sim_robot{number}.png"
    message = image_map.read(
        shared_data / "maps/grid_pairs" / name, resolution_m=described[name][0], origin=described[name][1]
    )
    grid, robot = seen(message)
    image = raster_file.read(shared_data / "floorplans/mrl_arena.pgm")
    best = PlanCorrelation(scale="unknown").match(robot, on_grid(grid, image))[0]
    assert best.scale * image.resolution_m == pytest.approx(0.01, rel=0.02)
    middle = np.array([[5.0, 5.0]])  # of the arena, in metres of the plan
    in_image = image.T_map_origin.apply(middle / 0.01 * image.resolution_m)
    there = best.T_receiver_donor.apply(best.scale * in_image)
    assert np.hypot(*(there - SIMULATED.inverse().apply(middle)).T)[0] < RIGHT_M


LAYOUTS = [(place, n) for place in ("HIH", "KPT4A") for n in (1, 2, 3, 4)]
RIGHT_PX = 15.0  # 0.4 m: the keypoints and the best similarity leave 6 to 10


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
    assert math.sqrt(float((off**2).sum(axis=1).mean())) < RIGHT_PX
    assert best.margin > 0.5 * best.score
