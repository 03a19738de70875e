"""What differs between a plan and what was built."""

from __future__ import annotations

import csv
import dataclasses
import io
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.contracts import GridMessage, Layer, Map, Match, Measurement, Observation, Step, Transform
from mapgraft.events import Event
from mapgraft.outputs.findings import LatestFindings, finding_markers
from mapgraft.registration import Site, find_move
from mapgraft_floorplan.grid_conversion import PlanToGrid
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.matcher import PlanCorrelation
from mapgraft_floorplan.metrics import PlanAgreement, PlanDeviations, PlanPosterior
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.map_type import OccupancyGrid

HERE = Transform.identity()


@dataclass
class Laid:
    """A plan laid on what a robot has mapped."""

    map_type: OccupancyGrid
    target_layer: Layer
    donor_layer: Layer
    T_receiver_donor: Transform = HERE
    match: Match = field(default_factory=lambda: Match(HERE, 800.0, 700.0))
    subject: Literal["own", "merged"] = "own"

    @property
    def target(self) -> Map:
        return self.map_type.view(self.target_layer)

    @property
    def donor(self) -> Map:
        return self.map_type.view(self.donor_layer)


def laid(grid: OccupancyGrid, own: Layer, plan: NDArray[np.float64], T: Transform = HERE) -> Laid:
    return Laid(grid, own, grid.place(PlanToGrid().convert(PlanLayer(Walls.of_metres(plan)), FloorPlanType(), grid), T))


def test_a_plan_that_is_as_built(robot: tuple[OccupancyGrid, Layer], walls: NDArray[np.float64]) -> None:
    comparison = laid(*robot, walls)
    found = PlanDeviations().track(comparison).update(Step())
    assert found.value < 0.02
    assert found.findings == ()
    assert found.details["agreed_m"] > 30.0
    assert PlanAgreement().track(comparison).update(Step()).value > 0.97
    assert PlanPosterior().track(comparison).update(Step()).value > 0.9


def test_each_deviation_is_found(robot: tuple[OccupancyGrid, Layer], walls: NDArray[np.float64]) -> None:
    plan = walls.copy()
    plan[6] += [0.3, 0.0, 0.3, 0.0]  # the lower inner wall was drawn 0.3 m farther right
    plan = np.vstack((np.delete(plan, 7, axis=0), [[1.0, 2.0, 4.0, 2.0]]))  # one was not drawn, and one not built
    found = PlanDeviations().track(laid(*robot, plan)).update(Step())
    by_kind = {finding.kind: finding for finding in found.findings}
    assert by_kind["wall displaced"].value == pytest.approx(0.3, abs=0.06)
    assert by_kind["wall displaced"].start_m[0] == pytest.approx(5.3, abs=0.08)
    assert by_kind["wall missing"].value == pytest.approx(3.0, abs=0.4)
    for end in (by_kind["wall missing"].start_m, by_kind["wall missing"].end_m):
        assert end[1] == pytest.approx(2.0, abs=0.1)
    assert by_kind["wall added"].value == pytest.approx(2.0, abs=0.3)  # within 0.5 m of others it may be one of them
    assert by_kind["wall added"].start_m[0] == pytest.approx(5.0, abs=0.1)
    assert found.details["displaced_max_m"] == pytest.approx(0.3, abs=0.06)


def test_furniture_is_no_contradiction(robot: tuple[OccupancyGrid, Layer], walls: NDArray[np.float64]) -> None:
    grid, own = robot
    before = PlanAgreement().track(laid(grid, own, walls)).update(Step())
    furnished = OccupancyGrid()
    layer = furnished.new_layer()
    seen = grid.view(own).dense_over((-20, -20), (200, 280)).classes
    cells = np.where(seen == 0, -1, np.where(seen == 2, 100, 0)).astype(np.int8)
    cells[60:80, 50:80] = 100
    message = GridMessage(cells, 0.05, Transform.planar(-1.0, -1.0, 0.0))
    furnished.integrate(layer, Observation("robot", 0, 0, "map", "grid_message", message, HERE, HERE))
    after = PlanAgreement().track(laid(furnished, layer, walls)).update(Step())
    assert after.value == pytest.approx(before.value, abs=0.01)
    assert PlanPosterior().track(laid(furnished, layer, walls)).update(Step()).value > 0.9


