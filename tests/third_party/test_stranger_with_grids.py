"""Maps of two types meet: a robot that maps grids takes a landmark robot's evidence in, and gives it back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from mapgraft.contracts import Transform

PROCESSES = 2
RULE = "landmarks into a grid at a known pose"
TruePose = Callable[[str, str], Transform]
Outcomes = Mapping[str, Any]


@pytest.fixture(scope="module")
def outcomes(replayed: Callable[..., Any], true_pose: TruePose) -> Outcomes:
    """Cedar maps a grid, ash and birch map landmarks; cedar knows where ash's map lies. A person reverts the merge."""
    T = true_pose("cedar", "ash")
    common = {
        "map": {"type": "point_landmarks"},
        "robots": {"cedar": {"map": {"type": "occupancy_grid", "resolution_m": 0.1}}},
        "exchange": {"use": "at", "seconds": [40]},
        "forbid": [["ash", "birch"]],  # their groves would be taken for one
        "priors": [{"receiver": "cedar", "donor": "ash", "x_m": T.x_m, "y_m": T.y_m, "yaw_rad": T.yaw_rad}],
    }
    revert = {"verdicts": [{"merge": "cedar.ash.1", "action": "revert", "by": "us", "reason": "to see"}]}
    configs = {
        "standing": common,
        "never": {**common, "forbid": [["ash", "birch"], ["ash", "cedar"]]},
        **{name: {**common, **revert, "reversal": name} for name in ("ledger", "single_map")},
    }
    with ThreadPoolExecutor(PROCESSES) as pool:
        return dict(zip(configs, pool.map(replayed, configs.values()), strict=True))


def test_the_grid_takes_the_landmarks_in(outcomes: Outcomes) -> None:
    outcome = outcomes["standing"]
    merged = outcome.one("cedar.ash.1", "merged")
    assert (merged["rule"], merged["matcher"], merged["fuser"]) == (RULE, "known_pose", "log_odds")
    assert outcome.merge("cedar.ash.1")[-1]["state"] in ("provisional", "confirmed")
    (end,) = [row for row in outcome.snapshots if row["robot"] == "cedar" and row["why"] == "end"]
    assert end["map_type"] == "occupancy_grid"
    assert end["known_fused"] > end["known_own"]
    assert outcome.file("ash.merged.pgm").startswith(b"P5")


def test_the_other_way_is_turned_away_with_the_reason(outcomes: Outcomes) -> None:
    (event,) = [e for e in outcomes["standing"].events if (e["receiver"], e["donor"]) == ("ash", "cedar")][1:]
    assert event["kind"] == "rejected"
    assert event["reason"].startswith("no rule takes a map of type occupancy_grid into one of type point_landmarks")


@pytest.mark.parametrize("reversal", ["ledger", "single_map"])
def test_a_person_takes_it_out_again(outcomes: Outcomes, reversal: str) -> None:
    reverted = outcomes[reversal].one("cedar.ash.1", "reverted")
    assert (reverted["reversal"], reverted["by"]) == (reversal, "person us")
    assert reverted["exact"] is (reversal != "single_map")


def test_and_nothing_of_it_is_left(outcomes: Outcomes) -> None:
    outcome, never = outcomes["ledger"], outcomes["never"]
    assert outcome.layer("cedar") == never.layer("cedar")
    assert outcome.file("cedar.pgm") == never.file("cedar.pgm")
    (end,) = [row for row in outcome.snapshots if row["robot"] == "cedar" and row["why"] == "end"]
    assert end["known_fused"] == end["known_own"]


def test_or_the_statement_says_what(outcomes: Outcomes) -> None:
    reverted = outcomes["single_map"].one("cedar.ash.1", "reverted")
    assert reverted["cells_contaminated"] > 0
    assert reverted["cells_reset"] > 0
    assert outcomes["single_map"].file("cedar.pgm") != outcomes["never"].file("cedar.pgm")
