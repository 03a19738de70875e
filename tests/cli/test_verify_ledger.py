"""``run --verify-ledger``: every layer and map is computed anew and compared, and what differs is found."""

from __future__ import annotations

import json

import pytest

from mapgraft.assembly import assemble
from mapgraft.audit import audit
from mapgraft.cli import invoke
from mapgraft.decision import build_table
from mapgraft.job import as_config, demo
from mapgraft.outputs.null_sink import NullSink
from mapgraft.plugins import load_plugins
from mapgraft.recording.mission import open_mission
from mapgraft.replay import replay


@pytest.mark.parametrize("reversal", ("ledger", "multi_map", "single_map"))
def test_the_summary_says_that_all_is_equal(tmp_path, capsys, reversal):
    out = tmp_path / "out"
    code = invoke(["run", "-q", "--verify-ledger", "--reversal", reversal, "--end", "65", "-o", str(out)])
    shown = capsys.readouterr().out
    assert code == 0
    for robot in ("alpha", "bravo", "charlie"):
        assert f"ledger of {robot}: 65 observations" in shown
    findings = json.loads((out / "summary.json").read_text())["ledgers"]
    assert [(finding["robot"], finding["sound"]) for finding in findings] == [
        ("alpha", True), ("bravo", True), ("charlie", True)
    ]  # fmt: skip


@pytest.fixture(scope="module")
def played():
    files, config_file = demo()
    config, plugins = as_config({"mission": {"end_s": 65}, "exchange": {"use": "every", "seconds": 30}}), load_plugins()
    assert config_file is not None
    with open_mission(files, config, plugins=plugins) as mission:
        assembly = assemble(mission, config, plugins, build_table(plugins), NullSink())
        replay(mission.observations(), assembly.robots, assembly.exchange, NullSink())
        kinds = {robot.name: robot.kinds for robot in mission.robots}
        yield assembly.robots, lambda: audit(mission.observations(), kinds, assembly.robots, config, plugins)


def test_what_was_tampered_with_is_found(played):
    robots, check = played
    assert all(finding.sound for finding in check())
    receiver = next(robot for _, robot in sorted(robots.items()) if robot.merges)
    merge_id, contribution = next(iter(receiver.reversal.contributions.items()))
    receiver.map_type.reset(
        contribution.layer, receiver.map_type.region(contribution.layer),
        receiver.map_type.region(receiver.map_type.new_layer()),
    )  # fmt: skip
    (found,) = [finding for finding in check() if not finding.sound]
    assert found.robot == receiver.name
    assert f"the contribution {merge_id} differs from the donor's layer placed anew" in found.sentence
    own = receiver.reversal.offered_layer()
    receiver.map_type.reset(own, receiver.map_type.region(own), receiver.map_type.region(receiver.map_type.new_layer()))
    sentence = next(finding.sentence for finding in check() if finding.robot == receiver.name)
    assert "its own layer of 65 observations differs from one integrated anew" in sentence
    assert "its fused map differs from one computed anew from the layers" in sentence
