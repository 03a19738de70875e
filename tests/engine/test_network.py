"""Missions on a radio that is slow, loses messages, or is cut; and what robots send each other on it."""

from __future__ import annotations

import pytest

from mapgraft.assembly import network_of
from mapgraft.config import load_config, parse_config
from mapgraft.contracts import ConfigError
from mapgraft.network.radio import Conditions, Partition, Unread
from mapgraft.network.wire import Told, encode
from mapgraft.plugins import load_plugins
from mapgraft.recording.mission import open_mission
from mapgraft.replay import Exchange, Network
from mapgraft_recordings import demo_files

SECOND = 1_000_000_000
PLACES = {"alpha": (0, 2, 5), "bravo": (10, 12, 15), "charlie": (-20, -18, -15)}
SLOW = Conditions(latency_ns=SECOND // 5)


def begun(*names: str) -> list[tuple]:
    return [(0, name, *PLACES[name]) for name in names]


def seen_again(*names: str, until: int) -> list[tuple]:
    return [(second, name, *PLACES[name]) for second in range(1, until) for name in names]


def kinds(memory, receiver: str = "alpha") -> list[str]:
    return [event.kind for event in memory.events if event.receiver == receiver]


def test_a_map_arrives_when_it_does_and_is_merged_then(play):
    memory, _, _ = play(
        *begun("alpha", "bravo"), *seen_again("alpha", "bravo", until=9), meet=(1.5,), network=Network(SLOW)
    )
    at = {event.kind: event.stamp_ns for event in memory.events if event.receiver == "alpha"}
    assert at["offered"] == round(1.7 * SECOND)
    assert at["merged"] == round(2.1 * SECOND)  # hello, want, layer: three times the latency
    assert "confirmed" in kinds(memory)
    assert [event.stamp_ns for event in memory.events] == sorted(event.stamp_ns for event in memory.events)


def test_what_is_lost_is_asked_again_within_the_contact(play):
    lossy = Network(Conditions(latency_ns=SECOND // 100, loss=0.4, seed=5), window_ns=40 * SECOND)
    _, robots, exchange = play(*begun(*PLACES), *seen_again(*PLACES, until=60), meet=(1, 10, 20, 30, 40), network=lossy)
    assert exchange.medium.radio.fates.lost > 5
    assert {name: sorted(robot.merges) for name, robot in robots.items()} == {
        name: sorted(PLACES.keys() - {name}) for name in PLACES
    }


def test_a_mission_is_the_same_on_any_radio_but_for_when_and_how_often(play):
    told = []
    for network in (Network(), Network(SLOW), Network(Conditions(SECOND // 9, SECOND // 3, duplication=0.5, seed=1))):
        memory, robots, _ = play(*begun(*PLACES), *seen_again(*PLACES, until=40), meet=(1, 10, 20), network=network)
        merged = {event.merge_id: event.T_receiver_donor.x_m for event in memory.events if event.kind == "merged"}
        told.append((merged, {name: dict(robot.reversal.own().counts) for name, robot in robots.items()}))
    assert told[0] == told[1] == told[2] and len(told[0][0]) == 6


def test_a_partition_keeps_groups_apart_until_it_ends(play):
    cut = Partition(0, 15 * SECOND, (frozenset({"alpha", "bravo"}), frozenset({"charlie"})))
    memory, _, _ = play(
        *begun(*PLACES), *seen_again(*PLACES, until=40), meet=(5, 20), network=Network(Conditions(partitions=(cut,)))
    )
    first = {(e.receiver, e.donor): e.stamp_ns // SECOND for e in reversed(memory.events) if e.kind == "merged"}
    assert {pair: at for pair, at in first.items() if "charlie" not in pair} == {
        ("alpha", "bravo"): 5,
        ("bravo", "alpha"): 5,
    }
    assert {at for pair, at in first.items() if "charlie" in pair} == {20}


def test_a_third_map_comes_through_who_met_both(play, monkeypatch):
    """alpha and charlie never meet; bravo carries what they tell."""
    pairs = {1: (("alpha", "bravo"), ("bravo", "alpha")), 5: (("bravo", "charlie"), ("charlie", "bravo"))}

    def hold(self, meeting):
        second = meeting.stamp_ns // SECOND
        self.medium.hold(pairs[1] if second % 2 else pairs[5], meeting.stamp_ns)

    monkeypatch.setattr(Exchange, "hold", hold)
    memory, _, exchange = play(*begun(*PLACES), *seen_again(*PLACES, until=40), meet=(11, 12, 23, 24, 35))
    attached = {(event.receiver, event.donor) for event in memory.events if event.kind == "attached"}
    assert attached == {("alpha", "charlie"), ("charlie", "alpha")}
    assert not any(set(pair[:2]) == {"alpha", "charlie"} for pair in exchange.traffic.bytes)
    event = next(event for event in memory.events if event.kind == "attached")
    assert event.bytes_received > 0


def test_what_did_not_change_is_not_sent_again(play):
    sent = []
    for meet in ((1,), (1, 2, 3, 4)):
        _, _, exchange = play(*begun("alpha", "bravo"), (9, "alpha", *PLACES["alpha"]), meet=meet)
        sent.append({kind: size for (_, receiver, kind), size in exchange.traffic.bytes.items() if receiver == "alpha"})
    assert sent[0]["layer"] == sent[1]["layer"] and sent[1]["hello"] > 3 * sent[0]["hello"]


def test_what_comes_for_nothing_is_counted_and_said(play):
    _, _, exchange = play(*begun("alpha", "bravo"), (9, "alpha", *PLACES["alpha"]), meet=(1,))
    assert exchange.traffic.unread == {} and exchange.traffic.sentences() == []
    strange = Told((b"no claim", b"and another"))
    for data in (b"noise", encode(strange), b""):
        exchange.medium.radio.send("bravo", "alpha", data, SECOND)
    exchange.medium.hold((), SECOND)
    assert exchange.traffic.unread == {"alpha": Unread(messages=2, claims=2)}
    assert exchange.traffic.sentences() == [
        "alpha: 2 messages came that cannot be read",
        "alpha: 2 claims came that cannot be read, or above what it keeps",
    ]


def test_a_radio_with_its_faults_is_configured():
    told = parse_config({"radio": {"loss": 0.1, "partitions": [{"start_s": 3, "groups": [["a"], ["b"]]}]}}).radio
    assert told.loss == 0.1 and told.partitions[0].end_s is None
    cut = {"start_s": 3, "end_s": 3, "groups": []}
    for wrong in ({"loss": 1.0}, {"bandwidth_bytes_s": 0}, {"window_s": 0}, {"partitions": [cut]}):
        with pytest.raises(ConfigError):
            parse_config({"radio": wrong})


def test_a_partition_speaks_of_robots_that_there_are():
    config = parse_config({"radio": {"partitions": [{"groups": [["alpha"], ["nobody"]]}]}})
    with pytest.raises(ConfigError, match="no robot nobody"):
        network_of(config.radio, PLACES)
    network = network_of(parse_config({"radio": {"latency_s": 0.2, "previews": True}}).radio, PLACES)
    assert network == Network(Conditions(latency_ns=SECOND // 5), previews=True)


def test_what_is_on_a_topic_is_heard_by_the_missions_clock():
    files, config, _ = demo_files()
    plugins = load_plugins()
    with open_mission(files, load_config(config), plugins=plugins) as mission:
        seen = [seen.stamp_ns for seen in mission.places() if seen.robot == "alpha"]
        (topic,) = next(robot.topics for robot in mission.robots if robot.name == "alpha")
        heard = list(mission.signals((topic,)))
        assert list(mission.signals(("/nothing",))) == []
    assert len(heard) >= len(seen) > 100 and {signal.topic for signal in heard} == {topic}
    assert abs(heard[0].stamp_ns - seen[0]) < SECOND and all(signal.text == "" for signal in heard)


def test_a_map_that_did_not_come_is_asked_for_at_the_next_meeting(play):
    """Nobody has mapped on since, so only what was lost is a reason to ask again."""
    cut = Partition(round(1.3 * SECOND), 5 * SECOND, (frozenset({"alpha"}), frozenset({"bravo"})))
    slow = Conditions(latency_ns=SECOND // 5, partitions=(cut,))
    memory, robots, _ = play(*begun("alpha", "bravo", "charlie"), (9, "charlie", *PLACES["charlie"]), meet=(1, 6),
                             network=Network(slow, window_ns=2 * SECOND))  # fmt: skip
    assert kinds(memory).count("offered") == 2  # of bravo and charlie, once each
    assert "bravo" in robots["alpha"].merges
    (event,) = [e for e in memory.events if (e.kind, e.receiver, e.donor) == ("merged", "alpha", "bravo")]
    assert event.stamp_ns > 6 * SECOND


def test_a_robot_that_fails_while_it_is_asked_holds_nobody_up(play, monkeypatch):
    """Its map is wanted, and it cannot send it: the others say so and go on."""

    def broken(self, layer):
        raise OSError("its disk is full")

    for method in ("parts", "encode"):
        monkeypatch.setattr(f"beacons.Beacons.{method}", broken)
    for network in (Network(), Network(SLOW)):
        memory, robots, _ = play(*begun(*PLACES), (9, "alpha", *PLACES["alpha"]), meet=(1, 5), network=network)
        failed = [robot.failed for robot in robots.values() if robot.failed]
        assert len(failed) >= 2 and all("its disk is full" in why for why in failed)
        said = [e.reason for e in memory.events if e.kind == "unmatched"]
        assert network == Network(SLOW) or any("its disk is full" in reason for reason in said)
