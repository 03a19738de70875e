"""Height bands: measured from the floor where the robot was, unmoved by what is seen elsewhere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mapgraft.contracts import (
    CLOUD,
    Cloud,
    Contribution,
    Conversion,
    Layer,
    MapError,
    MapType,
    Observation,
    Provenance,
    Transform,
)
from mapgraft.testing import examine, laws_of
from mapgraft_cloud.conformance import CloudToGrid
from mapgraft_cloud.floors import Floors, lowest_slab
from mapgraft_cloud.grid_conversion import GridConversion
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.map_type import PointCloud
from mapgraft_grid.cells import cells_of
from mapgraft_grid.map_type import OccupancyGrid

Observe = Callable[..., Observation]


def wall(x: float, low: float, high: float, across: float = 0.0) -> np.ndarray:
    """A wall of a metre along y at an x, in the map frame."""
    return np.array([[x, across + y, z] for y in np.arange(0.05, 1, 0.1) for z in np.arange(low + 0.05, high, 0.1)])


def sweep(points: np.ndarray, sensor: tuple[float, float, float], base_z: float | None = None) -> Observation:
    """A sweep of points in the map frame from a sensor; its robot's base is ``base_z`` high, else the sensor itself."""
    pose = Transform.from_quaternion(sensor, (0.0, 0.0, 0.0, 1.0))
    base = pose if base_z is None else Transform.from_quaternion((*sensor[:2], base_z), (0.0, 0.0, 0.0, 1.0))
    return Observation("r", 1, 1, "lidar", CLOUD, Cloud((points - sensor).astype(np.float32)), pose, base)


def grid_of(layer: CloudLayer, kind: PointCloud | None = None) -> dict[tuple[int, int], tuple[int, int]]:
    """The cells of 0.1 m that the layer becomes, and their hits and misses."""
    made = GridConversion().convert(layer, kind or PointCloud(), OccupancyGrid(resolution_m=0.1))
    cells, counts = cells_of(made)
    return {(x, y): (h, m) for (x, y), (h, m) in zip(cells.tolist(), counts.tolist(), strict=True)}


def walls_in(cells: dict[tuple[int, int], tuple[int, int]]) -> set[int]:
    return {x for (x, _), (hits, misses) in cells.items() if hits > misses}


def test_what_is_seen_down_a_stairwell_changes_nothing_elsewhere() -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, sweep(wall(3.0, 0.0, 2.0), (0.0, 0.5, 0.6), 0.0))
    before = grid_of(layer)
    assert walls_in(before) == {30}
    deep = np.array([[4.05 + 0.1 * k, 6.0, -2.0] for k in range(20)])
    kind.integrate(layer, sweep(deep, (0.0, 6.0, 0.6), 0.0))
    after = grid_of(layer)
    assert {cell: counts for cell, counts in after.items() if cell in before and cell[1] < 20} == before


class OneFloorForAll:
    """Converts as if the lowest slab that a tenth of all columns have were the floor everywhere."""

    def convert(self, layer: Layer, source: MapType, target: MapType) -> Layer:
        assert isinstance(source, PointCloud)
        flat = source.decode(source.encode(layer))
        assert isinstance(flat, CloudLayer)
        points = source.structure(source.view(flat))
        floor = lowest_slab(np.floor(points / flat.voxel_m).astype(np.int64), flat.voxel_m)
        if floor is not None:
            flat.floors = Floors()
            flat.floors.add((0, 0, floor))
        return GridConversion().convert(flat, source, target)


class OneFloorLaws(CloudToGrid):
    def make_conversion(self) -> Conversion:
        return OneFloorForAll()


@pytest.mark.parametrize("law", ["what_stood_stands_on", "what_stands_stays"])
def test_the_laws_catch_a_conversion_that_knows_one_floor_only(law: str) -> None:
    """With no more examples than the real one is tried with."""
    (meant,) = [one for one in laws_of(OneFloorLaws) if one.name == law]
    broken = examine(OneFloorLaws(), meant)
    assert broken.status == "broken", broken
    assert "m lower" in broken.sentence
    assert examine(CloudToGrid(), meant).status == "kept"


