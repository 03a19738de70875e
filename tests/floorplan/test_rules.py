"""The default rules where one of the maps is a floor plan, and what is said where there is none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mapgraft.cli import invoke
from mapgraft.contracts import MapMetadata
from mapgraft.decision import build_table, facts_of
from mapgraft.plugins import load_plugins
from mapgraft_floorplan.drawing import svg
from mapgraft_floorplan.layer import PlanLayer
from mapgraft_grid.map_type import OccupancyGrid

PLUGINS = load_plugins()
TABLE = build_table(PLUGINS, None)


def told(name: str, known: bool = True) -> MapMetadata:
    extra = {"walls_m": 60.0, "wall_m": 60.0, "crossing_m": 30.0, "free_space": True}
    return MapMetadata(name, 0.05, known, known_area_m2=80.0, observations=40, extra=extra)


@pytest.mark.parametrize("own", ["occupancy_grid", "line_segments"])
@pytest.mark.parametrize(("known", "rule"), [(True, "a floor plan"), (False, "a floor plan of unknown scale")])
def test_a_plan_is_a_prior_of_grids_and_lines(own: str, known: bool, rule: str) -> None:
    ruling = TABLE.choose(facts_of(told(own), told("floor_plan", known)))
    assert ruling.rule is not None
    assert ruling.rule.name == rule
    assert ruling.rule.procedure.fuse.use == "plan_prior"
    assert ruling.rule.reverse.allow == ("ledger", "multi_map")


@pytest.mark.parametrize(
    ("own", "other", "why"),
    [
        ("point_cloud", "floor_plan", "does not tell how high its walls are"),
        ("floor_plan", "occupancy_grid", "takes in nothing"),
        ("floor_plan", "line_segments", "takes in nothing"),
        ("floor_plan", "point_cloud", "takes in nothing"),
        ("floor_plan", "floor_plan", "takes in nothing"),
    ],
)
def test_everything_else_is_rejected_with_its_reason(own: str, other: str, why: str) -> None:
    ruling = TABLE.choose(facts_of(told(own), told(other)))
    assert ruling.rejected
    assert why in ruling.reason


def test_a_single_map_takes_no_plan() -> None:
    ruling = TABLE.choose(facts_of(told("occupancy_grid"), told("floor_plan"), reversal="single_map"))
    assert ruling.rejected
    assert "reversal is single_map" in ruling.reason


def test_match_takes_a_plan(
    tmp_path: Path,
    robot: tuple[OccupancyGrid, PlanLayer],
    walls: NDArray[np.float64],
    capsys: pytest.CaptureFixture[str],
) -> None:
    grid, own = robot
    for name, content in grid.files(grid.view(own), "map").items():
        (tmp_path / name).write_bytes(content)
    plan = np.vstack((walls, [[1.0, 2.0, 4.0, 2.0]]))
    (tmp_path / "plan.svg").write_bytes(svg(plan))
    status = invoke(
        ["match", str(tmp_path / "map.yaml"), str(tmp_path / "plan.svg"), "-o", str(tmp_path / "out"), "--json"]
    )
    found = json.loads(capsys.readouterr().out)
    assert status == 0
    assert found["rule"] == "a floor plan"
    assert found["verdict"] == "provisional"
    assert found["T_a_b"]["x_m"] == pytest.approx(0.0, abs=0.1)
    assert found["T_a_b"]["yaw_rad"] == pytest.approx(0.0, abs=0.02)
    assert "wall missing" in (tmp_path / "out" / "findings.csv").read_text()
