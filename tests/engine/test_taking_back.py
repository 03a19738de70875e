"""Merges that cannot stand beside others: whoever of the two robots hears of it first, it ends the same."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import pytest
from four_robots import A, B, C, D, claim, hold, merged

from mapgraft.config import VerdictConfig
from mapgraft.contracts import Transform
from mapgraft.graph.claims import Claim, Source
from mapgraft.persons import Hand
from mapgraft.standing import Grounds

ORDERS = list(permutations(("alpha", "bravo")))
PLACE = Transform.planar(-100.0, 0.0, 0.0)  # where bravo truly lies on alpha's line
CONFIRMED = Hand(verdicts=[VerdictConfig(merge="alpha.bravo.1", action="confirm")])


def against(support: float = 5.0) -> list[Claim]:
    """What charlie and delta say of alpha and bravo: that they lie elsewhere to each other."""
    return [claim(receiver, donor, off, support=support) for receiver in (C, D) for donor, off in ((A, 0.0), (B, 30.0))]


def hear(robots, order, told: list[Claim]) -> None:
    """One robot after the other hears what was told, and what the ones before made of it; then all hear it again."""
    for stamp_ns, name in enumerate((*order, *order), start=2):
        known = [known for robot in robots.values() for known in robot.claims]
        robots[name].claims.join([*known, *told])
        robots[name].heard(stamp_ns)


def refusals(robot) -> list[str]:
    return [refusal.merge_id for refusal in robot.attempts.refusals.at("bravo", PLACE, (0.0, 0.0))]


@pytest.mark.parametrize("order", ORDERS)
def test_what_a_person_confirmed_stays_whoever_hears_first_what_contradicts_it(apart, order):
    memory, robots = apart("alpha", "bravo", hand=CONFIRMED)
    merged(robots, "alpha", "bravo")
    robots["alpha"].heard(1)
    hear(robots, order, against(support=9.0))
    assert robots["bravo"].graph.explanation().wrong.keys() == {(A, B)}
    assert [robot.claims.of(A, B).state for robot in robots.values()] == ["confirmed", "confirmed"]
    assert list(robots["alpha"].reversal.contributions) == ["alpha.bravo.1"]
    assert not [event for event in memory.events if event.kind == "reverted"]


@pytest.mark.parametrize("order", ORDERS)
def test_what_a_person_confirmed_stays_whatever_the_donors_cells_have_found(apart, order):
    """Bravo has merged alpha at the same place, and its verifier has seen that it is not there."""
    _, robots = apart("alpha", "bravo", hand=CONFIRMED)
    merged(robots, "alpha", "bravo")
    merged(robots, "bravo", "alpha")
    robots["bravo"].heard(1)
    grounds = Grounds("walls are missing", "sequential", evidence={"log_odds_wrong": 20.0})
    robots["bravo"].standing.revert(robots["bravo"].merges["alpha"], 1, grounds)
    hear(robots, order, [])
    known = robots["alpha"].claims
    assert (known.of(A, B).state, known.of(B, A).state) == ("confirmed", "reverted")
    assert list(robots["alpha"].merges) == ["bravo"]


@pytest.mark.parametrize("order", ORDERS)
def test_a_place_is_refused_as_long_as_what_contradicts_it_stands_whoever_hears_first(apart, order):
    memory, robots = apart("alpha", "bravo")
    alpha = robots["alpha"]
    merged(robots, "alpha", "bravo")
    alpha.heard(1)
    hear(robots, order, against())
    (gone,) = [event for event in memory.events if event.kind == "reverted"]
    assert (gone.merge_id, gone.by) == ("alpha.bravo.1", "consistency")
    assert refusals(alpha) == ["alpha.bravo.1"]
    first, *rest = against()
    alpha.claims.add(claim(*first.edge, state="reverted", revision=1))
    alpha.heard(7)
    assert refusals(alpha) == ["alpha.bravo.1"]  # delta still says so
    alpha.claims.join(claim(*one.edge, state="reverted", revision=1) for one in rest)
    alpha.heard(8)
    assert refusals(alpha) == []
    alpha.looked_at.clear()
    merged(robots, "alpha", "bravo")
    assert list(alpha.merges) == ["bravo"]


def test_a_place_at_which_the_donor_contradicts_by_what_is_unknown_here_is_not_refused(apart):
    """The receiver obeys; as long as it knows of nothing that stands against the place, the place may be tried."""
    _, robots = apart("alpha", "bravo")
    merged(robots, "alpha", "bravo")
    robots["alpha"].heard(1)
    robots["bravo"].claims.join([*robots["alpha"].claims, *against()])
    robots["bravo"].heard(2)
    robots["alpha"].claims.add(robots["bravo"].claims.of(A, B))
    robots["alpha"].heard(3)
    assert not robots["alpha"].merges
    assert refusals(robots["alpha"]) == []


def test_what_a_person_confirmed_is_told_again_where_the_donor_had_not_heard_of_it(apart):
    _, robots = apart("alpha", "bravo", hand=CONFIRMED)
    merged(robots, "alpha", "bravo")
    alpha = robots["alpha"]
    alpha.heard(1)
    told = alpha.claims.of(A, B)
    alpha.claims.add(replace(told, state="reverted", revision=1, by="consistency", reason="it cannot be"))
    alpha.heard(2)
    anew = alpha.claims.of(A, B)
    assert (anew.epoch, anew.state, anew.by) == (2, "confirmed", "person")
    assert anew.T_receiver_donor == told.T_receiver_donor and list(alpha.merges) == ["bravo"]
    alpha.claims.add(replace(told, state="reverted", revision=9))
    alpha.heard(3)
    assert alpha.claims.of(A, B) == anew


@pytest.mark.parametrize(
    "foreign",
    [
        {"state": "confirmed", "revision": 3},
        {"state": "reverted", "revision": 3, "by": "sequential"},
        {"state": "provisional", "epoch": 4},
        {"state": "reverted", "epoch": 4},
    ],
)
def test_what_another_robot_of_the_name_has_told_of_its_merges_does_not_end_ones_own(apart, foreign):
    """Both are called alpha, and each has merged bravo; what the one wrote before it took another name is told late."""
    memory, robots = apart("alpha", "bravo")
    alpha = robots["alpha"]
    merged(robots, "alpha", "bravo")
    alpha.heard(1)
    mine = alpha.claims.of(A, B)
    elsewhere = claim(A, B, 7.0, **foreign)
    alpha.claims.add(elsewhere)
    alpha.heard(2)
    known = alpha.claims.of(A, B)
    assert known.is_active and known.T_receiver_donor == mine.T_receiver_donor and known.epoch > elsewhere.epoch
    assert list(alpha.merges) == ["bravo"] and not [event for event in memory.events if event.kind == "reverted"]
    alpha.standing.revert(alpha.merges["bravo"], 3, Grounds("drawn", "test"), refuse=False)
    alpha.heard(3)
    assert not alpha.claims.of(A, B).is_active
    alpha.looked_at.clear()
    merged(robots, "alpha", "bravo")
    alpha.heard(4)
    assert alpha.claims.of(A, B).is_active


def test_what_another_robot_of_the_name_has_told_of_is_taken_back_where_one_has_merged_nobody(apart):
    _, robots = apart("alpha", "bravo")
    robots["alpha"].claims.add(claim(A, C, 7.0))
    robots["alpha"].heard(1)
    known = robots["alpha"].claims.of(A, C)
    assert (known.state, known.by) == ("reverted", "namesake")


def test_who_is_called_the_same_takes_nothing_back_that_was_told_by_the_other(apart):
    """Before they have heard of each other each finds claims of merges that it has not made."""
    memory, robots = apart("alpha", "bravo")
    alpha, bravo = robots["alpha"], robots["bravo"]
    merged(robots, "alpha", "bravo")
    alpha.heard(1)
    bravo.graph.me = A
    bravo.claims.add(alpha.claims.of(A, B))
    bravo.heard(1)
    alpha.claims.add(bravo.claims.of(A, B))
    alpha.heard(2)
    assert list(alpha.merges) == ["bravo"] and alpha.claims.of(A, B).is_active
    assert not [event for event in memory.events if event.kind == "reverted"]


def test_who_takes_another_name_has_no_more_what_led_to_the_old_one(apart):
    _, robots = apart("alpha", "bravo")
    alpha = robots["alpha"]
    hold(robots, "alpha", "bravo")
    alpha.claims.add(claim(B, A))
    alpha.heard(1)
    assert alpha.reversal.contributions
    alpha.rename(Source("alpha~2", 2), "another robot is called alpha", 2)
    assert not alpha.reversal.contributions
