"""Merges that cannot stand beside others: whoever of the two robots hears of it first, it ends the same."""

from __future__ import annotations

from itertools import permutations

import pytest
from four_robots import A, B, C, D, claim, merged

from mapgraft.config import VerdictConfig
from mapgraft.contracts import Transform
from mapgraft.graph.claims import Claim
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
    robots["alpha"].heard(4)
    robots["alpha"].claims.add(claim(D, C))
    robots["alpha"].heard(5)
    assert refusals(robots["alpha"]) == []
