"""A plan is a prior: bounded, never counted as observed, and taken out without a trace."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import (
    ConfigError,
    Contribution,
    Donation,
    GridMessage,
    Layer,
    MapError,
    Match,
    Observation,
    Provenance,
    Transform,
)
from mapgraft.reversal import Ledger
from mapgraft_floorplan.grid_conversion import PlanToGrid
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.prior_fuser import PlanPrior
from mapgraft_grid.map_type import OccupancyGrid

HERE = Transform.identity()


def fused_plan(grid: OccupancyGrid, own: Layer, plan: PlanLayer, **given: float) -> Contribution:
    donation = Donation(PlanToGrid().convert(plan, FloorPlanType(), grid), Provenance("plan", 1, 1))
    return PlanPrior(**given).fuse(grid, grid.view(own), donation, Match(HERE, 1.0, 1.0))


def test_the_role_is_prior_and_nothing_is_stronger_than_its_bounds(
    robot: tuple[OccupancyGrid, Layer], plan_layer: PlanLayer
) -> None:
    grid, own = robot
    made = fused_plan(grid, own, plan_layer)
    assert made.role == "prior"
    empty = grid.new_layer()
    empty.lattice = own.lattice
    log_odds = grid.view(empty, [made]).dense_over((-40, -40), (300, 380)).log_odds
    assert log_odds.max() == round(0.85 * 1024)
    assert log_odds.min() == -round(0.41 * 1024)
    assert (grid.view(empty, [made]).dense_over((-40, -40), (300, 380)).classes == 1).sum() == 0  # no room is free yet


def test_three_looks_override_a_wall_that_was_never_built(walls: NDArray[np.float64]) -> None:
    grid = OccupancyGrid()
    plan = PlanLayer(Walls.of_metres(walls))
    own = grid.new_layer()
    made = fused_plan(grid, own, plan)
    fused = grid.view(own, [made]).dense_over((0, 0), (160, 240))
    wall = np.argwhere(fused.log_odds > 0)[0]
    seen = [int(fused.log_odds[tuple(wall)]) + looks * round(-0.41 * 1024) for looks in range(4)]
    assert seen[2] > 0 > seen[3]


def test_what_it_says_is_not_observed(robot: tuple[OccupancyGrid, Layer], plan_layer: PlanLayer) -> None:
    grid, own = robot
    ledger = Ledger(grid)
    ledger._layer = own  # a ledger that has observed this
    told = grid.metadata(ledger.offered_layer())
    alone, sent = ledger.own().known(), grid.encode(ledger.offered_layer())
    ledger.merge("robot.plan.1", fused_plan(grid, own, plan_layer))
    assert ledger.fused().known() > alone
    assert ledger.own().known() == ledger.compared().known() == alone
    assert grid.metadata(ledger.offered_layer()) == told
    assert grid.encode(ledger.offered_layer()) == sent
    files = grid.files(ledger.own(), "map")
    assert ledger.revert("robot.plan.1").exact
    assert grid.files(ledger.fused(), "map") == files


def test_observations_go_on_beside_it(robot: tuple[OccupancyGrid, Layer], plan_layer: PlanLayer) -> None:
    grid, own = robot
    ledger = Ledger(grid)
    ledger._layer = own
    ledger.merge("robot.plan.1", fused_plan(grid, own, plan_layer))
    before = ledger.fused().known()
    cells = np.zeros((40, 40), np.int8)
    seen = Observation(
        "robot", 1, 1, "map", "grid_message", GridMessage(cells, 0.05, Transform.planar(9, 5, 0)), HERE, HERE
    )
    ledger.observe(seen)
    ledger.revert("robot.plan.1")
    fresh = OccupancyGrid()
    assert ledger.fused().known() < before
    assert grid.files(ledger.fused(), "map") == fresh.files(grid.view(ledger.offered_layer()), "map")


@pytest.mark.parametrize("given", [{"wall": 0.0}, {"room": 2.5}, {"wall": float("nan")}, {"room": True}])
def test_impossible_weights_are_refused(given: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="plan_prior needs"):
        PlanPrior(**given)


def test_a_plan_as_it_was_sent_is_no_grid(robot: tuple[OccupancyGrid, Layer], plan_layer: PlanLayer) -> None:
    grid, own = robot
    with pytest.raises(MapError, match="convert them first"):
        PlanPrior().fuse(grid, grid.view(own), Donation(plan_layer, Provenance("plan", 1, 1)), Match(HERE, 1.0, 1.0))