def test_the_band_follows_the_robot_up_a_ramp() -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    for x in range(0, 21, 2):
        up = 0.2 * x
        curb, post = wall(x + 0.05, up, up + 0.2, 1.0), wall(x + 0.05, up, up + 2.0, 3.0)
        kind.integrate(layer, sweep(np.concatenate((curb, post)), (float(x), 0.0, up + 0.6), up))
    cells = grid_of(layer)
    stands = {(x, y // 10) for (x, y), (hits, misses) in cells.items() if hits > misses}
    assert {x for x, row in stands if row == 3} == set(range(0, 210, 20))
    assert not {x for x, row in stands if row == 1}


def test_two_storeys_of_which_the_robot_was_on_both() -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, sweep(wall(3.0, 0.0, 2.0), (0.0, 0.5, 0.6), 0.0))
    kind.integrate(layer, sweep(wall(33.0, 4.0, 6.0), (30.0, 0.5, 4.6), 4.0))
    assert walls_in(grid_of(layer)) == {30, 330}


@pytest.mark.parametrize("sensor_z", [0.6, 21.7, -3.4])
def test_without_a_base_the_sweep_shows_its_floor(sensor_z: float) -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    down = sensor_z - 0.6
    floor = np.array([[x, y, down - 0.02] for x in np.arange(0.5, 3, 0.1) for y in np.arange(-1, 1, 0.1)])
    low, high = wall(3.0, down, down + 0.2), wall(3.5, down, down + 2.0, 2.0)
    kind.integrate(layer, sweep(np.concatenate((floor, low, high)), (0.0, 0.0, sensor_z)))
    assert walls_in(grid_of(layer)) == {35}


def test_somebody_may_know_the_floor(observe: Observe) -> None:
    kind = PointCloud(floor_m=7.0)
    swept, ready = kind.new_layer(), kind.new_layer()
    points = np.concatenate((wall(3.0, 0.0, 2.0), wall(5.0, 7.0, 9.0)))
    kind.integrate(swept, sweep(points, (0.0, 0.5, 0.6), 0.0))
    kind.integrate(ready, observe(points, None, None, True))
    assert walls_in(grid_of(swept)) == walls_in(grid_of(ready)) == {50}
    assert walls_in(grid_of(kind.decode(kind.encode(ready)))) == {50}  # a donor's floor travels with its layer


def test_a_placed_layer_takes_its_floors_along() -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, sweep(wall(3.0, 0.0, 2.0), (0.0, 0.5, 0.6), 0.0))
    T = Transform.from_quaternion((0.8, 0.0, 5.0), (0.0, 0.0, 0.0, 1.0))
    placed = kind.place(layer, T)
    assert placed.floors.rows() == [[1, 0, 50, 1]]
    assert walls_in(grid_of(placed)) == {38}


def test_of_several_heights_the_one_of_most_sweeps_counts() -> None:
    floors = Floors()
    for height, sweeps in ((9, 2), (3, 4), (5, 4)):
        floors.add((0, 0, height), sweeps)
    floors.add((10, 0, 70))
    assert floors.below(np.array([[0, 0], [4, 1], [6, 0], [100, -3]])).tolist() == [3, 3, 70, 70]


@settings(max_examples=60, deadline=None)
@given(
    voxels=arrays(np.int64, st.tuples(st.integers(1, 60), st.just(3)), elements=st.integers(-6, 6)),
    voxel_m=st.sampled_from([0.05, 0.1, 0.3]),
)
def test_the_lowest_slab_is_what_looking_at_every_slab_finds(voxels: np.ndarray, voxel_m: float) -> None:
    thick, columns = max(1, round(0.2 / voxel_m)), len(np.unique(voxels[:, :2], axis=0))
    for low in range(int(voxels[:, 2].min()) - thick + 1, int(voxels[:, 2].max()) + 1):
        inside = voxels[(voxels[:, 2] >= low) & (voxels[:, 2] < low + thick)]
        if len(np.unique(inside[:, :2], axis=0)) >= 0.1 * columns:
            break
    low = max(low, int(voxels[:, 2].min()))
    found = lowest_slab(voxels, voxel_m)
    assert found is not None
    inside = np.unique(voxels, axis=0)
    levels = [int((inside[:, 2] == z).sum()) for z in range(low, low + thick)]
    assert found == low + levels.index(max(levels)) + 1


def test_many_levels_are_no_matter() -> None:
    voxels = np.random.default_rng(1).integers(-100_000, 100_000, (200_000, 3))
    assert lowest_slab(voxels, 0.1) is None
    assert lowest_slab(np.empty((0, 3), np.int64), 0.1) is None


def test_the_robots_own_thresholds_say_what_stands_and_what_is_free() -> None:
    kind, strict = PointCloud(), PointCloud(occupied=0.9, free=0.2)
    layer = kind.new_layer()
    points = wall(3.0, 0.0, 2.0)
    for n, hits in ((1, 0), (3, 1), (5, 1)):
        while layer.observations < n:
            kind.integrate(layer, sweep(points, (0.0, 0.5, 0.6), 0.0))
        loose, sure = grid_of(layer), grid_of(layer, strict)
        assert walls_in(loose) == {30}
        assert bool(walls_in(sure)) == bool(hits)
        assert set(sure) <= set(loose)
        assert any(misses for _, misses in loose.values())
        assert any(misses for _, misses in sure.values()) == (n > 3)
    assert strict.view(layer).known() > 0
    with pytest.raises(MapError, match="read as its own map type says, found occupancy_grid"):
        GridConversion().convert(layer, OccupancyGrid(), OccupancyGrid())


def test_a_donor_that_was_baked_in_counts_as_its_own_sensor_model_says() -> None:
    kind, weak = PointCloud(), PointCloud(l_hit=0.17, l_miss=-0.205)
    own, donor = kind.new_layer(), weak.new_layer()
    kind.integrate(own, sweep(wall(3.0, 0.0, 2.0), (0.0, 0.5, 0.6), 0.0))
    for _ in range(10):
        weak.integrate(donor, sweep(wall(5.0, 0.0, 2.0), (0.0, 0.5, 0.6), 0.0))
    given = Contribution(Provenance("d", 1, 1), donor, Transform.identity(), 1.0, "t", 1, None, kind.region(donor))
    kind.absorb(own, given)
    cells = grid_of(own)
    assert walls_in(cells) == {30, 50}
    assert {counts for (x, _), counts in cells.items() if x == 50} == {(2, 0)}
