"""Robots that begin anew in another map frame, and robots of one name: each is a source of its own."""

from __future__ import annotations

import pytest

from mapgraft.graph.claims import Source
from mapgraft.lives import base_name, life_name
from mapgraft.network.medium import Medium
from mapgraft.network.robots import node_of
from mapgraft.network.wire import Copy
from mapgraft.persons import Hand

SECOND = 1_000_000_000
PLACES = {"alpha": (0, 2, 5), "bravo": (10, 12, 15), "alpha~2": (30, 32, 35)}


def begun(second: int, *names: str) -> list[tuple]:
    return [(second, name, *PLACES[name]) for name in names]


def seen(*names: str, first: int, until: int) -> list[tuple]:
    return [one for second in range(first, until) for one in begun(second, *names)]


@pytest.fixture
def anew(play):
    """alpha begins anew at 20 s."""

    def run(**how):
        observations = [*seen("alpha", "bravo", first=0, until=20), *seen("alpha~2", "bravo", first=20, until=40)]
        return play(*observations, follows={"alpha~2": "alpha"}, **how)

    return run


def test_names_of_lives():
    assert [life_name("alpha", life) for life in (1, 2)] == ["alpha", "alpha~2"]
    assert base_name("alpha~2") == base_name("alpha") == "alpha"


def test_what_it_mapped_before_stays_and_the_new_life_starts_unmerged(anew):
    memory, robots, _ = anew(meet=(5, 30))
    assert sorted(robots["bravo"].merges) == ["alpha", "alpha~2"]
    assert sorted(robots["alpha~2"].merges) == ["bravo"]
    before = [event for event in memory.events if event.stamp_ns < 20 * SECOND]
    assert not any("alpha~2" in (event.receiver, event.donor) for event in before)
    after = [event for event in memory.events if event.stamp_ns > 20 * SECOND]
    assert not any(event.receiver == "alpha" for event in after)
    (told,) = [event for event in memory.events if event.kind == "renamed"]
    assert (told.receiver, told.stamp_ns) == ("alpha", 20 * SECOND)
    assert told.reason == "its map frame has begun anew: from now on it is alpha~2"


@pytest.mark.parametrize(
    ("forbidden", "merged"),
    [
        (("alpha", "bravo"), []),
        (("bravo", "alpha"), []),
        (("alpha~2", "bravo"), ["alpha"]),  # of one life only this is said
        (("alpha~3", "bravo"), ["alpha", "alpha~2"]),
    ],
)
def test_whom_a_person_forbids_is_forbidden_in_every_life(anew, forbidden, merged):
    hand = Hand(forbidden=frozenset([frozenset(forbidden)]))
    _, robots, _ = anew(meet=(5, 30, 35), hand=hand)
    assert sorted(robots["bravo"].merges) == merged
    assert list(robots["alpha~2"].merges) == (["bravo"] if "alpha~2" in merged else [])


def test_the_old_map_comes_to_the_new_life_through_others(anew):
    _, robots, _ = anew(meet=(5, 30, 35))
    assert [source.name for source in robots["alpha~2"].standing.attached] == ["alpha"]


def test_nobody_hears_a_life_that_has_ended_or_not_begun(anew):
    _, robots, exchange = anew(meet=(5,))
    assert not any("alpha~2" in pair for pair in exchange.traffic.sent)
    assert robots["alpha"].retired and not robots["alpha~2"].retired
    assert list(exchange.T_map_base) == ["bravo", "alpha~2"]


def test_of_two_robots_of_one_name_the_second_is_another_source_and_goes_on(play):
    """Each has merged bravo; then they hear of each other."""
    played = {}
    for address in ("one", "two"):
        memory, robots, _ = play(*seen("alpha", "bravo", first=0, until=4), meet=(1,))
        played[address] = (memory, robots["alpha"])
    nodes = {
        address: node_of(robot, SECOND, previews=False, writer=address.encode().ljust(8, b"_"))
        for address, (_, robot) in played.items()
    }
    medium = Medium(nodes, lambda name: False, lambda name, error, ns: pytest.fail(str(error)))
    for second in (10, 11):
        medium.hold((("one", "two"), ("two", "one")), second * SECOND)
    memory, second = played["two"]
    assert nodes["one"].source == Source("alpha", 1)
    assert nodes["two"].source == second.graph.me == Source("alpha~2", 2)
    assert second.own.provenance[:2] == ("alpha~2", 2) and not second.failed
    (told,) = [event for event in memory.events if event.kind == "renamed"]
    assert told.reason == "another robot is called alpha: from now on it is alpha~2" and told.stamp_ns == 10 * SECOND
    assert list(second.merges) == ["alpha", "bravo"] or list(second.merges) == ["bravo", "alpha"]
    mine = {claim.donor.name for claim in second.claims.active() if claim.receiver == second.graph.me}
    assert mine == {"alpha", "bravo"}
    assert nodes["one"].replica.head(Copy(Source("alpha~2", 2), "layer")) is not None
    assert list(played["one"][1].merges) == ["bravo", "alpha~2"]
