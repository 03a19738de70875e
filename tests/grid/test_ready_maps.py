"""Robots that are mapped from ready-made maps."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mapgraft.contracts import Contribution, GridMessage, MapError, Observation, Provenance, Transform
from mapgraft_grid.grid_map import FREE, OCCUPIED, UNKNOWN
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.observing import count_table
from mapgraft_grid.parameters import Lattice
from mapgraft_grid.region import GridRegion
from mapgraft_grid.weights import TileWeights

MakeScan = Callable[..., Observation]
MakeMessage = Callable[..., Observation]


def _classes(cells: NDArray[np.int8]) -> NDArray[np.uint8]:
    return np.where(cells > 65, OCCUPIED, np.where((cells >= 0) & (cells < 19.6), FREE, UNKNOWN)).astype(np.uint8)


@settings(max_examples=30, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 150), st.integers(1, 150)),
    origin=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    resolution=st.sampled_from([0.03, 0.05, 0.1, 1.0]),
    seed=st.integers(0, 2**31),
)
def test_every_cell_keeps_its_class_and_its_place(
    message_of: MakeMessage, shape: tuple[int, int], origin: tuple[float, float], resolution: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    cells = random.choice(np.array([-1, 0, 10, 19, 20, 50, 65, 66, 90, 100], np.int8), shape)
    cells[0, 0], cells[-1, -1] = 100, 0
    grid = OccupancyGrid()
    layer = grid.new_layer()
    touched = grid.integrate(layer, message_of(cells, resolution, (*origin, 0.0)))
    dense = grid.view(layer).dense()
    assert (dense.classes == _classes(cells)).all()
    assert dense.resolution_m == resolution
    assert dense.origin_m == pytest.approx(origin, abs=1e-6 * resolution + 1e-9)
    assert touched == grid.region(layer)
    # a value of 50 says nothing, like -1
    assert (touched.mask(dense.origin_cell, shape) == ((cells >= 0) & (cells != 50))).all()
    assert grid.decode(grid.encode(layer)).lattice == layer.lattice


def test_values_keep_their_confidence() -> None:
    for grid in (OccupancyGrid(), OccupancyGrid(l_hit=2.0, l_miss=-1.0), OccupancyGrid(l_hit=0.2, l_miss=-0.05)):
        model, read = grid.new_layer().sensor_model, grid.thresholds
        table = count_table(model, read)
        evidence = table[:, 0].astype(int) * model.l_hit + table[:, 1].astype(int) * model.l_miss
        values = np.arange(101)
        assert ((evidence >= read.occupied) == (values > 65)).all()
        assert ((evidence <= read.free) == (values < 19.6)).all()
        wanted = np.clip(np.log(np.clip(values, 1, 99) / np.clip(100 - values, 1, 99)) * 1024, -read.clamp, read.clamp)
        assert abs(evidence - wanted)[1:100].max() <= max(model.l_hit, -model.l_miss) * 1.5
        assert table.max() <= read.clamp / -model.l_miss + 2


def test_each_message_is_a_new_version(message_of: MakeMessage) -> None:
    grid = OccupancyGrid()
    layer = grid.new_layer()
    first = np.full((10, 10), 100)
    second = np.full((5, 20), 0)
    one = grid.integrate(layer, message_of(first))
    before = grid.view(layer)
    two = grid.integrate(layer, message_of(second, origin=(0.3, 0.3, 0.0)))
    alone = grid.new_layer()
    grid.integrate(alone, message_of(second, origin=(0.3, 0.3, 0.0)))
    assert grid.region(layer) == grid.region(alone)
    assert (grid.view(layer).dense().classes == FREE).all()
    assert two == one.union(grid.region(layer))
    assert (grid.view(layer, (), before, two).dense().log_odds == grid.view(alone).dense().log_odds).all()
    assert layer.observations == 2
    assert grid.metadata(layer).mapper == "ready map"


def test_maps_that_move_by_parts_of_cells_stay_on_the_first_ones_lattice(message_of: MakeMessage) -> None:
    grid = OccupancyGrid()
    layer = grid.new_layer()
    cells = np.zeros((40, 60), np.int8)
    cells[10:30, 20:40] = 100
    grid.integrate(layer, message_of(cells, 0.1, (0.02, 0.03, 0.0)))
    lattice = layer.lattice
    assert lattice == Lattice(0.1, (0.02, 0.03))
    grid.integrate(layer, message_of(cells, 0.1, (0.05, 0.04, 0.0)))
    assert layer.lattice == lattice
    dense = grid.view(layer).dense()
    assert (dense.classes == _classes(cells)).all(), "shifted by less than half a cell"
    grid.integrate(layer, message_of(np.kron(cells, np.ones((2, 2), np.int8)), 0.05, (0.02, 0.03, 0.0)))
    assert layer.lattice == lattice
    assert (grid.view(layer).dense().classes == _classes(cells)).all()


@pytest.mark.parametrize("yaw", [math.pi / 2, 0.4, -2.0])
def test_turned_maps_lie_where_they_say(message_of: MakeMessage, yaw: float) -> None:
    cells = np.zeros((100, 140), np.int8)
    cells[20:40, 30:90] = 100
    grid = OccupancyGrid()
    layer = grid.new_layer()
    grid.integrate(layer, message_of(cells, 0.1, (3.0, -2.0, yaw)))
    assert layer.lattice == Lattice(0.1)
    dense = grid.view(layer).dense()
    T = Transform.planar(3.0, -2.0, yaw).inverse()
    rows, columns = np.indices(dense.classes.shape)
    points = np.column_stack((columns.ravel() + 0.5, rows.ravel() + 0.5)) * 0.1 + dense.origin_m
    at = T.apply(points) / 0.1
    inside = (at[:, 0] > 1) & (at[:, 0] < 139) & (at[:, 1] > 1) & (at[:, 1] < 99)
    clear = (abs(at - np.round(at)) > 1e-3).all(axis=1) & inside
    expected = _classes(cells)[np.floor(at[clear, 1]).astype(int), np.floor(at[clear, 0]).astype(int)]
    assert (dense.classes.ravel()[clear] == expected).all()
    assert clear.sum() > 10_000


def test_scans_and_maps_do_not_mix(scan_of: MakeScan, message_of: MakeMessage) -> None:
    grid = OccupancyGrid()
    for first, second in ((scan_of(0.0, 1.0), message_of([[0]])), (message_of([[0]]), scan_of(0.0, 1.0))):
        layer = grid.new_layer()
        grid.integrate(layer, first)
        before = grid.encode(layer)
        with pytest.raises(MapError, match="choose one of the two"):
            grid.integrate(layer, second)
        assert grid.encode(layer) == before


def test_a_robot_with_a_plan_receives_on_the_plans_cells(scan_of: MakeScan, message_of: MakeMessage) -> None:
    plan, donor = OccupancyGrid(), OccupancyGrid(resolution_m=0.05)
    layer = plan.new_layer()
    plan.integrate(layer, message_of(np.zeros((50, 50)), 0.04, (0.013, -0.017, 0.0)))
    other = donor.new_layer()
    for _ in range(5):
        donor.integrate(other, scan_of(np.linspace(-3, 3, 300), 3.0, True, (5.0, 5.0, 0.0)))
    placed = plan.place(other, Transform.planar(1.0, 1.0, 0.5))
    assert placed.lattice == layer.lattice
    contribution = Contribution(
        Provenance("donor", 0, 1),
        placed,
        Transform.planar(1.0, 1.0, 0.5),
        1.0,
        plan.resampler(other),
        TileWeights.plain(),
        None,
        plan.region(placed),
    )
    own = plan.view(layer)
    fused = plan.view(layer, (contribution,), own, plan.region(placed))
    assert own.known() < fused.known() <= own.known() + plan.view(placed).known()
    assert contribution.resampler == "nearest/1"


def test_a_robot_that_scans_keeps_its_cells_whatever_map_it_meets(scan_of: MakeScan, message_of: MakeMessage) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    own, other = grid.new_layer(), grid.new_layer()
    grid.integrate(own, scan_of(0.0, 1.0))
    cells = np.zeros((20, 20), np.int8)
    grid.integrate(other, message_of(cells, 0.05, (0.01, 0.0, 0.0)))
    assert other.lattice == own.lattice == grid.new_layer().lattice
    assert grid.view(other).known() == pytest.approx(100, abs=20)


def test_what_was_baked_in_stays_when_a_new_map_comes(scan_of: MakeScan, message_of: MakeMessage) -> None:
    grid = OccupancyGrid(resolution_m=0.1)
    layer, donor = grid.new_layer(), grid.new_layer()
    grid.integrate(layer, message_of(np.zeros((20, 20))))
    grid.integrate(donor, scan_of(0.0, 3.0))
    region = grid.region(donor)
    contribution = Contribution(
        Provenance("d", 0, 1), donor, Transform.identity(), 1.0, "nearest/1", TileWeights.plain(), None, region
    )
    grid.absorb(layer, contribution)
    touched = grid.integrate(layer, message_of(np.full((5, 5), 100)))
    erased = GridRegion.from_mask(layer.lattice, (0, 0), np.ones((20, 20), np.bool_))
    assert touched == grid.region(layer).union(erased)
    alone = grid.new_layer()
    grid.integrate(alone, message_of(np.full((5, 5), 100)))
    expected = grid.view(alone, (contribution,)).dense_over((-5, -5), (60, 60)).log_odds
    assert (grid.view(layer).dense_over((-5, -5), (60, 60)).log_odds == expected).all()


def test_impossible_maps_are_refused(message_of: MakeMessage) -> None:
    grid = OccupancyGrid()
    cells = np.zeros((3, 3), np.int8)
    bad: list[tuple[object, float, str]] = [
        (cells, 0.0, "m per cell"),
        (cells, math.nan, "m per cell"),
        (cells + 101, 0.1, "-1 .unknown. and 0"),
        (cells - 2, 0.1, "-1 .unknown. and 0"),
        (cells[0], 0.1, "must have up to"),
    ]
    for content, resolution, sentence in bad:
        with pytest.raises(MapError, match=sentence):
            grid.integrate(grid.new_layer(), message_of(content, resolution))
    layer = grid.new_layer()
    with pytest.raises(MapError, match="nearer origin"):
        grid.integrate(layer, message_of(cells, 0.1, (1e10, 0.0, 0.0)))
    assert layer.mapper == ""
    empty = np.broadcast_to(np.int8(-1), (30_000, 30_000))
    payload = GridMessage(empty, 0.1, Transform.identity())
    huge = Observation("robot", 0, 0, "map", "grid_message", payload, Transform.identity(), Transform.identity())
    with pytest.raises(MapError, match="up to 400000000 cells"):
        grid.integrate(layer, huge)


def test_an_empty_map_is_an_empty_layer(message_of: MakeMessage) -> None:
    grid = OccupancyGrid()
    for cells in (np.full((7, 9), -1), np.zeros((0, 0))):
        for yaw in (0.0, 0.3):
            layer = grid.new_layer()
            assert len(grid.integrate(layer, message_of(cells, 0.1, (0.0, 0.0, yaw)))) == 0
            assert grid.view(layer).is_empty
