"""Standing merges are registered anew as the maps grow: better, exactly, and without testing what refined them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from beacons import Beacons, SlideNear
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.config import VerdictConfig
from mapgraft.contracts import DecisionTableError, MapMetadata, Match, Meeting, Transform
from mapgraft.decision import check_rules
from mapgraft.outputs.tables import transforms_table
from mapgraft.persons import Hand, same_place
from mapgraft.registration import Site, displacement, find_move, prior_around
from mapgraft.standing import Grounds

SECOND = 1_000_000_000
EXACT = ("ledger", "multi_map")
ALIKE = ((0, "alpha", 0, 2, 5), (0, "bravo", 10, 12, 15, 30, 33, 37, 41))
FURTHER = ((2, "alpha", 21), (3, "alpha", 24), (4, "alpha", 28), (5, "alpha", 32))  # one place off from -10
HALF_M = 0.5  # between two places: the next one is just within what a person calls the same


def near(spacing_m: float = HALF_M, **more) -> dict:
    return {"use": "slide_near", "spacing_m": spacing_m, **more}


def rules(**changes) -> list[dict]:
    rule = {
        "name": "beacons",
        "match": near(),
        "accept": {"use": "first_one", "least": 3.0},
        "fuse": {"use": "sum"},
        "verify": {"use": "at_most", "metrics": ["disagreement"], "every": 1, "limit": 99.0},
        "refine": {"every": 1},
    }
    return [rule | changes]


def of_alpha(memory, *wanted: str):
    return [e for e in memory.events if e.receiver == "alpha" and (not wanted or e.kind in wanted)]


@pytest.fixture
def play(play):
    """Replays, with beacons half a metre apart unless something else is said."""
    return lambda *told, **more: play(*told, **{"spacing_m": HALF_M, **more})


@pytest.mark.parametrize("reversal", EXACT)
def test_a_better_transform_close_by_takes_the_place_of_the_old_one(play, reversal):
    memory, robots, _ = play(*ALIKE, *FURTHER, meet=(1,), rules=rules(), reversal=reversal)
    (merged,), (updated,) = of_alpha(memory, "merged"), of_alpha(memory, "updated")
    assert merged.T_receiver_donor.x_m == -5.0
    assert (updated.stamp_ns, updated.merge_id, updated.by) == (5 * SECOND, "alpha.bravo.1", "slide_near")
    assert updated.reason == "registered anew: moved by 0.50 m, 0.00° (score 3 → 4)"
    assert updated.T_receiver_donor.x_m == -4.5
    assert (updated.score, updated.margin, updated.bytes_received) == (4, merged.margin, 0)
    assert updated.covariance is not None
    alpha = robots["alpha"]
    assert dict(alpha.reversal.fused().counts) == {0: 1, 1: 1, 2: 1, 3: 1, 5: 1, 6: 1, 21: 2, 24: 2, 28: 2, 32: 2}
    assert alpha.merges["bravo"].comparison.T_receiver_donor.x_m == -4.5
    assert alpha.merges["bravo"].comparison.match.score == 4
    after = [e.kind for e in of_alpha(memory)]
    assert after[after.index("updated") + 1] == "verified"
    told = transforms_table([e for e in memory.events if e.receiver == "alpha"]).to_pylist()
    assert {row["x_m"] for row in told} == {-4.5, 4.5}


def test_what_was_seen_before_is_told_in_a_step_of_its_own_first(play):
    steps = []

    class Watching:
        def __init__(self, tracker):
            self.tracker = tracker

        def update(self, step):
            seen = [observation.payload for observation in step.observations]
            comparison = self.tracker.tracker.comparison
            x_m, score = comparison.T_receiver_donor.x_m, comparison.match.score
            steps.append((seen, step.donor_changed, step.touched is None, x_m, score))
            return self.tracker.update(step)

    table = rules(verify={"use": "at_most", "metrics": ["disagreement"], "every": 100, "limit": 99.0})
    _, robots, exchange = play(*ALIKE, rules=table)
    alpha = robots["alpha"]
    exchange.hold(Meeting(SECOND, (("alpha", "bravo"),)))
    for watch in alpha.merges["bravo"]._watches:
        watch.tracker = Watching(watch.tracker)
    for second, _, at in FURTHER:
        alpha.observe(observation_of(alpha, second, at))
    assert steps == [
        ([(21,), (24,), (28,), (32,)], False, False, -5.0, 3),
        ([], True, True, -4.5, 4),
    ]
    alpha.observe(observation_of(alpha, 6, 32))
    alpha.standing.verify(alpha.merges["bravo"], 6 * SECOND, everything=True)
    assert steps[-1] == ([(32,)], False, False, -4.5, 4)


def observation_of(robot, second: int, *at: int):
    from mapgraft.contracts import Observation

    T = Transform.identity()
    return Observation(robot.name, second * SECOND, second * SECOND, "ear", "heard", tuple(at), T, T)


@pytest.mark.parametrize("reversal", EXACT)
@pytest.mark.parametrize("reverts", (False, True))
def test_the_swapped_map_is_that_of_a_merge_made_there_and_reverting_leaves_no_trace(play, reversal, reverts):
    _, robots, _ = play(*ALIKE, *FURTHER, meet=(1,), rules=rules(), reversal=reversal)
    _, late, exchange = play(*ALIKE, *FURTHER, rules=rules(), reversal=reversal)
    exchange.hold(Meeting(9 * SECOND, (("alpha", "bravo"),)))
    swapped, fresh = robots["alpha"], late["alpha"]
    assert fresh.merges["bravo"].comparison.T_receiver_donor.x_m == -4.5
    if reverts:
        _, alone, _ = play(*ALIKE, *FURTHER, rules=rules(), reversal=reversal)
        swapped.standing.revert(swapped.merges["bravo"], 9 * SECOND, Grounds("", "test"))
        fresh = alone["alpha"]
    assert swapped.reversal.fused() == fresh.reversal.fused()
    assert swapped.own.encoded_layer() == fresh.own.encoded_layer()


def test_a_newer_map_of_the_donor_refines_too_in_one_event(play):
    told = ((0, "alpha", 0, 2, 5, 21, 24, 28, 32), (0, "bravo", 10, 12, 15))
    memory, _, _ = play(*told, (2, "bravo", 30, 33, 37, 41), (9, "alpha", 0), meet=(1, 3), rules=rules())
    (updated,) = of_alpha(memory, "updated")
    assert updated.reason == ("the donor has gone on mapping; registered anew: moved by 0.50 m, 0.00° (score 3 → 4)")
    assert (updated.by, updated.T_receiver_donor.x_m) == ("exchange", -4.5)
    assert updated.bytes_received > 0


@pytest.mark.parametrize(
    ("changes", "reversal", "spacing_m"),
    (
        ({"refine": {"every": None}}, "ledger", HALF_M),
        ({"refine": {"every": 100}}, "ledger", HALF_M),
        ({"refine": {"every": 1, "growth": 5.0}}, "ledger", HALF_M),
        ({"match": near(tells=False)}, "ledger", HALF_M),  # nobody knows what the standing transform scores
        ({"match": {"use": "slide"}}, "ledger", 1.0),  # a matcher that does not use priors
        ({"match": near(1.0, sigma_m=40.0)}, "ledger", 1.0),  # another place, however unsure the match is
        ({}, "single_map", HALF_M),
    ),
)
def test_no_refinement_where_it_is_not_wanted_or_not_possible(play, changes, reversal, spacing_m):
    table = rules(**changes)
    memory, _, _ = play(*ALIKE, *FURTHER, meet=(1,), rules=table, reversal=reversal, spacing_m=spacing_m)
    assert of_alpha(memory, "merged")[0].T_receiver_donor.x_m == -10.0 * spacing_m
    assert of_alpha(memory, "updated") == []


def test_moves_never_lead_away_from_the_place_that_was_accepted(play):
    """Each place is told better than the one before; three of them are a quarter of a metre apart."""
    told = ((0, "alpha", 0, 2, 5), (0, "bravo", 10, 12, 15, 30, 33, 37, 41, 60, 64, 69, 75, 82, 90, 99, 109, 120))
    further = (21, 24, 28, 32, 52, 56, 61, 67, 74, 83, 92, 102, 113)  # four at -9, five at -8, some at -7
    stream = [(2 + n, "alpha", at) for n, at in enumerate(further)]
    memory, robots, _ = play(*told, *stream, meet=(1,), rules=rules(match=near(0.25)), spacing_m=0.25)
    assert [e.T_receiver_donor.x_m for e in of_alpha(memory, "merged", "updated")] == [-2.5, -2.25, -2.0]
    merge = robots["alpha"].merges["bravo"]
    assert [T.x_m for T in merge.stood] == [-2.5, -2.25, -2.0]
    robots["alpha"].standing.revert(merge, 99 * SECOND, Grounds("", "test"))
    (refusal,) = robots["alpha"].attempts.refusals.by_donor["bravo"]
    assert refusal.stood == tuple(merge.stood)


@pytest.mark.parametrize("meet", ((1,), (1, 6)))
def test_what_a_person_confirmed_is_not_moved(play, meet):
    hand = Hand(verdicts=[VerdictConfig(merge="alpha.bravo.1", action="confirm")])
    told = (*ALIKE, *FURTHER, (5.5, "bravo", 45), (7, "alpha", 36))
    memory, robots, _ = play(*told, meet=meet, rules=rules(), hand=hand)
    assert robots["alpha"].merges["bravo"].comparison.T_receiver_donor.x_m == -5.0
    assert len(of_alpha(memory, "updated")) == len(meet) - 1  # only the donor's newer map came in


@pytest.mark.parametrize(("at", "x_m", "moves_to_m"), (((5, 7, 10), -1.25, []), ((6, 8, 11), -1.0, [-2.25])))
def test_a_merge_is_not_moved_near_to_where_it_was_taken_out(play, at, x_m, moves_to_m):
    """A person takes out the first; -2.25 is a metre away from -1.25."""
    hand = Hand(verdicts=[VerdictConfig(merge="alpha.bravo.1", action="revert")])
    told = ((0, "alpha", *at), (0, "bravo", 10, 12, 15, 30, 33, 37, 41))
    more = ((2, "alpha", 0, 2, 5, 20), *((3 + n, "alpha", at) for n, at in enumerate((21, 24, 28, 32, 1))))
    played = {"rules": rules(match=near(0.25)), "hand": hand, "spacing_m": 0.25}
    memory, _, _ = play(*told, *more, meet=(1, 2.5), **played)
    assert [e.T_receiver_donor.x_m for e in of_alpha(memory, "merged")] == [x_m, -2.5]
    assert [e.T_receiver_donor.x_m for e in of_alpha(memory, "updated")] == moves_to_m


@pytest.mark.parametrize("refine", ({"every": 0}, {"growth": -1.0}, {"rate": 3}))
def test_impossible_values_are_told(refine):
    with pytest.raises(DecisionTableError, match="refine"):
        check_rules(rules(refine=refine), "test")


BEACONS = Beacons()


def chart(*at: int):
    return BEACONS.view(BEACONS.decode(str([[a, 1] for a in sorted(set(at))]).encode()))


PLACES = st.sets(st.integers(0, 40), min_size=1, max_size=12)


@given(own=PLACES, other=PLACES, later=st.lists(PLACES, max_size=6), at=st.integers(-40, 40), spread_m=st.floats(0, 50))
def test_moves_are_close_by_and_never_for_the_worse(own, other, later, at, spread_m):
    site, matcher = Site((5.0, 0.0), 0.25), SlideNear(spacing_m=0.25, sigma_m=spread_m)
    accepted = Transform.planar(0.25 * at, 0.0, 0.0)
    standing = Match(accepted, 1.0, 7.0, covariance=np.diag([spread_m**2, 0, 0, 0, 0, 0]), evidence={"a": 1.0})
    for more in ((), *later):
        own = own | set(more)
        move = find_move(matcher, chart(*own), chart(*other), standing, accepted, site)
        in_common = {n: len({o + n for o in other} & own) for n in range(at - 4, at + 5)}
        before = in_common[round(4 * standing.T_receiver_donor.x_m)]
        if move is None:
            continue
        assert (move.score_before, move.match.score) == (
            before,
            in_common[round(4 * move.match.T_receiver_donor.x_m)],
        )
        assert move.match.score > before
        assert same_place(accepted, move.match.T_receiver_donor, site.about_m)
        assert move.shift_m > site.least_m
        assert (move.match.margin, move.match.evidence["a"]) == (7.0, 1.0)
        standing = move.match


def test_the_prior_is_as_wide_where_the_donor_is_however_far_that_is_from_its_origin():
    standing = Match(Transform.planar(3.0, -2.0, 0.7), 1.0, 1.0)
    for about in ((0.0, 0.0), (200.0, -80.0)):
        prior = prior_around(standing, about)
        R = standing.T_receiver_donor.matrix[:2, :2]
        lever = R @ np.array(about)
        at_donor = np.zeros((2, 6))
        at_donor[:, :2] = np.eye(2)
        at_donor[:, 5] = -lever[1], lever[0]
        np.testing.assert_allclose(at_donor @ prior.covariance @ at_donor.T, np.eye(2) * (0.5 / 3.0) ** 2, atol=1e-8)
        assert prior.origin == "the standing merge"


def test_where_the_donor_is():
    own, other = MapMetadata("beacons", resolution_m=0.2), MapMetadata("beacons", bounds_m=(0.0, -2.0, 10.0, 4.0))
    assert Site.of(own, other) == Site((5.0, 1.0), 0.2, math.hypot(5.0, 3.0))
    assert Site.of(own, other).least_m == 0.1
    assert Site.of(dataclasses.replace(own, resolution_m=None), MapMetadata("beacons")).least_m == 0.025
    turned = Transform.planar(0.0, 0.0, 0.01)
    for about, reach, worth in (((0.0, 0.0), 2.0, False), ((0.0, 0.0), 3.0, True), ((9.0, 0.0), 0.5, True)):
        assert Site(about, 0.05, reach).is_worth_it(Transform.identity(), turned) is worth
    assert Site((0.0, 0.0)).is_worth_it(Transform.identity(), turned)  # how far it reaches is not told
    assert displacement(Transform.identity(), turned, (100.0, 0.0))[0] == pytest.approx(1.0, abs=1e-3)
