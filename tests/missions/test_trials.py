"""A merge that contradicts others is measured on the two maps themselves, which a robot that made it holds."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mapgraft.assembly import assemble
from mapgraft.config import parse_config
from mapgraft.contracts import Meeting, Transform
from mapgraft.decision import build_table
from mapgraft.graph.claims import Claim
from mapgraft.outputs.memory_sink import MemorySink
from mapgraft.plugins import load_plugins
from mapgraft.recording.mission import open_mission
from mapgraft_recordings import demo_files

FAR = Transform.planar(5.0, 2.0, 1.5)


@pytest.fixture
def met():
    """alpha and bravo of the demo after they have mapped and met once; they agree."""
    plugins, sink = load_plugins(), MemorySink()
    config = parse_config({"exchange": {"use": "at", "seconds": [1e6]}})
    with open_mission(demo_files()[0][:2], config, plugins=plugins) as mission:
        assembly = assemble(mission, config, plugins, build_table(plugins, config.rules), sink)
        for observation in mission.observations():
            assembly.robots[observation.robot].observe(observation)
    assembly.exchange.hold(Meeting(observation.stamp_ns))
    return assembly.robots, sink, observation.stamp_ns


def moved(claim: Claim, off: Transform) -> Claim:
    return replace(claim, revision=claim.revision + 1, T_receiver_donor=off @ claim.T_receiver_donor, support=6.0)


def test_a_right_merge_is_not_taken_for_wrong_because_somebody_is_surer_of_another_place(met):
    """bravo's word is as good as alpha's; what alpha measures decides."""
    robots, _, stamp_ns = met
    alpha = robots["alpha"]
    right = alpha.claims.of(alpha.graph.me, robots["bravo"].graph.me)
    back = alpha.claims.of(robots["bravo"].graph.me, alpha.graph.me)
    assert right is not None and back is not None
    alpha.claims.add(moved(back, FAR))
    alpha.heard(stamp_ns)
    (merge,) = alpha.merges.values()
    assert merge.trial is not None and merge.trial.standing == 6.0
    assert merge.trial.rivals == () or max(merge.trial.rivals) < 0.0
    alpha.claims.add(replace(moved(back, Transform.identity()), revision=back.revision + 2))
    alpha.heard(stamp_ns)
    assert merge.trial is None  # it contradicts nothing any more


def test_a_wrong_merge_is_found_out_in_a_single_loop(met):
    robots, sink, stamp_ns = met
    alpha, bravo = robots["alpha"], robots["bravo"]
    (merge,) = alpha.merges.values()
    meeting = merge.meeting
    lie = replace(merge.match, T_receiver_donor=FAR @ merge.match.T_receiver_donor, evidence={})
    grafted = alpha.attempts.graft(merge.tools, meeting, lie)
    alpha.reversal.replace(merge.merge_id, grafted.contribution)
    merge.replace(grafted)
    merge.state = "confirmed"
    before = len(sink.events)
    alpha.heard(stamp_ns)
    assert not alpha.merges and bravo.merges
    (event,) = [event for event in sink.events[before:] if event.kind == "reverted"]
    assert event.by == "consistency" and "measured on both maps" in event.reason
    assert event.evidence["trial_log_odds"] < 0.0 < event.evidence["trial_log_odds.elsewhere"]
    assert event.evidence["loops_inconsistent"] == 1.0
