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
from mapgraft.persons import Hand
from mapgraft.registration import Site, displacement, find_move, is_within, prior_around

SECOND = 1_000_000_000
EXACT = ("ledger", "multi_map")
ALIKE = ((0, "alpha", 0, 2, 5), (0, "bravo", 10, 12, 15, 30, 33, 37, 41))
FURTHER = ((2, "alpha", 21), (3, "alpha", 24), (4, "alpha", 28), (5, "alpha", 32))  # one metre off from -10


def rules(**changes) -> list[dict]:
    rule = {
        "name": "beacons",
        "match": {"use": "slide_near"},
        "accept": {"use": "first_one", "least": 3.0},
        "fuse": {"use": "sum"},
        "verify": {"use": "at_most", "metrics": ["disagreement"], "every": 1, "limit": 99.0},
        "refine": {"every": 1},
    }
    return [rule | changes]


def of_alpha(memory, *wanted: str):
    return [e for e in memory.events if e.receiver == "alpha" and (not wanted or e.kind in wanted)]


@pytest.mark.parametrize("reversal", EXACT)
def test_a_better_transform_close_by_takes_the_place_of_the_old_one(play, reversal):
    memory, robots, _ = play(*ALIKE, *FURTHER, meet=(1,), rules=rules(), reversal=reversal)
    (merged,), (updated,) = of_alpha(memory, "merged"), of_alpha(memory, "updated")
    assert merged.T_receiver_donor.x_m == -10.0
    assert (updated.stamp_ns, updated.merge_id, updated.by) == (5 * SECOND, "alpha.bravo.1", "slide_near")
    assert updated.reason == "registered anew: moved by 1.00 m, 0.00° (score 3 → 4)"
    assert updated.T_receiver_donor.x_m == -9.0
    assert (updated.score, updated.margin, updated.bytes_received) == (4, merged.margin, 0)
    assert updated.covariance is not None
    alpha = robots["alpha"]
    assert dict(alpha.reversal.fused().counts) == {0: 1, 1: 1, 2: 1, 3: 1, 5: 1, 6: 1, 21: 2, 24: 2, 28: 2, 32: 2}
    assert alpha.merges["bravo"].comparison.T_receiver_donor.x_m == -9.0
    assert alpha.merges["bravo"].comparison.match.score == 4
    after = [e.kind for e in of_alpha(memory)]
    assert after[after.index("updated") + 1] == "verified"
    told = transforms_table([e for e in memory.events if e.receiver == "alpha"]).to_pylist()
    assert {row["x_m"] for row in told} == {-9.0, 9.0}


def test_what_was_seen_before_is_told_in_a_step_of_its_own_first(play):
    steps = []

    class Watching:
        def __init__(self, tracker):
            self.tracker = tracker

        def update(self, step):
            seen = [observation.payload for observation in step.observations]
            x_m, score = self.tracker.comparison.T_receiver_donor.x_m, self.tracker.comparison.match.score
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
        ([(21,), (24,), (28,), (32,)], False, False, -10.0, 3),
        ([], True, True, -9.0, 4),
    ]
    alpha.observe(observation_of(alpha, 6, 32))
    alpha.verify(alpha.merges["bravo"], 6 * SECOND, everything=True)
    assert steps[-1] == ([(32,)], False, False, -9.0, 4)


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
    assert fresh.merges["bravo"].comparison.T_receiver_donor.x_m == -9.0
    if reverts:
        _, alone, _ = play(*ALIKE, *FURTHER, rules=rules(), reversal=reversal)
        swapped.revert(swapped.merges["bravo"], 9 * SECOND, "", "test")
        fresh = alone["alpha"]
    assert swapped.reversal.fused() == fresh.reversal.fused()
    assert swapped.encoded_layer() == fresh.encoded_layer()


def test_a_newer_map_of_the_donor_refines_too_in_one_event(play):
    told = ((0, "alpha", 0, 2, 5, 21, 24, 28, 32), (0, "bravo", 10, 12, 15))
    memory, _, _ = play(*told, (2, "bravo", 30, 33, 37, 41), (9, "alpha", 0), meet=(1, 3), rules=rules())
    (updated,) = of_alpha(memory, "updated")
    assert updated.reason == ("the donor has gone on mapping; registered anew: moved by 1.00 m, 0.00° (score 3 → 4)")
    assert (updated.by, updated.T_receiver_donor.x_m) == ("exchange", -9.0)
    assert updated.bytes_received > 0


@pytest.mark.parametrize(
    ("changes", "reversal"),
    (
        ({"refine": {"every": None}}, "ledger"),
        ({"refine": {"every": 100}}, "ledger"),
        ({"refine": {"every": 1, "growth": 5.0}}, "ledger"),
        ({"match": {"use": "slide"}}, "ledger"),  # a matcher that does not use priors
        ({}, "single_map"),
    ),
)
def test_no_refinement_where_it_is_not_wanted_or_not_possible(play, changes, reversal):
    memory, _, _ = play(*ALIKE, *FURTHER, meet=(1,), rules=rules(**changes), reversal=reversal)
    assert of_alpha(memory, "merged")[0].T_receiver_donor.x_m == -10.0
    assert of_alpha(memory, "updated") == []


def test_a_merge_is_not_moved_to_where_it_was_taken_out(play):
    verdict = VerdictConfig(merge="alpha.bravo.1", action="revert")
    told = ((0, "alpha", 1, 3, 6), (0, "bravo", 10, 12, 15, 30, 33, 37, 41))  # -9 first, which a person takes out
    more = ((2, "alpha", 0, 2, 5, 20), *((3 + n, "alpha", at) for n, at in enumerate((21, 24, 28, 32))))
    memory, robots, _ = play(*told, *more, meet=(1, 2.5), rules=rules(), hand=Hand(verdicts=[verdict]))
    assert [e.T_receiver_donor.x_m for e in of_alpha(memory, "merged")] == [-9.0, -10.0]
    assert robots["alpha"].merges["bravo"].comparison.T_receiver_donor.x_m == -10.0
    assert of_alpha(memory, "updated") == []


@pytest.mark.parametrize("refine", ({"every": 0}, {"growth": -1.0}, {"rate": 3}))
def test_impossible_values_are_told(refine):
    with pytest.raises(DecisionTableError, match="refine"):
        check_rules(rules(refine=refine), "test")


BEACONS = Beacons()


def chart(*at: int):
    return BEACONS.view(BEACONS.decode(str([[a, 1] for a in sorted(set(at))]).encode()))


@given(
    own=st.sets(st.integers(0, 40), min_size=1, max_size=12),
    other=st.sets(st.integers(0, 40), min_size=1, max_size=12),
    at=st.integers(-40, 40),
)
def test_a_move_is_close_by_and_never_for_the_worse(own, other, at):
    target, source, site = chart(*own), chart(*other), Site((20.0, 0.0), 1.0)
    standing = Match(
        Transform.planar(at, 0.0, 0.0), 1.0, 7.0, covariance=np.diag([1.0, 0, 0, 0, 0, 0]), evidence={"a": 1.0}
    )
    move = find_move(SlideNear(), target, source, standing, site)
    if move is None:
        return
    in_common = {T: len({o + T for o in other} & own) for T in (at, round(move.match.T_receiver_donor.x_m))}
    assert move.score_before == in_common[at]
    assert move.match.score == in_common[round(move.match.T_receiver_donor.x_m)] > move.score_before
    assert is_within(standing, move.match.T_receiver_donor, site.about_m)
    assert move.shift_m > site.least_m
    assert move.match.margin == 7.0
    assert move.match.evidence["a"] == 1.0


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
