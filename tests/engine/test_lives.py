"""Robots that begin anew in another map frame, and robots of one name: each is a source of its own."""

from __future__ import annotations

from itertools import combinations, count

import pytest
from four_robots import SHIFT, WORLD, A, B, D, heard_by

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


@pytest.fixture
def alike(apart):
    """bravo, and two robots that are called alpha: the one that is not has observed more, at another place."""
    memory, robots = apart("alpha", "bravo", "charlie", "delta")
    false = robots["charlie"]
    false.own.me = false.graph.me = A
    writers = {"alpha": b"1", "charlie": b"2"}
    nodes = {
        name: node_of(robot, SECOND, previews=False, writer=writers.get(name, b"3").ljust(8, b"_"))
        for name, robot in robots.items()
    }
    medium = Medium(nodes, lambda name: False, lambda name, error, ns: pytest.fail(str(error)))
    seconds = count(10)

    def meet(*pairs: tuple[str, str]) -> None:
        for one, other in pairs:
            medium.hold(((one, other), (other, one)), next(seconds) * SECOND)

    return memory, robots, meet


def layers_in(robot) -> dict[str, list[int]]:
    """At which places of its own line a robot has what of others in its map."""
    contributions = robot.reversal.contributions.values()
    return {one.provenance.source: sorted(one.layer.evidence()) for one in contributions}


def at_home(name: str, of: str) -> list[int]:
    return [at + SHIFT[of] for at in WORLD[name]]


ALL = list(combinations(("alpha", "bravo", "charlie"), 2))


@pytest.mark.parametrize("more", [0, 2])
def test_what_was_taken_for_the_map_of_another_robot_of_that_name_goes(alike, hear, more):
    """bravo meets the false alpha first, whose map has a newer version than the true one's, or the same."""
    memory, robots, meet = alike
    bravo = robots["bravo"]
    for _ in range(more):
        robots["charlie"].observe(hear("charlie", *heard_by("charlie")))
    meet(("bravo", "charlie"))
    assert layers_in(bravo) == {"alpha": at_home("charlie", of="bravo")}
    meet(("alpha", "bravo"))
    assert layers_in(bravo) == {"alpha": at_home("alpha", of="bravo")}
    assert bravo.graph.version(A) == robots["alpha"].reversal.version
    gone = next(event for event in memory.events if event.kind == "reverted")
    assert (gone.merge_id, gone.by) == ("bravo.alpha.1", "namesake")
    meet(*ALL, *ALL)
    assert layers_in(bravo) == {
        name: at_home(of, of="bravo") for name, of in (("alpha", "alpha"), ("alpha~2", "charlie"))
    }
    assert not any(one.attempts.refusals.by_donor.get("alpha") for one in robots.values())
    told = {claim.merge_id for claim in robots["charlie"].claims.active() if claim.receiver == B}
    assert told == {"bravo.alpha.2", "bravo.alpha~2.1"}


@pytest.mark.parametrize("knows", ["bravo", "charlie"])
def test_who_never_meets_the_one_that_has_the_name_is_told_by_others(alike, hear, knows):
    """delta has merged the false alpha; the true one is met by bravo alone, or by its namesake."""
    _, robots, meet = alike
    delta = robots["delta"]
    delta.observe(hear("delta", *at_home("charlie", of="delta")))
    meet(("delta", "charlie"))
    assert layers_in(delta) == {"alpha": at_home("charlie", of="delta")}
    meet(("bravo", "charlie"), ("alpha", knows), ("delta", knows))
    assert delta.claims.of(D, A).state == "reverted"
    meet(("delta", "charlie"), ("delta", "charlie"))  # it is told that it is not alpha, and comes as another
    assert layers_in(delta)["alpha~2"] == at_home("charlie", of="delta")
    assert layers_in(delta).get("alpha") in (None, at_home("alpha", of="delta"))


def test_two_of_one_name_who_never_meet_hear_of_each_other_from_their_claims(alike, hear):
    """Each alpha has met one of bravo and delta, and these tell each other of merges only."""
    _, robots, meet = alike
    robots["delta"].observe(hear("delta", *at_home("bravo", of="delta")))
    line = [("alpha", "bravo"), ("bravo", "delta"), ("delta", "charlie")]
    for _ in range(3):
        meet(*line, *line[::-1])
    assert robots["alpha"].graph.me == A and robots["charlie"].graph.me == Source("alpha~2", 2)
    assert len({robot.claims.digest() for robot in robots.values()}) == 1
    assert max(claim.epoch for claim in robots["bravo"].claims) <= 4
    for robot in robots.values():
        claimed = {claim.donor.name for claim in robot.claims.active() if claim.receiver == robot.graph.me}
        assert claimed == set(robot.merges)
