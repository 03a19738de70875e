"""Pairs that were not merged are tried again when there is more to try, and so are places that were reverted."""

from __future__ import annotations

import math

import pytest

from mapgraft.candidates import Candidates, LastAttempt
from mapgraft.config import VerdictConfig
from mapgraft.contracts import DecisionTableError, MapMetadata, Match, Transform
from mapgraft.decision import check_rules
from mapgraft.persons import Hand
from mapgraft.refusals import Refusal, Refusals

HERE, THERE = Transform.planar(-10.0, 0.0, 0.0), Transform.planar(-7.0, 0.0, 0.0)
ORIGIN = (0.0, 0.0)


def rules(limit: float = 0.0, least: float = 2.0, **changes) -> list[dict]:
    rule = {
        "name": "beacons",
        "match": {"use": "slide"},
        "accept": {"use": "first_one", "least": least},
        "fuse": {"use": "sum"},
        "verify": {"use": "at_most", "metrics": ["disagreement"], "every": 1, "limit": limit},
    }
    return [rule | changes]


def of_alpha(memory, *wanted: str):
    return [e for e in memory.events if e.receiver == "alpha" and (not wanted or e.kind in wanted)]


def seconds(events) -> list[int]:
    return [event.stamp_ns // 10**9 for event in events]


APART = ((0, "alpha", *range(0, 20)), (0, "bravo", 100, 207))
MORE = ((2, "alpha", 30), (4, "alpha", 31), (6, "alpha", 5))  # 5 %, 10 %, and nothing new


def test_an_unmatched_pair_waits_until_a_map_has_grown_and_leaves_no_event_meanwhile(play):
    memory, _, exchange = play(*APART, *MORE, (9, "alpha", 5), meet=(1, 3, 5, 7), rules=rules(least=3.0))
    assert [(e.kind, e.stamp_ns // 10**9) for e in of_alpha(memory)] == [
        ("offered", 1),
        ("unmatched", 1),
        ("offered", 5),
        ("unmatched", 5),
    ]
    told = sum(e.bytes_received for e in of_alpha(memory))
    assert exchange.traffic.sent["bravo", "alpha"] > told  # offers go on; maps are fetched only where they are wanted


def test_the_donor_may_be_the_one_that_has_grown(play):
    memory, _, _ = play(*APART, (2, "bravo", 300), (4, "alpha", 5), meet=(1, 3), rules=rules(least=3.0))
    assert [e.kind for e in of_alpha(memory)] == ["offered", "unmatched"] * 2


@pytest.mark.parametrize(("growth", "tried"), ((0.0, [1, 3, 5, 7]), (0.04, [1, 3, 5]), (0.5, [1])))
def test_a_rule_says_how_much_a_map_must_grow(play, growth, tried):
    table = rules(least=3.0, retry={"growth": growth})
    memory, _, _ = play(*APART, *MORE, (9, "alpha", 5), meet=(1, 3, 5, 7), rules=table)
    assert seconds(of_alpha(memory, "unmatched")) == tried


@pytest.mark.parametrize("retry", ({"growth": -0.1}, {"reverted": 0.9}, {"growth": float("nan")}, {"grow": 1.0}))
def test_impossible_values_are_told(retry):
    with pytest.raises(DecisionTableError, match="retry"):
        check_rules(rules(retry=retry), "test")


def test_a_candidate_that_comes_out_at_the_same_place_is_told_to_be_the_same(play):
    memory, robots, _ = play(*APART, (2, "alpha", 30, 31, 32), (9, "alpha", 5), meet=(1, 3), rules=rules(least=3.0))
    first, second = of_alpha(memory, "unmatched")
    assert second.reason == f"too little in common (the same place as {first.merge_id})"
    assert (first.merge_id, second.merge_id) == ("alpha.bravo.1", "alpha.bravo.2")
    assert robots["alpha"].candidates.last["bravo"].merge_id == second.merge_id


def metadata(area_m2: float, observations: int = 0) -> MapMetadata:
    return MapMetadata("beacons", known_area_m2=area_m2, observations=observations)


@pytest.mark.parametrize(
    ("before", "now", "waits"),
    (
        (metadata(100.0), metadata(109.9), True),
        (metadata(100.0), metadata(110.1), False),
        (metadata(100.0), metadata(50.0), True),
        (metadata(100.0, 10), metadata(100.0, 99), True),  # more looks at the same
        (metadata(0.0, 10), metadata(0.0, 10), True),
        (metadata(0.0, 100), metadata(0.0, 109), True),
        (metadata(0.0, 100), metadata(0.0, 111), False),  # where no area is told observations count
        (metadata(0.0, 0), metadata(5.0, 1), False),
    ),
)
def test_growth_is_by_area_or_else_by_observations(before, now, waits):
    still = metadata(7.0, 7)
    for own, other in ((True, False), (False, True)):
        candidates = Candidates()
        last = LastAttempt("a.b.1", "rule", None, before if own else still, before if other else still)
        candidates.keep("b", last)
        assert candidates.waits("b", "rule", 0.1, now if own else still, now if other else still) is waits
        assert not candidates.waits("b", "another rule", 0.1, still, still)
        candidates.forget("b")
        assert not candidates.waits("b", "rule", 0.1, still, still)


def matches(*scores: float, T: Transform = HERE) -> list[Match]:
    return [Match(T, score, 1.0) for score in scores]


def test_a_reverted_place_needs_a_score_that_has_grown_since_it_was_seen_again():
    refusals = Refusals()
    refusals.add("b", Refusal("a.b.1", (HERE,), 100.0))
    # both maps went on until the revert: what the place scores then is no new evidence
    assert refusals.sift("b", matches(180.0), 1.5, ORIGIN).matches == []
    assert refusals.sift("b", matches(269.0), 1.5, ORIGIN).refused == (
        "a.b.1 was reverted there, and its score of now 269 must grow above 270 first"
    )
    sifted = refusals.sift("b", matches(271.0), 1.5, ORIGIN)
    assert len(sifted.matches) == 1 and sifted.refused == ""
    assert refusals.overcome("b", sifted.matches[0], ORIGIN) == (
        "reverted before as a.b.1, since then the score has grown from 180 to 271"
    )
    assert refusals.overcome("b", Match(THERE, 1.0, 1.0), ORIGIN) == ""


def test_other_places_and_other_donors_are_free():
    refusals = Refusals()
    refusals.add("b", Refusal("a.b.1", (HERE,), 100.0))
    assert len(refusals.sift("b", matches(1.0, T=THERE), 1.5, ORIGIN).matches) == 1
    assert len(refusals.sift("c", matches(1.0), 1.5, ORIGIN).matches) == 1


@pytest.mark.parametrize(
    ("x_m", "degrees", "refused"),
    (
        (-11.0, 0.0, True),
        (-11.1, 0.0, False),
        (-9.5, 0.0, True),  # between the two
        (-8.0, 0.0, True),
        (-7.9, 0.0, False),
        (-10.0, 9.9, True),
        (-10.0, -10.1, False),
    ),
)
def test_a_place_is_refused_near_every_transform_at_which_it_stood(x_m, degrees, refused):
    refusals, about = Refusals(), (70.0, -20.0)
    refusals.add("b", Refusal("a.b.1", (HERE, Transform.planar(-9.0, 0.0, 0.0)), 100.0))
    beside = Transform.planar(*about, 0.0)
    T = Transform.planar(x_m, 0.0, 0.0) @ beside @ Transform.planar(0.0, 0.0, math.radians(degrees)) @ beside.inverse()
    assert bool(refusals.at("b", T, about)) is refused
    assert (refusals.sift("b", matches(1.0, T=T), 1.5, about).matches == []) is refused


def test_what_was_taken_out_is_no_rival_of_what_is_left():
    refusals = Refusals()
    refusals.add("b", Refusal("a.b.1", (HERE,), 100.0))
    far = Transform.planar(40.0, 0.0, 0.0)
    found = [Match(HERE, 100.0, 40.0), Match(THERE, 60.0, -40.0), Match(far, 25.0, -75.0)]
    left = refusals.sift("b", found, 1.5, ORIGIN).matches
    assert [(m.T_receiver_donor, m.margin) for m in left] == [(THERE, 35.0), (far, -35.0)]
    assert refusals.sift("b", found[:2], 1.5, ORIGIN).matches[0].margin == math.inf
    assert refusals.sift("c", found, 1.5, ORIGIN).matches == found


def test_what_a_person_took_out_is_never_taken_again_by_itself():
    refusals = Refusals()
    refusals.add("b", Refusal("a.b.1", (HERE,), 1.0, by_person=True))
    for score in (1.0, 1e9):
        sifted = refusals.sift("b", matches(score), 1.0, ORIGIN)
        assert sifted.matches == []
        assert sifted.refused == "a.b.1 was taken out there by a person, so it is not taken again by itself"


@pytest.mark.parametrize("score", (-40.0, 0.0, 0.9, 500.0))
def test_a_place_that_came_out_again_needs_more_whatever_the_sign_of_its_score(score):
    refusals = Refusals()
    refusals.add("b", Refusal("a.b.1", (HERE,), score))
    for _ in range(3):
        assert refusals.sift("b", matches(score), 1.5, ORIGIN).matches == []
    needed = Refusal("a.b.1", (HERE,), score).needs(1.5)
    assert needed >= score
    assert len(refusals.sift("b", matches(needed + 1e-6), 1.5, ORIGIN).matches) == 1


def test_a_share_cannot_grow_so_far():
    """Matchers whose score is a share of agreement never reach the factor: their places stay refused."""
    refusals = Refusals()
    refusals.add("b", Refusal("a.b.1", (HERE,), 0.7))
    assert refusals.sift("b", matches(1.0), 1.5, ORIGIN).matches == []


LINE = ((0, "alpha", *range(0, 40, 10)), (0, "bravo", *range(100, 140, 10)))
SPOILT = (2, "alpha", 15)  # heard between the beacons, where bravo heard nothing
GROWN = ((6, "alpha", *range(40, 90, 10)), (6, "bravo", *range(140, 190, 10)))


def test_the_engine_takes_a_reverted_place_again_when_its_score_has_grown_by_the_factor(play):
    table = rules(limit=0.5, least=4.0, retry={"growth": 0.0, "reverted": 2.0})
    memory, _, _ = play(*LINE, SPOILT, (4, "alpha", 15), *GROWN, (9, "alpha", 0), meet=(1, 3, 5, 7), rules=table)
    first, second = of_alpha(memory, "merged")
    assert seconds(of_alpha(memory, "reverted"))[0] == 2
    assert first.T_receiver_donor == second.T_receiver_donor
    assert seconds([first, second]) == [1, 7]
    assert second.reason.endswith("; reverted before as alpha.bravo.1, since then the score has grown from 4 to 9")
    assert seconds(of_alpha(memory, "unmatched")) == [3, 5]


def test_after_a_revert_the_pair_is_tried_at_the_next_meeting_and_the_reason_says_what_is_needed(play):
    only = (0, "alpha", 5), (0, "bravo", 105), (2, "alpha", 5), (4, "alpha", 5)
    memory, _, _ = play(*only, meet=(1, 3), rules=rules(limit=-1.0, least=1.0))
    assert [e.kind for e in of_alpha(memory, "merged", "reverted", "unmatched")] == ["merged", "reverted", "unmatched"]
    assert of_alpha(memory)[-1].reason == (
        "the only hypothesis was reverted before: "
        "alpha.bravo.1 was reverted there, and its score of now 1 must grow above 1.5 first"
    )


def test_a_person_who_reverts_is_obeyed_for_good(play):
    verdict = VerdictConfig(merge="alpha.bravo.1", action="revert", by="ann")
    only = (0, "alpha", 3), (0, "bravo", 103), (2, "alpha", 3), (2, "bravo", 103), (9, "alpha", 3)
    table = rules(least=1.0, retry={"growth": 0.0, "reverted": 1.0})
    memory, _, _ = play(*only, meet=(1, 5), hand=Hand(verdicts=[verdict]), rules=table)
    assert [e.kind for e in of_alpha(memory, "merged", "reverted", "unmatched")] == ["merged", "reverted", "unmatched"]
    assert of_alpha(memory)[-1].reason == (
        "the only hypothesis was reverted before: alpha.bravo.1 was taken out there by a person, "
        "so it is not taken again by itself"
    )
