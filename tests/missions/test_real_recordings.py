"""The main job on real recordings: whatever stands at the end is right, and everything says why."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

import mapgraft
from mapgraft.contracts import Transform

INTEL_WINDOWS = {"first": (0.0, 676.0, 0.07), "second": (676.0, 1200.0, 0.10), "third": (1200.0, None, 0.07)}


def intel_config(**more) -> dict:
    """The Intel log cut into three robots, each with a map frame of its own that starts at its first pose."""
    robots = {
        name: {
            "source": "intel-corrected",
            "window": {"start_s": start, "end_s": end},
            "map": {"resolution_m": resolution},
        }
        for name, (start, end, resolution) in INTEL_WINDOWS.items()
    }
    return {"robots": robots, "exchange": {"use": "every", "seconds": 120}, **more}


def error_of(T: Transform, truth: Transform) -> tuple[float, float]:
    shift_m, turn_rad = T.difference(truth)
    return shift_m, math.degrees(turn_rad)


@pytest.fixture(scope="session")
def intel_mcap(shared_data, tmp_path_factory) -> Path:
    """The Intel log as MCAP."""
    from mapgraft.recording.writing import convert

    path = tmp_path_factory.mktemp("intel") / "intel-corrected.mcap"
    convert([shared_data / "carmen" / "intel-corrected.log.gz"], path)
    return path


@pytest.fixture(scope="session")
def intel(intel_mcap, tmp_path_factory) -> mapgraft.Result:
    return mapgraft.run([intel_mcap], intel_config(), tmp_path_factory.mktemp("out"))


@pytest.fixture(scope="session")
def intel_truth(intel_mcap) -> dict[str, Transform]:
    from mapgraft.config import parse_config
    from mapgraft.recording.mission import open_mission

    with open_mission([intel_mcap], parse_config(intel_config())) as mission:
        return dict(mission.T_world_map)


def test_intel_what_stands_is_right_and_the_largest_overlap_is_merged(intel, intel_truth):
    standing = intel.standing
    assert {(e.receiver, e.donor) for e in standing.values()} >= {("first", "third"), ("third", "first")}
    for event in standing.values():
        truth = intel_truth[event.receiver].inverse() @ intel_truth[event.donor]
        shift_m, turn_deg = error_of(event.T_receiver_donor, truth)
        assert shift_m <= 0.5 and turn_deg <= 3.0, event.merge_id


def test_intel_every_event_explains_itself(intel):
    assert all(event.reason for event in intel.events if event.kind != "offered")
    assert {"offered", "merged", "verified"} <= {event.kind for event in intel.events}


def test_intel_reverted_by_hand_is_byte_for_byte_the_run_that_never_merged(intel, intel_mcap, tmp_path):
    merge_id = next(event.merge_id for event in intel.events if event.kind == "merged")
    receiver, donor, _ = merge_id.rsplit(".", 2)
    verdicts = [{"merge": e.merge_id, "action": "revert"} for e in intel.events if e.kind == "merged"]
    reverted = mapgraft.run([intel_mcap], intel_config(verdicts=verdicts), tmp_path / "reverted")
    pairs = [[a, b] for a in INTEL_WINDOWS for b in INTEL_WINDOWS if a < b]
    never = mapgraft.run([intel_mcap], intel_config(forbid=pairs), tmp_path / "never")
    assert any(e.kind == "reverted" for e in reverted.events)
    assert not any(e.kind == "merged" for e in never.events)
    for name in INTEL_WINDOWS:
        if not any(e.receiver == name for e in reverted.standing.values()):
            assert reverted.maps[name].layer == never.maps[name].layer
            for suffix in ("pgm", "yaml"):
                one, other = (tmp_path / run / "maps" / f"{name}.{suffix}" for run in ("reverted", "never"))
                assert one.read_bytes() == other.read_bytes()


@pytest.mark.parametrize("reversal", ["single_map", "multi_map"])
def test_intel_the_exactness_statement_is_true(intel_mcap, reversal):
    """Revert one merge in the middle and count the cells that differ from the map that never merged."""
    once = intel_config(reversal=reversal, exchange={"use": "at", "seconds": [400]}, forbid=[["first", "second"], ["second", "third"]])
    made = mapgraft.run([intel_mcap], once)
    merge_id = next((e.merge_id for e in made.events if e.kind == "merged" and e.receiver == "first"), None)
    if merge_id is None:
        pytest.skip("no merge at 400 s")
    reverted = mapgraft.run([intel_mcap], {**once, "verdicts": [{"merge": merge_id, "action": "revert"}]})
    never = mapgraft.run([intel_mcap], {**once, "forbid": [*once["forbid"], ["first", "third"]]})
    said = next(e.exactness for e in reverted.events if e.kind == "reverted" and e.merge_id == merge_id)
    if reversal == "multi_map":
        assert said.exact
        assert reverted.maps["first"].layer == never.maps["first"].layer
    else:
        assert said.cells_reset > 0 and said.cells_contaminated > 0 and not said.exact
