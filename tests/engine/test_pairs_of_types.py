"""Every ordered pair of the map types that are shipped has a rule, or is rejected with a reason that says why."""

from __future__ import annotations

import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest

from mapgraft.contracts import MapMetadata
from mapgraft.decision import DecisionTable, build_table, facts_of
from mapgraft.plugins import load_plugins

DOCS = Path(__file__).parents[2] / "docs"
MAPS = {
    kind: MapMetadata(kind, known_area_m2=100.0, observations=50, extra=extra, **more)
    for kind, more, extra in (
        ("occupancy_grid", {"resolution_m": 0.05}, {}),
        ("point_cloud", {"resolution_m": 0.1}, {"free_space": True}),
        ("line_segments", {}, {"wall_m": 80.0}),
        ("floor_plan", {"resolution_m": None}, {"walls_m": 200.0, "segments": 90}),
    )
}
MEET = {  # receiver, donor: as what
    ("occupancy_grid", "occupancy_grid"): "occupancy_grid",
    ("occupancy_grid", "point_cloud"): "occupancy_grid",
    ("occupancy_grid", "line_segments"): "line_segments",
    ("occupancy_grid", "floor_plan"): "occupancy_grid",
    ("point_cloud", "occupancy_grid"): "occupancy_grid",
    ("point_cloud", "point_cloud"): "point_cloud",
    ("point_cloud", "line_segments"): "occupancy_grid",
    ("line_segments", "point_cloud"): "occupancy_grid",
    ("line_segments", "occupancy_grid"): "line_segments",
    ("line_segments", "line_segments"): "line_segments",
    ("line_segments", "floor_plan"): "occupancy_grid",
}
WHY = {  # a word that only a reason can have that is about these two
    ("point_cloud", "floor_plan"): "how high its walls",
    **{("floor_plan", other): "takes in nothing" for other in MAPS},
}


@pytest.fixture(scope="module")
def table() -> DecisionTable:
    return build_table(load_plugins())


def test_each_pair_is_told_of_once() -> None:
    assert MEET.keys() | WHY.keys() == set(product(MAPS, MAPS))
    assert not MEET.keys() & WHY.keys()


@pytest.mark.parametrize(("own", "other"), MEET)
@pytest.mark.parametrize("prior_sigma_m", [None, 0.1, 5.0])
def test_these_meet(table: DecisionTable, own: str, other: str, prior_sigma_m: float | None) -> None:
    if (own, other) == ("point_cloud", "point_cloud") and prior_sigma_m != 0.1:
        pytest.importorskip("kiss_matcher", reason="needs the extra cloud")
    ruling = table.choose(facts_of(MAPS[own], MAPS[other], prior_sigma_m))
    assert ruling.rule is not None and not ruling.rejected, ruling.reason
    assert (ruling.rule.via or own) == MEET[own, other]
    if prior_sigma_m == 0.1:
        assert ruling.rule.procedure.match.use == "known_pose"


@pytest.mark.parametrize(("own", "other"), WHY)
@pytest.mark.parametrize("prior_sigma_m", [None, 0.1])
def test_these_are_turned_away_and_told_why(
    table: DecisionTable, own: str, other: str, prior_sigma_m: float | None
) -> None:
    ruling = table.choose(facts_of(MAPS[own], MAPS[other], prior_sigma_m))
    assert ruling.rule is not None and ruling.rejected
    assert WHY[own, other] in (ruling.rule.reject or "")
    assert WHY[own, other] in ruling.reason


def test_the_table_in_the_docs_is_that_of_the_rules() -> None:
    pytest.importorskip("kiss_matcher", reason="needs the extra cloud")
    checked = subprocess.run([sys.executable, DOCS / "write_pairs.py", "--check"], check=False, timeout=120)
    assert checked.returncode == 0, "run: python docs/write_pairs.py"
