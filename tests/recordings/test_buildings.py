"""Random buildings: the same for a seed, different for others, drivable, and seen as they stand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from mapgraft.config import parse_config
from mapgraft.contracts import ConfigError, Observation, Scan
from mapgraft.recording.mission import open_mission
from mapgraft_recordings.buildings import KINDS, Building, Drive, building, drive, observations, record
from mapgraft_recordings.buildings.__main__ import main
from mapgraft_recordings.buildings.building import first_visit, next_visit, standing
from mapgraft_recordings.buildings.driving import streams
from mapgraft_recordings.buildings.openings import doorways
from mapgraft_recordings.buildings.tiling import Cell, borders
from mapgraft_recordings.buildings.traits import draw_traits
from mapgraft_recordings.simulator import cast_rays, distance_to_walls

SCANS = 40


@pytest.fixture(scope="module", params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def driven(kind: str) -> list[tuple[Building, Drive]]:
    houses = [building(seed, kind) for seed in range(2)]
    return [(house, record(house, 1, SCANS)) for house in houses]


def scans_of(found: list[Observation]) -> list[Scan]:
    return [o.payload for o in found if isinstance(o.payload, Scan)]


def test_a_seed_makes_one_building_and_one_drive(kind: str) -> None:
    one, two = building(5, kind), building(5, kind)
    assert one.traits == two.traits
    assert np.array_equal(one.solid, two.solid)
    assert np.array_equal(one.glass, two.glass)
    first, second = drive(one, 2, 20), drive(two, 2, 20)
    for a, b in zip(scans_of(first), scans_of(second), strict=True):
        assert np.array_equal(a.ranges_m, b.ranges_m, equal_nan=True)
    assert [a.T_map_base for a in first] == [b.T_map_base for b in second]
    assert [a.stamp_ns for a in first] == [b.stamp_ns for b in second]


def test_other_seeds_make_other_buildings_and_drives(kind: str) -> None:
    shapes = {building(seed, kind).solid.tobytes() for seed in range(6)}
    assert len(shapes) == 6
    house = building(0, kind)
    assert record(house, 0, 5).poses.tobytes() != record(house, 1, 5).poses.tobytes()


def test_the_seed_alone_goes_through_the_kinds() -> None:
    assert [building(seed).kind for seed in range(len(KINDS))] == list(KINDS)
    assert building(7).solid.tobytes() == building(7, KINDS[1]).solid.tobytes()


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ConfigError, match="castle"):
        building(0, "cathedral")


def test_robots_drive_through_rooms_and_touch_nothing(driven: list[tuple[Building, Drive]]) -> None:
    for house, made in driven:
        assert len(made.sightings) == SCANS
        obstacles = np.vstack((house.solid, house.glass))
        assert distance_to_walls(made.poses[:, :2], obstacles).min() > 0.08


def test_robots_get_about(kind: str) -> None:
    """Most of the way is driven, not turned on the spot, and it leads through more than one room."""
    made = record(building(1, kind), 0, 200)
    assert np.hypot(*np.diff(made.poses[:, :2], axis=0).T).sum() > 40.0
    assert np.ptp(made.poses[:, :2], axis=0).max() > 8.0


def test_scans_come_as_often_as_those_of_real_robots(driven: list[tuple[Building, Drive]]) -> None:
    for _, made in driven:
        moved = np.hypot(*np.diff(made.poses[:, :2], axis=0).T)
        turned = np.abs(np.angle(np.exp(1j * np.diff(made.poses[:, 2]))))
        assert moved.max() < 1.3
        assert np.degrees(turned.max()) < 60.0
        assert np.all((moved > 0.28) | (np.degrees(turned) > 11.0))
        assert np.all(np.diff([sighting.stamp_ns for sighting in made.sightings]) > 0)


def test_what_is_seen_from_true_poses_stands_there(kind: str) -> None:
    """In a building where nothing moves, nearly all ends of beams lie on walls, things and panes."""
    house = next(
        house
        for house in (building(seed, kind) for seed in range(200))
        if not house.traits.changes and not house.traits.people
    )
    made = record(house, 1, SCANS)
    visit = first_visit(house, streams(house, 1).world)
    outlines = np.vstack((standing(house, visit), house.glass))
    off = []
    for scan, (x, y, yaw) in zip(scans_of(observations(made)), made.poses.tolist(), strict=True):
        c, s = math.cos(yaw), math.sin(yaw)
        ends = scan.directions[scan.hits] * scan.ranges_m[scan.hits, None].astype(np.float64)
        off.append(distance_to_walls(ends @ np.array([[c, s], [-s, c]]) + (x, y), outlines))
    assert len(np.concatenate(off)) > 40 * SCANS
    assert (np.concatenate(off) < 0.1).mean() > 0.93


def test_poses_err_by_centimetres(driven: list[tuple[Building, Drive]]) -> None:
    for _, made in driven:
        error = made.believed - made.poses
        assert 0.001 < np.hypot(error[:, 0], error[:, 1]).mean() < 0.2
        assert 0.0 < np.degrees(np.abs(error[:, 2]).mean()) < 2.0


def test_doors_that_lead_on_are_never_closed() -> None:
    for seed in range(12):
        house = building(seed)
        visit = first_visit(house, np.random.default_rng(0))
        assert all(angle > 0.0 for leaf, angle in zip(house.leaves, visit.opened_rad, strict=True) if leaf.vital)


def test_doors_join_all_cells() -> None:
    cells = [Cell(4.0 * k, 4.0 * j, 4.0 * k + 4.0, 4.0 * j + 4.0, 3 * j + k + 1) for j in range(3) for k in range(3)]
    walls = borders(cells)
    rng = np.random.default_rng(3)
    group = {cell.space: cell.space for cell in cells}
    for door in doorways(cells, walls, draw_traits("castle", rng), rng):
        wall = walls[door.border]
        assert wall.low_m < door.low_m < door.high_m < wall.high_m
        a, b = group[cells[wall.before].space], group[cells[wall.after].space]
        group = {space: a if root == b else root for space, root in group.items()}
    assert len(set(group.values())) == 1


def test_borders_surround_every_cell() -> None:
    cells = [Cell(0, 0, 4, 3, 1), Cell(4, 0, 9, 5, 2), Cell(0, 3, 4, 5, 2)]
    walls = borders(cells)
    for i, cell in enumerate(cells):
        own = sum(wall.length_m for wall in walls if i in (wall.before, wall.after))
        joint = 2.0 if cell.space == 2 else 0.0  # the two cells of space 2 share an edge without a wall
        assert own == pytest.approx(2 * (cell.width_m + cell.depth_m) - joint)


def test_buildings_that_change_move_things_and_doors() -> None:
    house = next(house for house in map(building, range(100)) if house.loose and house.leaves)
    rng = np.random.default_rng(0)
    before = first_visit(house, rng)
    after = next_visit(house, before, 1.0, rng)
    moved = [np.abs(a - b).max() for a, b in zip(before.loose, after.loose, strict=True)]
    assert max(moved) > 0.1
    assert before.opened_rad != after.opened_rad
    assert next_visit(house, before, 0.0, rng).opened_rad == before.opened_rad


def test_walls_cannot_be_looked_through(kind: str) -> None:
    """Every beam from inside a building without glass meets something."""
    house = next(house for house in (building(seed, kind) for seed in range(1, 50)) if not len(house.glass))
    solid = standing(house, first_visit(house, np.random.default_rng(0)))
    made = record(house, 0, 3)
    bearing = np.linspace(-math.pi, math.pi, 720)
    for x, y, _ in made.poses.tolist():
        origins = np.tile([x, y], (len(bearing), 1))
        directions = np.stack((np.cos(bearing), np.sin(bearing)), axis=1)
        assert np.isfinite(cast_rays(origins, directions, solid, 500.0)).all()


def test_the_log_is_read_as_it_was_driven(tmp_path: Path) -> None:
    path = tmp_path / "office.log.gz"
    assert main(["--seed", "3", "--kind", "office", "--scans", "25", "-o", str(path)]) == 0
    again = tmp_path / "again.log.gz"
    main(["--seed", "3", "--kind", "office", "--scans", "25", "-o", str(again)])
    assert path.read_bytes() == again.read_bytes()
    with open_mission([path], parse_config({})) as mission:
        (robot,) = mission.robots
        read = list(mission.observations())
    assert robot.drift == "corrected"
    made = drive(building(3, "office"), 0, 25)
    for mine, theirs in zip(scans_of(made), scans_of(read), strict=True):
        assert np.allclose(mine.directions, theirs.directions, atol=1e-6)
        assert np.allclose(mine.ranges_m, theirs.ranges_m, atol=0.006, equal_nan=True)
        valid = ~np.isnan(mine.ranges_m)
        assert np.array_equal(mine.hits[valid], theirs.hits[valid])
    for a, b in zip(made, read, strict=True):
        assert np.allclose(a.T_map_sensor.matrix, b.T_map_sensor.matrix, atol=1e-5)
        assert abs(a.stamp_ns - b.stamp_ns) < 2_000


def test_an_impossible_place_to_write_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        main(["--scans", "2", "-o", str(tmp_path / "nowhere" / "x.log.gz")])
