"""When robots meet that are near each other, and when a topic says so."""

from __future__ import annotations

import pytest

from mapgraft.contracts import ConfigError, Signal, Situation, Transform
from mapgraft_standard.policies import Range, Topic

S = 1_000_000_000


def at(x_m: float, y_m: float = 0.0) -> Transform:
    return Transform.planar(x_m, y_m, 0.3)


class Walk:
    """Asks a policy second by second, with robots at given places of one world."""

    def __init__(self, policy, T_world_map=None, T_receiver_donor=None):
        self.policy, self.world, self.merged = policy, T_world_map, T_receiver_donor or {}
        self.now_ns = 0

    def to(self, second: float, ending=False, **places):
        previous, self.now_ns = self.now_ns, round(second * S)
        world = {name: Transform.identity() for name in places} if self.world is None else self.world
        told = Situation(0, previous, self.now_ns, places, world, ending, self.merged)
        return [(meeting.stamp_ns / S, meeting.pairs) for meeting in self.policy.due(told)]


BOTH = (("a", "b"), ("b", "a"))


def test_robots_meet_when_they_come_near_and_every_so_often_while_they_are():
    walk = Walk(Range(radius_m=5, seconds=10))
    assert walk.to(1, a=at(0), b=at(20)) == []
    assert walk.to(2, a=at(0), b=at(4)) == [(2.0, BOTH)]
    assert walk.to(3, a=at(0), b=at(4)) == [] == walk.to(11, a=at(0), b=at(4))
    assert walk.to(12, a=at(0), b=at(3)) == [(12.0, BOTH)]
    assert walk.to(13, a=at(0), b=at(30)) == []
    assert walk.to(14, a=at(0), b=at(3)) == [(14.0, BOTH)]  # they come near again


def test_it_looks_once_per_second_however_often_it_is_asked():
    walk = Walk(Range(radius_m=5))
    assert walk.to(0.4, a=at(0), b=at(1)) == [] == walk.to(0.9, a=at(0), b=at(1))
    assert walk.to(3.7, a=at(0), b=at(1)) == [(3.0, BOTH)]


def test_at_the_end_meets_who_is_near():
    walk = Walk(Range(radius_m=5))
    assert walk.to(1, a=at(0), b=at(1), c=at(50)) == [(1.0, BOTH)]
    assert walk.to(1.2, ending=True, a=at(0), b=at(1), c=at(50)) == [(1.2, BOTH)]


def test_positions_are_in_each_robots_own_map():
    world = {"a": Transform.identity(), "b": Transform.planar(100, 0, 0)}
    assert Walk(Range(radius_m=5), world).to(1, a=at(0), b=at(0)) == []
    assert Walk(Range(radius_m=5), world).to(1, a=at(98), b=at(0)) == [(1.0, BOTH)]


@pytest.mark.parametrize(("unplaced", "met"), [("apart", []), ("together", [(1.0, BOTH)])])
def test_who_is_nowhere_is_as_the_configuration_says(unplaced, met):
    assert Walk(Range(radius_m=5, unplaced=unplaced), {}).to(1, a=at(0), b=at(0)) == met


def test_estimated_positions_go_by_merges_and_through_others():
    merged = {("a", "c"): Transform.planar(10, 0, 0), ("b", "c"): Transform.planar(-20, 0, 0)}  # b lies at 30 in a
    for places, pairs in (((30.0, 0.0), BOTH), ((0.0, 0.0), None)):
        walk = Walk(Range(radius_m=5, positions="estimated"), {}, merged)
        met = walk.to(1, a=at(places[0]), b=at(places[1]))
        assert met == ([(1.0, pairs)] if pairs else [])


def test_a_topic_says_who_meets():
    policy = Topic(topic="/contacts")
    assert policy.topics == ("/contacts",)
    policy.hear(
        [Signal("/contacts", 5 * S, ""), Signal("/contacts", 2 * S, "b, a nobody"), Signal("/contacts", 9 * S, "")]
    )
    walk = Walk(policy)
    places = {"a": at(0), "b": at(0), "c": at(0)}
    assert walk.to(1, **places) == []
    assert walk.to(4, **places) == [(2.0, BOTH)]
    assert walk.to(9, **places) == [(5.0, None), (9.0, None)]
    assert walk.to(9, ending=True, **places) == []


def test_a_topic_may_add_a_meeting_at_the_end():
    policy = Topic(topic="/contacts", at_end=True)
    policy.hear([Signal("/contacts", 0, "")])
    walk = Walk(policy)
    assert walk.to(1, a=at(0)) == [(0.0, None)]
    assert walk.to(1, ending=True, a=at(0)) == [(1.0, None)]


@pytest.mark.parametrize(
    "make",
    [
        lambda: Range(radius_m=0),
        lambda: Range(seconds=float("inf")),
        lambda: Range(check_s=-1),
        lambda: Range(positions="guessed"),
        lambda: Range(unplaced="here"),
        Topic,
        lambda: Topic(topic="/x").hear([]),
    ],
)
def test_impossible_parameters_are_refused(make):
    with pytest.raises(ConfigError, match="the exchange policy"):
        make()
