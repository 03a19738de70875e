"""A stranger's map type goes all the way: installed by pip, merged, verified, reverted, without a change to the engine.

At the first exchange ash takes birch's map in as if the two groves were one: nothing it has seen speaks against it.
Going on, it finds what birch's map does not have.
"""

from __future__ import annotations

import ast
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from mapgraft.contracts import Transform

PACKAGE = Path(__file__).parent / "landmarks"
ENGINE = Path(__file__).parents[2] / "pipeline" / "mapgraft"
PROCESSES = 2

LANDMARKS = {"map": {"type": "point_landmarks"}, "exchange": {"use": "every", "seconds": 30}}
ONLY_ASH_AND_BIRCH = [["ash", "cedar"], ["birch", "cedar"]]
CONFIGS: dict[str, dict[str, Any]] = {
    "ledger": {**LANDMARKS, "reversal": "ledger"},
    "multi_map": {**LANDMARKS, "reversal": "multi_map"},
    "single_map": {**LANDMARKS, "reversal": "single_map", "forbid": ONLY_ASH_AND_BIRCH},
    "never": {**LANDMARKS, "reversal": "ledger", "forbid": [["ash", "birch"]]},
    "alone": {**LANDMARKS, "reversal": "single_map", "forbid": [["ash", "birch"], *ONLY_ASH_AND_BIRCH]},
}

TruePose = Callable[[str, str], Transform]
Outcomes = Mapping[str, Any]


@pytest.fixture(scope="module")
def outcomes(replayed: Callable[..., Any]) -> Outcomes:
    """What came of every configuration."""
    with ThreadPoolExecutor(PROCESSES) as pool:
        return dict(zip(CONFIGS, pool.map(replayed, CONFIGS.values()), strict=True))


def test_pip_has_installed_a_plugin(installed: Path, mapgraft: Callable[..., subprocess.CompletedProcess[str]]) -> None:
    listed = json.loads(mapgraft(["plugins", "list", "--json"], [installed]).stdout)
    theirs = {(o["kind"], o["name"]) for o in listed["offered"] if o["distribution"] == "mapgraft-landmarks"}
    assert theirs == {
        ("map type", "point_landmarks"),
        ("matcher", "constellation"),
        ("fuser", "landmark_union"),
        ("metric", "landmark_agreement"),
        ("conversion", "point_landmarks_to_occupancy_grid"),
    }
    assert {o["version"] for o in listed["offered"] if o["plugin"] == "point_landmarks"} == {"1.2.0"}
    assert listed["broken"] == []
    assert {"name": "landmarks", "plugin": "point_landmarks"} in listed["rules"]


def test_listing_imports_nothing_behind_a_descriptor(installed: Path) -> None:
    code = (
        "import sys; from mapgraft.plugins import load_plugins; found = load_plugins().offered; "
        "print(('matcher', 'constellation') in found, sorted(m for m in sys.modules if m.startswith('mapgraft_landm')))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        timeout=600,
        check=True,
    )
    assert done.stdout.split() == ["True", "['mapgraft_landmarks']"]


