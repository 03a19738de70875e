"""The simulated radio: what arrives, when, and what does not."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from mapgraft.network.radio import NS_PER_S, Conditions, Partition, Radio, Traffic

S = NS_PER_S


def arrivals(radio, until_ns=10**15):
    return [(d.arrival_ns, d.sender, d.receiver, d.data) for d in radio.due(until_ns)]


def connected(conditions=None, until_ns=10**15, robots=("a", "b", "c")):
    radio = Radio(conditions)
    for one in robots:
        for other in robots:
            if one < other:
                radio.connect(one, other, until_ns)
    return radio


def test_a_perfect_radio_is_instant_and_keeps_the_order():
    radio = connected()
    assert radio.conditions.is_perfect
    for n in range(20):
        assert radio.send("a", "b", bytes([n]), 5 * S)
    assert arrivals(radio) == [(5 * S, "a", "b", bytes([n])) for n in range(20)]
    assert radio.next_ns is None


def test_only_robots_in_contact_hear_each_other():
    radio = Radio()
    radio.connect("a", "b", 10 * S)
    assert radio.hears("b", "a", 10 * S) and not radio.hears("a", "b", 10 * S + 1)
    assert not radio.send("a", "c", b"x", 0) and not radio.send("a", "b", b"x", 11 * S)
    assert radio.neighbours("a", 0) == ["b"] and radio.neighbours("c", 0) == []
    assert arrivals(radio) == [] and radio.fates.out_of_contact == 2


def test_a_contact_that_ends_before_the_arrival_loses_the_message():
    radio = connected(Conditions(latency_ns=2 * S), until_ns=10 * S)
    assert radio.send("a", "b", b"in time", 8 * S) and radio.send("a", "b", b"late", 9 * S)
    assert arrivals(radio) == [(10 * S, "a", "b", b"in time")]


def test_bandwidth_is_one_line_per_sender():
    radio = connected(Conditions(bandwidth_bytes_s=100.0))
    for receiver in "bc":
        radio.send("a", receiver, bytes(50), 0)
    radio.send("b", "a", bytes(10), 0)
    assert [(ns, sender, receiver) for ns, sender, receiver, _ in arrivals(radio)] == [
        (S // 10, "b", "a"),
        (S // 2, "a", "b"),
        (S, "a", "c"),
    ]


def test_what_does_not_leave_in_time_leaves_the_line_to_others():
    radio = connected(Conditions(bandwidth_bytes_s=100.0), until_ns=S)
    assert not radio.send("a", "b", bytes(1000), 0)
    assert radio.send("a", "b", bytes(100), 0)
    assert len(arrivals(radio)) == 1


def test_partitions_separate_groups_for_a_time():
    groups = (frozenset("ab"), frozenset("c"))
    radio = connected(Conditions(latency_ns=S, partitions=(Partition(10 * S, 20 * S, groups),)))
    heard = {pair: [radio.hears(*pair, t * S) for t in (9, 10, 19, 20)] for pair in (("a", "b"), ("a", "c"))}
    assert heard == {("a", "b"): [True] * 4, ("a", "c"): [True, False, False, True]}
    radio.send("a", "c", b"cut off", 9 * S)  # on its way when the partition begins
    radio.send("a", "c", b"after", 20 * S)
    assert [data for *_, data in arrivals(radio)] == [b"after"]


@given(
    conditions=st.builds(
        Conditions,
        latency_ns=st.integers(0, S),
        jitter_ns=st.integers(0, S),
        bandwidth_bytes_s=st.none() | st.floats(10.0, 1e6),
        loss=st.floats(0.0, 0.9),
        duplication=st.floats(0.0, 0.9),
        reordering=st.floats(0.0, 0.9),
        seed=st.integers(0, 99),
    ),
    messages=st.lists(st.tuples(st.sampled_from(("ab", "bc", "ca")), st.integers(0, 5)), max_size=30),
)
def test_equal_seeds_have_equal_fates_and_nothing_is_made_up(conditions, messages):
    told = []
    for _ in range(2):
        radio = connected(conditions)
        for n, (pair, second) in enumerate(sorted(messages, key=lambda m: m[1])):
            radio.send(pair[0], pair[1], bytes([n]), second * S)
        told.append(arrivals(radio))
        fates = radio.fates
        assert fates.sent == len(messages)
        assert len(told[-1]) == fates.delivered == fates.sent - fates.lost + fates.duplicated
    assert told[0] == told[1]
    assert [ns for ns, *_ in told[0]] == sorted(ns for ns, *_ in told[0])


def test_chances_are_what_they_are_said_to_be():
    radio = connected(Conditions(loss=0.3, duplication=0.2, seed=1))
    for _ in range(4000):
        radio.send("a", "b", b"x", 0)
    assert abs(radio.fates.lost / 4000 - 0.3) < 0.03
    assert abs(radio.fates.duplicated / (4000 - radio.fates.lost) - 0.2) < 0.03


def test_messages_that_are_held_up_are_overtaken():
    radio = connected(Conditions(reordering=0.5, held_up_ns=S, seed=3))
    for n in range(10):
        radio.send("a", "b", bytes([n]), 0)
    order = [data[0] for *_, data in arrivals(radio)]
    assert sorted(order) == list(range(10)) and order != list(range(10))
    assert not replace(radio.conditions).is_perfect


def test_bytes_are_counted_by_pair_and_by_kind():
    traffic = Traffic()
    for kind, size in (("hello", 3), ("parts", 40), ("hello", 4)):
        traffic.count("a", "b", kind, size)
    assert traffic.sent == {("a", "b"): 47} and traffic.received == {("b", "hello"): 7, ("b", "parts"): 40}
