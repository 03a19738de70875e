"""Real maps that come in through a third robot: where they lie, and that they leave no trace."""

from __future__ import annotations

import math
from collections.abc import Iterator

import around
import numpy as np
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pytest

import mapgraft
from mapgraft.assembly import Assembly, assemble
from mapgraft.config import parse_config
from mapgraft.contracts import Meeting
from mapgraft.decision import build_table
from mapgraft.outputs.null_sink import NullSink
from mapgraft.outputs.read_back import read_events
from mapgraft.plugins import Origin, load_plugin, load_plugins
from mapgraft.recording.mission import open_mission
from mapgraft.robot import Robot
from mapgraft.standing import Grounds

AROUND = ("robot1", "robot2"), ("robot2", "robot1"), ("robot2", "robot3"), ("robot3", "robot2")


@pytest.fixture(scope="module")
def met(shared_data) -> Iterator[Assembly]:
    """Robots that have mapped; the second has met both others, who have not met each other."""
    bags = [shared_data / "bags/three_robots_sim" / f"robot{n}.bag" for n in (1, 2, 3)]
    config = parse_config({"exchange": {"use": "at", "seconds": [1e6], "through": "provisional"}})
    plugins = load_plugins()
    with open_mission(bags, config, plugins=plugins) as mission:
        assembly = assemble(mission, config, plugins, build_table(plugins, None), NullSink())
        for observation in mission.observations():
            assembly.robots[observation.robot].observe(observation)
    assembly.exchange.hold(Meeting(observation.stamp_ns, AROUND))
    yield assembly


@pytest.fixture(scope="module")
def written(shared_data, tmp_path_factory) -> mapgraft.Result:
    """A whole run in which only neighbours in a row meet."""
    plugins = load_plugins()
    load_plugin(plugins, around, Origin("around", "around", "1.0"))
    bags = [shared_data / "bags/three_robots_sim" / f"robot{n}.bag" for n in (1, 2, 3)]
    exchange = {"use": "neighbours", "row": ["robot1", "robot2", "robot3"], "through": "provisional"}
    out = tmp_path_factory.mktemp("row") / "out"
    return mapgraft.run(bags, {"exchange": exchange}, out, plugins=plugins, verify_ledger=True)


def test_what_is_attached_is_written_and_shown(written):
    attached = {(event.receiver, event.donor): event for event in written.attached.values()}
    assert set(attached) == {("robot1", "robot3"), ("robot3", "robot1")}
    assert all(len(event.through) == 2 for event in attached.values())
    assert {(event.receiver, event.donor) for event in written.standing.values()} == set(AROUND)
    (recording,) = written.folder.glob("*.merge.mcap")
    assert [event.through for event in read_events(recording)] == [event.through for event in written.events]
    table = ds.dataset(written.folder / "events", partitioning="hive").to_table()
    told = table.filter(pc.equal(table["kind"].cast("string"), "attached"))
    assert told["through"].to_pylist()[0] == list(next(e.through for e in written.events if e.kind == "attached"))
    page = (written.folder / "report.html").read_text(encoding="utf-8")
    assert f"robot3 (by {', '.join(attached['robot1', 'robot3'].through)})" in page
    assert all(finding.sound for finding in written.ledgers)


def test_what_is_attached_connects_nothing_by_itself(written):
    chains = {(row["target"], row["source"]): row for row in written.transforms_table.to_pylist()}
    assert chains["robot1", "robot3"]["merges"] == ["robot1.robot2.1", "robot2.robot3.1"]


def fused(robot: Robot) -> tuple[bytes, tuple[float, ...]]:
    dense = robot.reversal.fused().dense()
    return dense.log_odds.tobytes(), (*dense.origin_m, *dense.log_odds.shape)


def test_a_map_comes_in_through_a_robot_that_has_met_both(met, pair_truth):
    (merge,) = met.robots["robot1"].standing.attached.values()
    assert merge.donor == "robot3"
    assert merge.chain is not None
    assert len(merge.chain.claims) == 2
    T_1_2 = pair_truth("three_robots_sim_robot1", "three_robots_sim_robot2")
    T_2_3 = pair_truth("three_robots_sim_robot2", "three_robots_sim_robot3")
    shift_m, turn_rad = merge.comparison.T_receiver_donor.difference(T_1_2 @ T_2_3)
    assert shift_m <= 0.5
    assert math.degrees(turn_rad) <= 5.0
    told = [event for event in met.history.events if event.kind == "attached"]
    assert {(event.receiver, event.donor) for event in told} == {("robot1", "robot3"), ("robot3", "robot1")}


def test_the_layer_that_was_passed_on_is_the_donors_own(met):
    first, third = met.robots["robot1"], met.robots["robot3"]
    (merge,) = first.standing.attached.values()
    placed = first.map_type.place(third.reversal.offered_layer(), merge.comparison.T_receiver_donor)
    contribution = first.reversal.contributions[merge.merge_id]
    assert first.map_type.encode(contribution.layer) == first.map_type.encode(placed)
    assert contribution.provenance == third.own.provenance


def test_both_ways_round_say_the_same(met):
    T_1_3 = next(iter(met.robots["robot1"].standing.attached.values())).comparison.T_receiver_donor
    T_3_1 = next(iter(met.robots["robot3"].standing.attached.values())).comparison.T_receiver_donor
    assert np.allclose((T_1_3 @ T_3_1).matrix, np.eye(4), atol=1e-3)


def test_attached_again_it_is_the_same_to_the_bit(met):
    first = met.robots["robot1"]
    before = fused(first)
    (source,) = first.standing.attached
    first.graph.attachments.detach(source, "for a while", 1)
    assert fused(first) != before
    first.heard(2)
    assert fused(first) == before


def test_a_revert_far_away_leaves_no_trace(met):
    """The last one: it takes the merges apart."""
    first = met.robots["robot1"]
    with_both = fused(first)
    (merge,) = first.standing.attached.values()
    contribution = first.reversal.contributions[merge.merge_id]
    for receiver, donor in (("robot2", "robot3"), ("robot3", "robot2")):
        robot = met.robots[receiver]
        robot.standing.revert(robot.merges[donor], 1, Grounds("it is wrong", "test"))
    assert fused(first) == with_both
    everybody = [claim for robot in met.robots.values() for claim in told_by(robot)]
    first.claims.join(everybody)
    first.heard(1)
    assert not first.standing.attached
    gone = next(e for e in reversed(met.history.events) if e.kind == "detached" and e.receiver == "robot1")
    assert gone.exactness is not None
    assert gone.exactness.exact
    assert "was reverted by test" in gone.reason
    left = first.map_type.view(
        first.reversal.offered_layer(), [first.reversal.contributions["robot1.robot2.1"]]
    ).dense()
    assert fused(first)[0] == left.log_odds.tobytes()
    assert contribution.provenance.source == "robot3"


def told_by(robot: Robot):
    robot.graph.publish(1)
    return list(robot.claims)
