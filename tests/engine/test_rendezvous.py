"""What a robot keeps of meetings, what it tells of them, and that both sides come to know the same."""

from __future__ import annotations

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import MapError, Observation, Transform
from mapgraft.graph.claims import Source
from mapgraft.network.meetings import NOTHING, Meetings, Met, digest_of
from mapgraft.network.wire import decode, encode, sealed
from mapgraft.recording.poses.rigid import planar
from mapgraft.rendezvous import MOST, Record, Rendezvous, Seen, believable

S = 1_000_000_000
A, B = Source("a", 1), Source("b", 1)
NUMBERS = st.floats(-1e5, 1e5)
SEEN = st.builds(Seen, NUMBERS, NUMBERS, st.one_of(st.just(math.nan), NUMBERS), st.just(0.5), st.just(0.1))
RECORDS = st.builds(
    Record, st.integers(-(1 << 62), 1 << 62), st.builds(planar, NUMBERS, NUMBERS, NUMBERS), st.none() | SEEN
)


def driven(seconds: int, speed: float = 1.0) -> Rendezvous:
    book = Rendezvous()
    for second in range(seconds):
        T = Transform.planar(speed * second, 0.0, 0.0)
        book.moved(Observation("a", second * S, second * S, "scan", "scan", None, T, T))
    return book


def seen(x: float = 1.0) -> Seen:
    return Seen(x, 0.0, math.nan, 0.2, 0.1)


def test_it_knows_where_it_was_between_what_it_observed():
    book = driven(10)
    assert book.pose_at(3 * S)[0] == 3.0 and book.pose_at(3 * S + S // 2)[0] == 3.5
    assert book.pose_at(9 * S + S // 4)[0] == 9.0
    assert book.pose_at(20 * S) is None and Rendezvous().pose_at(0) is None
    gap = driven(2)
    T = Transform.identity()
    gap.moved(Observation("a", 9 * S, 9 * S, "scan", "scan", None, T, T))
    assert gap.pose_at(5 * S) is None


def test_a_corrected_robot_was_elsewhere():
    book = driven(10)
    T = Transform.planar(7.0, 0.0, 0.0)
    book.corrected([Observation("a", k * S, k * S, "scan", "scan", None, T, T) for k in range(10)])
    assert book.pose_at(3 * S)[0] == 7.0


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 1000))
def test_of_one_robot_so_many_are_kept_over_the_whole_time(count):
    book = driven(1100)
    for second in range(count):
        book.sighted("b", second * S, seen())
    stamps = [record.stamp_ns // S for record in book.records("b")]
    assert len(stamps) <= MOST and stamps[0] == 0 and (count <= MOST or len(stamps) >= MOST // 4)
    assert count - stamps[-1] <= 1 + 4 * count // MOST


def talk(one: Meetings, other: Meetings, lost: random.Random | None = None) -> int:
    """Both meet once; how many messages there were."""
    sent = 0
    waiting = [(A, one, other, "b", m) for m in one.greeting(A, "b", B)]
    waiting += [(B, other, one, "a", m) for m in other.greeting(B, "a", A)]
    while waiting:
        _, sender, receiver, _, message = waiting.pop(0)
        sent += 1
        assert sent < 50
        if lost is not None and lost.random() < 0.4:
            continue
        me, peer = (B, "a") if receiver is other else (A, "b")
        waiting += [(me, receiver, sender, peer, m) for m in receiver.heard(me, peer, decode(encode(message)), 0)]
    return sent


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(0, 99), max_size=5), st.lists(st.integers(0, 99), max_size=5), st.integers(0, 1000))
def test_whatever_is_lost_both_know_the_same_in_the_end_and_are_quiet(by_a, by_b, seed):
    heard: list[Source] = []
    one, other = Meetings(driven(100), lambda s, _: heard.append(s)), Meetings(driven(100, 2.0), lambda s, _: None)
    for second in by_a:
        one.book.sighted("b", second * S, seen(second))
    for second in by_b:
        other.book.sighted("a", second * S, seen(second))
    lost = random.Random(seed)
    for _ in range(6):
        talk(one, other, lost)
    talk(one, other)
    assert talk(one, other) == 0
    mine, theirs = one.book.sightings(B), other.book.sightings(A)
    assert len(mine) == len(theirs) == len({*by_a}) + len({*by_b})
    told = {(x.stamp_ns, not x.by_donor, x.T_donor_base.x_m, x.T_receiver_base.x_m, x.x_m) for x in mine}
    assert told == {(x.stamp_ns, x.by_donor, x.T_receiver_base.x_m, x.T_donor_base.x_m, x.x_m) for x in theirs}
    assert bool(heard) == bool(by_a or by_b)


def test_nothing_is_said_where_nobody_saw_anybody():
    one, other = (Meetings(driven(9), lambda s, ns: pytest.fail("nothing is new")) for _ in range(2))
    assert talk(one, other) == 0 and digest_of(()) == NOTHING


@settings(max_examples=40, deadline=None)
@given(st.lists(RECORDS, max_size=2 * MOST))
def test_what_is_told_arrives_as_it_was(records):
    met = Met(A, tuple(records), bytes(8), reply=len(records) % 2 == 1)
    again = decode(encode(met))
    assert isinstance(again, Met) and repr(again) == repr(met)  # NaN is not equal to itself


@pytest.mark.parametrize(
    "wrong",
    [
        Record(0, (math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)),
        Record(0, (0.0, math.nan, 0.0, 0.0, 0.0, 0.0, 1.0)),
        Record(0, (0.0, 0.0, 1e9, 0.0, 0.0, 0.0, 1.0)),
        Record(0, (0.0, 0.0, 0.0, math.nan, 0.0, 0.0, 1.0)),
        Record(0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0)),
        Record(0, planar(0, 0, 0), Seen(0.0, math.nan, 0.0, 1.0, 0.1)),
        Record(0, planar(0, 0, 0), Seen(0.0, 0.0, 0.0, 1.0, math.nan)),
        Record(0, planar(0, 0, 0), Seen(0.0, 0.0, 0.0, -1.0, 0.1)),
        Record(0, planar(0, 0, 0), Seen(math.inf, 0.0, 0.0, 1.0, 0.1)),
    ],
)
def test_what_cannot_be_is_not_read(wrong):
    data = encode(Met(A, (wrong,)))
    assert sealed(data[:-8]) == data
    with pytest.raises(MapError):
        decode(data)


def test_who_is_unsure_of_a_heading_tells_none():
    assert believable(Seen(0, 0, math.nan, 0.1, math.nan)) and not believable(Seen(0, 0, 1.0, 0.1, math.nan))
