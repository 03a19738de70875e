"""From a recording to a decision table: collect examples of a real log, set thresholds, and decide by them."""

from __future__ import annotations

import json
from pathlib import Path

from mapgraft.calibrate import read_labels
from mapgraft.cli import invoke


def test_examples_of_a_real_log_set_thresholds_that_the_engine_goes_by(shared_data: Path, tmp_path: Path) -> None:
    log = str(shared_data / "carmen" / "intel-corrected.log.gz")
    collecting, out = str(tmp_path / "collecting.yaml"), tmp_path / "out"
    drawn = ["--scans", "30", "--further", "20", "--seed", "3", "--resolution", "0.1", "--no-baseline", "--quiet"]
    assert invoke(["calibrate", "--collecting", collecting]) == 0
    known = ["--pairs", "12", "--rules", collecting, "--examples", str(tmp_path / "known")]
    assert invoke(["evaluate", log, *drawn, *known]) == 0
    labels = read_labels([tmp_path / "known"])
    assert len(labels.labelled) == 12
    assert {example.right for example in labels.examples} == {True, False}
    assert all(len(example.looks) > 1 for example in labels.examples)  # all were merged, and watched to the end
    assert not any(example.reverted for example in labels.examples)
    rates = [part for name in ("accept", "confirm", "revert") for part in (f"--false-{name}", "0.4")]
    assert invoke(["calibrate", str(tmp_path / "known"), "-o", str(out), *rates]) == 0
    found = json.loads((out / "calibration.json").read_text(encoding="utf-8"))["rules"][0]
    above = found["groups"][0]["accept"]["above"]
    assert found["other_buildings"]["accept"]["verdict"] == "none"  # of one building
    fresh = ["--pairs", "6", "--rules", str(out / "rules.yaml"), "--examples", str(tmp_path / "fresh")]
    assert invoke(["evaluate", log, *drawn[:4], "--seed", "4", *drawn[6:], *fresh]) == 0
    for example in read_labels([tmp_path / "fresh"]).examples:
        assert bool(example.looks) == (example.numbers["posterior.log_odds"] > above)
