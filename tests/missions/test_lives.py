"""A robot that is started again in the middle of a mission: two sources, each true in its own frame."""

from __future__ import annotations

import json

import mapgraft
from mapgraft_recordings import demo_files

FILES = demo_files()[0][:2]


def test_the_new_life_is_merged_beside_the_old_one(tmp_path):
    """The recording's frame is the same in truth, so the new life must lie where the robot would without a restart."""
    config = {
        "robots": {"alpha": {"map": {"resolution_m": 0.1}}},
        "exchange": {"use": "at", "seconds": [40, 120]},
        "mission": {"end_s": 131},
    }
    whole = mapgraft.run(FILES, {**config, "exchange": {"use": "at", "seconds": [120]}})
    config["robots"]["alpha"]["restarts"] = [100.0]
    result = mapgraft.run(FILES, config, tmp_path / "out", verify_ledger=True)
    assert all(finding.sound for finding in result.ledgers) and len(result.ledgers) == 3
    assert {snapshot.metadata.resolution_m for name, snapshot in result.maps.items() if name != "bravo"} == {0.1}
    merged = [(event.donor, event.donor_epoch) for event in result.events if event.kind == "merged"]
    assert ("alpha", 1) in merged and ("alpha~2", 2) in merged
    standing = {event.donor: event for event in result.standing.values() if event.receiver == "bravo"}
    (true,) = [event for event in whole.standing.values() if event.receiver == "bravo"]
    shift_m, turn_rad = standing["alpha~2"].T_receiver_donor.difference(true.T_receiver_donor)
    assert shift_m < 0.5 and turn_rad < 0.02
    (told,) = [event for event in result.events if event.kind == "renamed"]
    assert told.receiver == "alpha" and told.reason.endswith("it is alpha~2")
    assert not [event for event in result.events if event.receiver == "alpha" and event.stamp_ns > told.stamp_ns]
    robots = json.loads((tmp_path / "out" / "summary.json").read_text())["robots"]
    assert {name: one["files_as"] for name, one in robots.items() if name != "bravo"} == {
        "alpha": "alpha",
        "alpha~2": "alpha_2",
    }
    page = (tmp_path / "out" / "report.html").read_text()
    assert "its map frame has begun anew: from now on it is alpha~2" in page
