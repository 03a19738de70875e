"""Whatever the network does, robots that have heard the same converge, and their maps are those computed anew.

The first of ten thousand lives; ``tests/bench/bench_interleavings.py`` lives them all.
"""

from __future__ import annotations

import pytest
from interleavings import conditions_of, live
from swarm import Swarm

LIVES, AT_ONCE = 48, 8


@pytest.mark.parametrize("first", range(0, LIVES, AT_ONCE))
def test_random_lives_end_as_computed_anew(first: int) -> None:
    for seed in range(first, first + AT_ONCE):
        assert live(seed).disagreements() == [], f"life {seed}"


@pytest.mark.parametrize("seed", [531])
def test_lives_that_once_ended_otherwise(seed: int) -> None:
    """531: a robot that is no more had lost parts before the only one that holds its last version looked at it."""
    assert live(seed).disagreements() == []


def test_lives_are_eventful() -> None:
    """A property that nothing happens to would hold of anything."""
    swarms = [live(seed) for seed in range(10)]
    assert sum(swarm.lived.lost for swarm in swarms) > 20
    assert any(swarm.lived.duplicated for swarm in swarms)
    assert sum(len(robot.reversal.contributions) for swarm in swarms for robot in swarm.robots.values()) > 10
    states = {claim.state for swarm in swarms for robot in swarm.robots.values() for claim in robot.claims}
    assert states == {"provisional", "confirmed", "reverted"}


def test_the_same_seed_lives_the_same_life() -> None:
    first, second = live(3), live(3)
    assert first.traffic.bytes == second.traffic.bytes
    digests = [[robot.claims.digest() for robot in swarm.robots.values()] for swarm in (first, second)]
    assert digests[0] == digests[1]


def test_what_is_computed_anew_is_something_else_where_something_is_missing() -> None:
    swarm = Swarm()
    for address in "abc":
        robot = swarm.add(address)
        for _ in range(3):
            robot.observe()
    swarm.heal()
    assert swarm.disagreements() == []
    swarm.robots["b"].observe()
    assert len(swarm.disagreements()) == 2  # the others have not heard of it
    swarm.heal()
    assert swarm.disagreements() == []


def test_networks_are_bad_in_every_way() -> None:
    from random import Random

    drawn = [conditions_of(Random(seed), list("abcd")) for seed in range(40)]
    for trouble in ("latency_ns", "jitter_ns", "bandwidth_bytes_s", "loss", "duplication", "reordering", "partitions"):
        assert 0 < sum(bool(getattr(conditions, trouble)) for conditions in drawn) < 40