def imports_of(file: Path) -> set[str]:
    """The names of the modules that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
    return found


def test_the_stranger_knows_only_the_contracts() -> None:
    sources = sorted((PACKAGE / "src").rglob("*.py"))
    assert len(sources) > 10
    for source in sources:
        known = {name for name in imports_of(source) if name.split(".")[0].startswith("mapgraft")}
        allowed = {"mapgraft.contracts"} | {name for name in known if name.startswith("mapgraft_landmarks")}
        if source.name == "grid_conversion.py":
            allowed |= {name for name in known if name.startswith("mapgraft_grid")}
        assert known <= allowed, source


def test_the_engine_knows_neither_landmarks_nor_grids() -> None:
    for source in sorted(ENGINE.rglob("*.py")):
        assert not {name for name in imports_of(source) if name.startswith(("mapgraft_landmarks", "mapgraft_grid"))}
        assert "landmark" not in source.read_text(encoding="utf-8"), source


@pytest.mark.parametrize("reversal", ["ledger", "multi_map", "single_map"])
def test_a_wrong_merge_is_made_found_out_and_reverted(outcomes: Outcomes, true_pose: TruePose, reversal: str) -> None:
    outcome = outcomes[reversal]
    merged, reverted = outcome.one("ash.birch.1", "merged"), outcome.one("ash.birch.1", "reverted")
    assert merged["reversal"] == reversal
    T = Transform.from_matrix(np.array(merged["T_receiver_donor"]).reshape(4, 4))
    assert T.difference(true_pose("ash", "birch"))[0] > 20.0
    assert merged["hypotheses"] >= 2
    assert merged["margin"] > 8.0
    assert reverted["by"] == "thresholds"
    assert "landmark_agreement" in reverted["reason"]
    assert reverted["receiver_version"] > merged["receiver_version"] > 40
    verified = [event for event in outcome.merge("ash.birch.1") if event["kind"] == "verified"]
    assert len(verified) >= 2  # at the merge, and while mapping went on


@pytest.mark.parametrize("reversal", ["ledger", "multi_map", "single_map"])
def test_mapping_goes_on_after_the_revert(outcomes: Outcomes, reversal: str) -> None:
    outcome = outcomes[reversal]
    rows = [row for row in outcome.snapshots if row["robot"] == "ash"]
    (after,) = [row for row in rows if row["why"] == "after revert" and row["merge_id"] == "ash.birch.1"]
    (end,) = [row for row in rows if row["why"] == "end"]
    assert end["known_own"] > after["known_own"]
    tried = [event for event in outcome.events if event["kind"] in ("merged", "unmatched", "ambiguous")]
    later = [event for event in tried if event["donor"] == "birch" and event["receiver"] == "ash"]
    assert later[-1]["kind"] == "unmatched"  # asked again, with more of both maps, and not taken in again


@pytest.mark.parametrize("reversal", ["ledger", "multi_map"])
def test_the_right_merge_stands(outcomes: Outcomes, true_pose: TruePose, reversal: str) -> None:
    standing = outcomes[reversal].merge("ash.cedar.1")[-1]
    assert standing["state"] == "confirmed"
    T = Transform.from_matrix(np.array(standing["T_receiver_donor"]).reshape(4, 4))
    shift_m, turn_rad = T.difference(true_pose("ash", "cedar"))
    assert shift_m < 0.2
    assert turn_rad < math.radians(1.0)


@pytest.mark.parametrize("reversal", ["ledger", "multi_map"])
def test_an_exact_revert_leaves_no_trace(outcomes: Outcomes, reversal: str) -> None:
    outcome, never = outcomes[reversal], outcomes["never"]
    assert not never.merge("ash.birch.1")
    assert outcome.one("ash.birch.1", "reverted")["exact"] is True
    for name in ("ash", "birch"):
        assert outcome.layer(name) == never.layer(name)
        assert outcome.file(f"{name}.landmarks.csv") == never.file(f"{name}.landmarks.csv")
        assert outcome.cells(name) == never.cells(name)
    assert outcome.file("ash.merged.landmarks.csv") == never.file("ash.merged.landmarks.csv")


def test_the_statement_of_a_single_map_is_true(outcomes: Outcomes) -> None:
    reverted = outcomes["single_map"].one("ash.birch.1", "reverted")
    assert reverted["exact"] is False
    left, clean = outcomes["single_map"].cells("ash"), outcomes["alone"].cells("ash")
    nothing = (0, 0, 0, 0)
    contaminated = [key for key in left.keys() | clean.keys() if left.get(key, nothing) != clean.get(key, nothing)]
    assert len(contaminated) == reverted["cells_contaminated"] > 0
    assert reverted["cells_reset"] > 0
    assert reverted["cells_lost"] == 0


def test_viewers_and_files_show_landmarks(outcomes: Outcomes) -> None:
    outcome = outcomes["ledger"]
    (file,) = outcome.folder.glob("*.merge.mcap")
    store = get_typestore(Stores.ROS2_HUMBLE)
    sizes: dict[str, list[int]] = {"/ash/landmarks": [], "/ash/merged/landmarks": []}
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages(topics=list(sizes)):
            assert schema is not None
            assert schema.name == "sensor_msgs/msg/PointCloud2"
            assert channel.message_encoding == "cdr"
            cloud = store.deserialize_cdr(message.data, schema.name)
            assert cloud.header.frame_id == "ash/map"
            assert len(cloud.data) == cloud.width * cloud.point_step
            sizes[channel.topic].append(cloud.width)
    own, merged = sizes.values()
    assert own == sorted(own)  # it goes on mapping
    assert own[-1] >= 15
    assert max(merged) > own[-1]  # birch's landmarks were there, and are gone
    assert merged[-1] < max(merged)
    assert len(outcome.file("ash.landmarks.csv").splitlines()) - 1 >= 15
    merged = outcome.file("ash.merged.landmarks.csv").splitlines()
    assert len(merged) >= len(outcome.file("ash.landmarks.csv").splitlines())