def test_a_wrong_place_is_improbable(robot: tuple[OccupancyGrid, Layer], walls: NDArray[np.float64]) -> None:
    comparison = laid(*robot, walls, Transform.planar(2.0, 1.5, 0.6))
    comparison.match = Match(HERE, 40.0, -600.0)
    assert PlanAgreement().track(comparison).update(Step()).value < 0.4
    assert PlanPosterior().track(comparison).update(Step()).value < 0.5


def test_the_best_of_the_rest_is_no_better_than_it_was(
    robot: tuple[OccupancyGrid, Layer], walls: NDArray[np.float64]
) -> None:
    """When the best place has been refused the engine tells margins among the others."""
    comparison = laid(*robot, walls)
    comparison.match = Match(HERE, 800.0, 700.0, evidence={"lead": 0.875})
    first = PlanPosterior().track(comparison).update(Step())
    comparison.match = Match(HERE, 800.0, 700.0, evidence={"lead": -0.375})
    second = PlanPosterior().track(comparison).update(Step())
    comparison.match = Match(HERE, 800.0, 0.0)
    tied = PlanPosterior().track(comparison).update(Step())
    assert first.value > 0.9
    assert tied.value == pytest.approx(0.5 * tied.details["fits"])
    assert second.value < 0.1


def test_a_place_does_not_become_less_probable_by_being_registered_anew(
    walls: NDArray[np.float64], early_map: GridMap, robot_map: GridMap, robot: tuple[OccupancyGrid, Layer]
) -> None:
    """The score grows with the map and replaces the standing one; the margin and the lead that were told stay."""
    grid = robot[0]
    plan = PlanToGrid().convert(PlanLayer(Walls.of_metres(walls)), FloorPlanType(), grid)
    view, site = grid.view(plan), Site((6.0, 4.0), 0.05, 7.0)
    found = PlanCorrelation().match(early_map, view)[0]
    off = Transform.planar(0.2, 0.1, 0.0)
    standing = dataclasses.replace(found, T_receiver_donor=off @ found.T_receiver_donor)
    comparison = laid(*robot, walls)
    comparison.match = standing
    before = PlanPosterior().track(comparison).update(Step())
    move = find_move(PlanCorrelation(), robot_map, view, standing, standing.T_receiver_donor, site)
    assert move is not None
    assert move.match.score > 1.2 * standing.score
    assert move.match.margin == standing.margin
    comparison.match = move.match
    after = PlanPosterior().track(comparison).update(Step())
    assert after.details["first"] == before.details["first"] > 0.5
    assert after.value == before.value


def test_maps_far_apart_are_not_measured(robot: tuple[OccupancyGrid, Layer], walls: NDArray[np.float64]) -> None:
    comparison = laid(*robot, walls, Transform.planar(500.0, 0.0, 0.0))
    for metric in (PlanAgreement(), PlanDeviations(), PlanPosterior()):
        assert not metric.track(comparison).update(Step()).sufficient


def event(kind: Literal["merged", "verified", "reverted"], measured: tuple[Measurement, ...], state: str) -> Event:
    return Event(0, 0, kind, "r", "p", "r.p.1", state, measurements=measured)


def test_findings_are_written_while_the_merge_stands(
    robot: tuple[OccupancyGrid, Layer], walls: NDArray[np.float64]
) -> None:
    plan = np.vstack((walls, [[1.0, 2.0, 4.0, 2.0]]))
    measured = PlanDeviations().track(laid(*robot, plan)).update(Step())
    latest = LatestFindings()
    assert latest.csv() is None
    assert latest.happened(event("merged", (measured,), "provisional"))
    assert not latest.happened(event("verified", (), "provisional"))
    written = latest.csv()
    assert written is not None
    (row,) = csv.DictReader(io.StringIO(written.decode()))
    assert (row["receiver"], row["donor"], row["metric"], row["kind"]) == ("r", "p", "plan_deviations", "wall missing")
    assert float(row["value"]) == pytest.approx(3.0, abs=0.4)
    markers = finding_markers(latest.of_receiver("r"))["markers"]
    assert isinstance(markers, list)
    assert [marker.get("ns") for marker in markers] == [None, "wall missing"]
    assert latest.happened(event("reverted", (), "reverted"))
    assert latest.csv() is None
