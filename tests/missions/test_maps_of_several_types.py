"""Missions of robots whose maps are of several types: what came in goes out again, to the byte, however it is kept."""

from __future__ import annotations

from itertools import combinations, permutations
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import mapgraft
from mapgraft.contracts import Transform
from mapgraft.events import Event
from mapgraft_floorplan.drawing import svg
from mapgraft_recordings.buildings import building, record
from mapgraft_recordings.buildings.carmen import write_carmen
from mapgraft_recordings.buildings.cloud_messages import cloud_messages, first_place
from mapgraft_recordings.buildings.plans import plan_of
from mapgraft_recordings.buildings.spatial import record_spatial
from mapgraft_recordings.writing import write_mcap

BUILDING = building(2)
SWEEPS, SCANS = 16, 60
HALF_S = 15.0
MAPS = {"ada": {"type": "point_cloud"}, "eve": {"type": "occupancy_grid"}, "lin": {"type": "line_segments"}}
GRID, CLOUD, LINES, PLAN = "eve", "ada", "lin", "plan"


class Recorded(NamedTuple):
    """Files by robot, and where each robot's map frame lies in the building."""

    paths: dict[str, Path]
    T_building_map: dict[str, Transform]

    def priors(self) -> list[dict[str, Any]]:
        """How the frames lie, as somebody would have measured it."""
        told = []
        for receiver, donor in permutations(self.paths, 2):
            T = self.T_building_map[receiver].inverse() @ self.T_building_map[donor]
            pose = {"x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad, "sigma_m": 0.1, "sigma_yaw_rad": 0.02}
            told.append({"receiver": receiver, "donor": donor, **pose})
        return told


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """One castle, mapped by a spinning lidar and twice by a planar one, and its plan, which is not quite right."""
    pytest.importorskip("svgelements", reason="needs the extra floorplan")
    folder, here = tmp_path_factory.mktemp("castle"), Transform.identity()
    spatial = record_spatial(BUILDING, 0, SWEEPS)
    paths = {name: folder / f"{name}.log" for name in (GRID, LINES)}
    paths |= {CLOUD: folder / "ada.mcap", PLAN: folder / "plan.svg"}
    write_mcap(paths[CLOUD], cloud_messages(spatial, CLOUD, first_place(spatial)))
    for seed, name in enumerate((GRID, LINES), start=1):
        write_carmen(paths[name], record(BUILDING, seed, SCANS), seed)
    paths[PLAN].write_bytes(svg(plan_of(BUILDING, 1)))
    return Recorded(paths, {**dict.fromkeys(paths, here), CLOUD: first_place(spatial).inverse()})


class Ran(NamedTuple):
    result: mapgraft.Result
    files: dict[str, bytes]

    def events(self, kind: str) -> dict[tuple[str, str], Event]:
        """The last event of a kind of each receiver and donor."""
        return {(e.receiver, e.donor): e for e in self.result.events if e.kind == kind}

    def shown(self, robot: str) -> dict[str, bytes]:
        """A robot's map with all that stands in it, as files."""
        snapshot = self.result.maps[robot]
        return dict(snapshot.map_type.files(snapshot.fused, "map"))


def run(recorded: Recorded, out: Path, **more: Any) -> Ran:
    """All four of them, who meet when half is mapped."""
    config = {
        "robots": {name: {"map": kind} for name, kind in MAPS.items()},
        "exchange": {"use": "at", "seconds": [HALF_S]},
        "priors": recorded.priors(),
        "output": {"report": False, "snapshots": False},
        **more,
    }
    result = mapgraft.run(list(recorded.paths.values()), config, out)
    return Ran(result, {path.name: path.read_bytes() for path in sorted((out / "maps").glob("*.*"))})


@pytest.fixture(scope="module")
def never(recorded: Recorded, tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """Nobody took anything in."""
    everybody = [list(pair) for pair in combinations(recorded.paths, 2)]
    return run(recorded, tmp_path_factory.mktemp("never") / "out", forbid=everybody)


@pytest.fixture(scope="module", params=["ledger", "multi_map"])
def merged(recorded: Recorded, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Ran:
    return run(recorded, tmp_path_factory.mktemp("merged") / "out", reversal=request.param)


def test_all_that_can_meet_take_each_other_in_and_only_plans_are_priors(merged: Ran) -> None:
    entered = merged.events("merged")
    assert set(entered) == {*permutations(MAPS, 2), (GRID, PLAN), (LINES, PLAN)}
    assert {pair for pair, event in entered.items() if "prior" in event.evidence} == {(GRID, PLAN), (LINES, PLAN)}
    for (receiver, _), event in entered.items():
        assert merged.result.maps[receiver].metadata.observations > event.receiver_version + 2  # mapping went on


def test_a_plan_fills_what_nobody_saw_and_is_no_observation(merged: Ran, never: Ran) -> None:
    for robot in (GRID, LINES):
        own, fused = merged.result.maps[robot].own, merged.result.maps[robot].fused
        assert fused.known() > own.known()
        assert merged.result.maps[robot].metadata == never.result.maps[robot].metadata


def test_what_was_taken_in_goes_out_again_to_the_byte(
    recorded: Recorded, merged: Ran, never: Ran, tmp_path: Path
) -> None:
    entered = merged.events("merged")
    verdicts = [{"merge": event.merge_id, "action": "revert", "by": "ann"} for event in entered.values()]
    (reversal,) = {event.reversal for event in entered.values()}
    reverted = run(recorded, tmp_path / "out", reversal=reversal, verdicts=verdicts)
    out = reverted.events("reverted")
    assert set(out) == set(entered)
    assert all(event.exactness is not None and event.exactness.exact for event in out.values())
    assert reverted.files == never.files
    for robot in MAPS:
        assert reverted.result.maps[robot].layer == never.result.maps[robot].layer
        assert reverted.shown(robot) == never.shown(robot) != merged.shown(robot)


def test_own_maps_are_what_they_would_be_without_the_others(merged: Ran, never: Ran) -> None:
    assert {name: merged.files[name] for name in never.files} == never.files
    for robot, snapshot in never.result.maps.items():
        assert merged.result.maps[robot].layer == snapshot.layer


def test_one_of_several_goes_alone(recorded: Recorded, merged: Ran, tmp_path: Path) -> None:
    """Without the plan a map is that of a robot that took in all the others and never the plan."""
    (reversal,) = {event.reversal for event in merged.events("merged").values()}
    plan = merged.events("merged")[GRID, PLAN].merge_id
    verdict = {"merge": plan, "action": "revert", "by": "ann"}
    reverted = run(recorded, tmp_path / "reverted", reversal=reversal, verdicts=[verdict])
    without = run(recorded, tmp_path / "without", reversal=reversal, forbid=[[GRID, PLAN]])
    assert set(reverted.events("reverted")) == {(GRID, PLAN)}
    assert reverted.shown(GRID) == without.shown(GRID) != merged.shown(GRID)
