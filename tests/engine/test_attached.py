"""Layers that come in through third robots: attached, attached anew, detached; and merges that contradict others."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator

import pytest
from four_robots import SHIFT, WORLD, A, B, C, D, alone, begun, claim, fused, heard_by, hold, merged
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mapgraft.contracts import Transform
from mapgraft.graph.claims import Claim
from mapgraft.persons import Hand
from mapgraft.refusals import Refusal
from mapgraft.standing import Grounds


def told(memory, receiver: str = "alpha") -> Iterator[tuple[str, str]]:
    return (
        (e.kind, e.donor) for e in memory.events if e.receiver == receiver and e.kind not in ("offered", "verified")
    )


def test_a_layer_comes_in_through_a_third_robot(play):
    after = [(second, name, *heard_by(name)) for second in (2, 3, 4) for name in ("alpha", "bravo", "charlie")]
    memory, robots, _ = play(*begun("alpha", "bravo", "charlie"), *after, (6, "alpha", 0), meet=(1, 5))
    event = next(e for e in memory.events if e.kind == "attached" and e.receiver == "alpha")
    assert (event.donor, event.merge_id, event.state) == ("charlie", "alpha.charlie.via.1", "attached")
    assert event.through == ("alpha.bravo.1", "bravo.charlie.1")
    assert event.T_receiver_donor.x_m == 20.0
    assert event.bytes_received > 0
    assert event.evidence["chain_merges"] == 2.0
    assert "alpha → bravo → charlie" in event.reason
    expected = Counter([0]) + sum((alone(name) for name in ("alpha", "bravo", "charlie") for _ in range(4)), Counter())
    assert fused(robots["alpha"]) == expected


def test_a_revert_elsewhere_takes_out_what_was_reachable_only_through_it(apart):
    memory, robots = apart()
    alpha = robots["alpha"]
    hold(robots, "alpha", "bravo", "charlie")
    alpha.claims.join([claim(B, A), claim(B, C)])
    alpha.heard(1)
    assert fused(alpha) == alone("alpha") + alone("bravo") + alone("charlie")
    alpha.claims.add(claim(B, C, state="reverted", revision=1, by="sequential", reason="it was wrong"))
    alpha.heard(2)
    assert list(told(memory)) == [("attached", "bravo"), ("attached", "charlie"), ("detached", "charlie")]
    gone = memory.events[-1]
    assert gone.reason == "bravo.charlie.1 was reverted by sequential, and there is no other way"
    assert gone.exactness.exact
    assert fused(alpha) == alone("alpha") + alone("bravo")


def test_what_is_reachable_another_way_is_attached_anew_with_the_other_transform(apart):
    memory, robots = apart()
    alpha = robots["alpha"]
    hold(robots, "alpha", "bravo", "charlie", "delta")
    first, second = [claim(B, A, support=9.0), claim(B, C, support=9.0)], [claim(D, A), claim(D, C, 0.5)]
    alpha.claims.join([*first, *second])
    alpha.heard(1)
    alpha.claims.add(claim(B, C, state="reverted", revision=1))
    alpha.heard(2)
    event = memory.events[-1]
    assert (event.kind, event.donor, event.through) == ("reattached", "charlie", ("delta.alpha.1", "delta.charlie.1"))
    assert event.T_receiver_donor.x_m == 20.5
    assert "now through alpha → delta → charlie" in event.reason
    assert Counter(c.provenance.source for c in alpha.reversal.contributions.values())["charlie"] == 1


def test_a_newer_layer_takes_the_place_of_the_older_one(apart, hear):
    memory, robots = apart()
    alpha = robots["alpha"]
    hold(robots, "alpha", "bravo")
    alpha.claims.add(claim(B, A))
    alpha.heard(1)
    robots["bravo"].observe(hear("bravo", 190))
    hold(robots, "alpha", "bravo")
    alpha.heard(2)
    assert list(told(memory)) == [("attached", "bravo"), ("reattached", "bravo")]
    assert memory.events[-1].reason == "there is a newer layer"
    assert fused(alpha)[90] == 1


def test_what_moves_a_little_to_where_it_was_taken_out_goes(apart):
    """In small steps, each of which is the same place for a person, as in one that is not."""
    memory, robots = apart()
    alpha = robots["alpha"]
    hold(robots, "alpha", "bravo")
    taken_out = Transform.planar(SHIFT["alpha"] - SHIFT["bravo"], 0.0, 0.0)
    alpha.attempts.refusals.add("bravo", Refusal("alpha.bravo.1", (taken_out,), 3.0))
    for revision, off_m in enumerate((-1.2, -0.8)):
        alpha.claims.add(claim(B, A, off_m, revision=revision))
        alpha.heard(revision)
    assert list(told(memory)) == [("attached", "bravo"), ("detached", "bravo"), ("unattached", "bravo")]
    assert memory.events[-1].reason == "alpha.bravo.1 was reverted there"


def test_what_is_refused_no_longer_is_attached_though_nothing_else_is_new(apart):
    memory, robots = apart()
    alpha = robots["alpha"]
    hold(robots, "alpha", "bravo")
    taken_out = Transform.planar(SHIFT["alpha"] - SHIFT["bravo"], 0.0, 0.0)
    alpha.attempts.refusals.add("bravo", Refusal("alpha.bravo.1", (taken_out,), 3.0))
    alpha.claims.add(claim(B, A))
    alpha.heard(1)
    assert list(told(memory)) == [("unattached", "bravo")]
    alpha.attempts.refusals.forget("bravo")
    alpha.heard(2)
    assert list(told(memory)) == [("unattached", "bravo"), ("attached", "bravo")]


def test_what_was_found_before_a_correction_leads_nowhere_until_it_is_found_again(apart):
    memory, robots = apart()
    hold(robots, "alpha", "bravo", "charlie")
    known = robots["alpha"].claims
    known.join([claim(B, A), claim(C, B)])
    robots["alpha"].heard(1)
    assert list(told(memory)) == [("attached", "bravo"), ("attached", "charlie")]
    known.add(claim(D, B, 3.0, corrections=(0, 1)))
    robots["alpha"].heard(2)
    gone = [e for e in memory.events if e.kind == "detached"]
    assert {e.donor for e in gone} == {"bravo", "charlie"}
    assert "bravo.alpha.1 was found before bravo's map was corrected, and there is no other way" in gone[0].reason
    known.add(claim(B, A, corrections=(1, 0)))
    robots["alpha"].heard(3)
    assert list(told(memory))[4:] == [("attached", "bravo")]


def test_what_is_attached_of_a_corrected_map_is_tested_from_the_start(apart, hear):
    memory, robots = apart()
    alpha, charlie = robots["alpha"], robots["charlie"]
    hold(robots, "alpha", "bravo", "charlie")
    alpha.claims.join([claim(B, A), claim(C, B)])
    alpha.heard(1)
    alpha.observe(hear("alpha", 0, stamp_ns=2))
    merge = alpha.standing.attached[C]
    assert merge.observations == 1 and merge.corrections == (0, 0)
    charlie.own.corrections += 1
    charlie.observe(hear("charlie", 0, stamp_ns=3))
    hold(robots, "alpha", "charlie")
    alpha.claims.add(claim(C, B, corrections=(1, 0)))
    alpha.heard(4)
    assert alpha.standing.attached[C] is merge
    assert merge.observations == 0 and merge.corrections == (0, 1) and len(merge.stood) == 1
    assert list(told(memory))[-1] == ("reattached", "charlie")


def test_who_merges_at_first_hand_counts_the_source_once(play):
    """Bravo has confirmed alpha, alpha has not merged bravo; then it does."""
    rules = [dict(RULE, accept={"use": "first_one", "least": 5, "metrics": ["disagreement"]})]
    memory, robots, _ = play(*begun("alpha", "bravo"), rules=rules)
    alpha = robots["alpha"]
    hold(robots, "alpha", "bravo")
    alpha.claims.add(claim(B, A))
    alpha.heard(1)
    assert fused(alpha) == alone("alpha") + alone("bravo")
    alpha.table = play(*begun("alpha"))[1]["alpha"].table
    alpha.looked_at.clear()
    alpha.candidates.last.clear()
    alpha.consider(robots["bravo"].offer(), robots["bravo"].layer(), 2)
    alpha.heard(2)
    kinds = [kind for kind, _ in told(memory)]
    assert kinds[-2:] == ["detached", "merged"]
    assert "it is merged at first hand now" in {e.reason for e in memory.events if e.kind == "detached"}
    assert fused(alpha) == alone("alpha") + alone("bravo")
    assert set(alpha.reversal.contributions) == {"alpha.bravo.1"}


RULE = {
    "name": "beacons with beacons",
    "when": {"own.type": "beacons", "other.type": "beacons"},
    "match": {"use": "slide"},
    "accept": {"use": "first_one", "metrics": ["disagreement"]},
    "fuse": {"use": "sum"},
    "verify": {"use": "at_most", "metrics": ["disagreement"], "every": 1, "confirm_after": 3},
}


@pytest.mark.parametrize(("through", "there"), [("confirmed", False), ("provisional", True), ("none", False)])
def test_only_confirmed_merges_of_others_lead_on_unless_told_otherwise(apart, through, there):
    _, robots = apart(through=through)
    hold(robots, "alpha", "bravo")
    robots["alpha"].claims.add(claim(B, A, state="provisional"))
    robots["alpha"].heard(1)
    assert bool(robots["alpha"].reversal.contributions) is there


def test_whom_a_person_forbade_is_not_attached_either(apart):
    _, robots = apart(hand=Hand(forbidden=frozenset([frozenset(("alpha", "charlie"))])))
    hold(robots, "alpha", "bravo", "charlie")
    robots["alpha"].claims.join([claim(B, A), claim(B, C)])
    robots["alpha"].heard(1)
    assert [c.provenance.source for c in robots["alpha"].reversal.contributions.values()] == ["bravo"]


def test_a_single_map_attaches_nothing_and_says_so_once(apart):
    memory, robots = apart(reversal="single_map")
    hold(robots, "alpha", "bravo")
    robots["alpha"].claims.add(claim(B, A))
    for stamp_ns in (1, 2):
        robots["alpha"].heard(stamp_ns)
        robots["alpha"].claims.add(claim(B, C, revision=stamp_ns, state="provisional"))
    assert [kind for kind, _ in told(memory)] == ["unattached"]
    assert "a single map cannot take out" in memory.events[0].reason


def test_own_cells_that_contradict_what_was_attached_are_evidence_against_another_robots_merge(apart, hear):
    memory, robots = apart()
    alpha = robots["alpha"]
    hold(robots, "alpha", "bravo", "charlie")
    alpha.claims.join([claim(B, A, support=9.0), claim(B, C, support=3.0)])
    alpha.heard(1)
    alpha.observe(hear("alpha", 20, 27, 30, 38, 54, stamp_ns=2))
    said = [(e.kind, e.donor, e.through) for e in memory.events if e.kind in ("disbelieved", "detached")]
    assert ("disbelieved", "charlie", ("bravo.charlie.1",)) in said
    assert ("detached", "charlie", ("bravo.alpha.1", "bravo.charlie.1")) in said
    told_of = next(e for e in memory.events if e.kind == "disbelieved")
    assert (told_of.merge_id, told_of.state, told_of.T_receiver_donor) == ("", "", None)
    assert "1 beacons disagree" in told_of.reason
    alpha.heard(3)
    assert not any(c.provenance.source == "charlie" for c in alpha.reversal.contributions.values())


def test_a_place_through_which_a_layer_only_passed_is_no_evidence(apart):
    """What is told in three messages, and drawn three times, is as if it had been told at once."""
    memory, robots = apart()
    alpha = robots["alpha"]
    hold(robots, "alpha", "bravo")
    for revision, off_m in enumerate((1.3, 1.6, 1.9)):
        alpha.claims.add(claim(B, A, off_m, revision=revision))
        alpha.heard(revision)
    assert list(told(memory)) == [("attached", "bravo"), ("reattached", "bravo"), ("reattached", "bravo")]
    assert not alpha.graph.disbelieved


def test_an_own_merge_that_contradicts_others_is_reverted_with_the_loops_as_evidence(apart):
    memory, robots = apart()
    alpha = robots["alpha"]
    merged(robots, "alpha", "bravo")
    off_m = 30.0
    pairs = [pair for pair in itertools.permutations((A, B, C, D), 2) if pair != (A, B)]
    alpha.claims.join(
        [claim(*pair, off_m=off_m * ((pair[0] == B) - (pair[1] == B))) for pair in pairs if A in pair[1:]]
    )
    alpha.claims.join(
        [claim(*pair, off_m=off_m * ((pair[0] == B) - (pair[1] == B))) for pair in pairs if A not in pair]
    )
    alpha.heard(2)
    event = next(e for e in memory.events if e.kind == "reverted")
    assert (event.merge_id, event.by) == ("alpha.bravo.1", "consistency")
    assert event.exactness.exact
    assert event.evidence["loops_inconsistent"] >= 3
    assert event.evidence["loop_mahalanobis"] > event.evidence["loop_mahalanobis.revert_at"]
    assert "loops of merges through it do not close" in event.reason
    assert alpha.claims.of(A, B).state == "reverted"


def test_a_place_is_no_longer_refused_when_what_spoke_against_it_was_wrong(apart):
    _, robots = apart()
    alpha = robots["alpha"]
    merged(robots, "alpha", "bravo")
    true = Transform.planar(SHIFT["alpha"] - SHIFT["bravo"], 0.0, 0.0)
    lies = [claim(B, C, 30.0), claim(C, B, -30.0), claim(D, B, -30.0), claim(B, D, 30.0)]
    alpha.claims.join([*lies, *(claim(*pair) for pair in ((C, A), (D, A), (C, D), (D, C)))])
    alpha.heard(2)
    assert not alpha.merges and alpha.attempts.refusals.at("bravo", true, (0.0, 0.0))
    alpha.claims.join(claim(one.receiver, one.donor, state="reverted") for one in lies[1:])
    alpha.heard(3)
    assert alpha.attempts.refusals.at("bravo", true, (0.0, 0.0))  # bravo.charlie.1 still says so
    alpha.claims.add(claim(B, C, state="reverted"))
    alpha.heard(4)
    assert not alpha.attempts.refusals.at("bravo", true, (0.0, 0.0))


@pytest.mark.parametrize(
    ("against", "off_m", "corrections", "state"),
    [
        (10.0, 0.0, (0, 0), "reverted"),
        (7.0, 0.0, (0, 0), "confirmed"),  # no more than what speaks for it
        (10.0, 2.0, (0, 0), "confirmed"),  # elsewhere
        (10.0, 0.0, (1, 0), "confirmed"),  # on another map
    ],
)
def test_what_own_cells_speak_against_is_revoked_from_the_other_side_too(apart, against, off_m, corrections, state):
    _, robots = apart("alpha", "bravo")
    alpha = robots["alpha"]
    merged(robots, "alpha", "bravo")
    alpha.claims.add(claim(B, A, -off_m, corrections=corrections))
    alpha.heard(1)
    grounds = Grounds("walls are missing", "sequential", evidence={"log_odds_wrong": against})
    alpha.standing.revert(alpha.merges["bravo"], 2, grounds)
    alpha.heard(2)
    known = alpha.claims.of(B, A)
    assert known.state == state
    if state == "reverted":
        assert (known.by, known.reason) == ("sequential", "alpha.bravo.1 was there, and walls are missing")


def test_a_donor_takes_back_a_wrong_merge_and_the_receiver_obeys(apart):
    memory, robots = apart()
    merged(robots, "alpha", "bravo")
    robots["alpha"].heard(1)
    made = robots["alpha"].claims.of(A, B)
    revoked = Claim(
        A, B, made.epoch, "reverted", made.revision + 1, made.T_receiver_donor, by="consistency", reason="no"
    )
    robots["alpha"].claims.add(revoked)
    robots["alpha"].heard(2)
    event = memory.events[-1]
    assert (event.kind, event.by, event.reason) == ("reverted", "consistency", "bravo says: no")
    assert not robots["alpha"].merges


def test_what_is_in_dispute_stands_and_nothing_passes_through_it(apart):
    memory, robots = apart()
    alpha = robots["alpha"]
    hold(robots, "alpha", "bravo", "charlie")
    merged(robots, "alpha", "bravo")
    alpha.claims.join([claim(B, A, off_m=9.0, support=2.2), claim(B, C)])
    alpha.heard(2)
    event = next(e for e in memory.events if e.kind == "disputed")
    assert (event.merge_id, event.through) == ("alpha.bravo.1", ("alpha.bravo.1",))
    assert "nobody can tell" in event.reason
    assert set(alpha.reversal.contributions) == {"alpha.bravo.1"}
    alpha.heard(3)
    assert [e.kind for e in memory.events].count("disputed") == 1


STORY = st.permutations(
    [
        claim(B, A),
        claim(B, C, support=3.0),
        claim(B, C, state="reverted", revision=1),
        claim(D, C),
        claim(D, B, support=2.0),
        "bravo",
        "charlie",
        "delta",
    ]
)


@given(STORY)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_map_does_not_depend_on_the_order_of_hearing(apart, story):
    _, robots = apart()
    alpha = robots["alpha"]
    for stamp_ns, one in enumerate(story):
        if isinstance(one, str):
            hold(robots, "alpha", one)
        else:
            alpha.claims.add(one)
        alpha.heard(stamp_ns)
    assert fused(alpha) == sum(map(alone, WORLD), Counter())
    through = {merge.donor: [c.merge_id for c in merge.chain.claims] for merge in alpha.standing.attached.values()}
    assert through == {
        "bravo": ["bravo.alpha.1"],
        "charlie": ["bravo.alpha.1", "delta.bravo.1", "delta.charlie.1"],
        "delta": ["bravo.alpha.1", "delta.bravo.1"],
    }


def test_a_robot_without_the_merge_has_the_same_bytes(apart):
    """With and without a merge that is reverted: the same evidence, the same fused map."""
    maps = []
    for claims in ([claim(B, A), claim(B, C)], [claim(B, A)]):
        _, robots = apart()
        hold(robots, "alpha", "bravo", "charlie")
        robots["alpha"].claims.join(claims)
        robots["alpha"].heard(1)
        robots["alpha"].claims.add(claim(B, C, state="reverted", revision=1))
        robots["alpha"].heard(2)
        maps.append((robots["alpha"].own.encoded_layer(), dict(robots["alpha"].reversal.fused().counts)))
    assert maps[0] == maps[1]


TOLD = [claim(B, A), claim(A, D), claim(B, C), claim(D, C), claim(C, D), claim(D, B)]
GONE = [Claim(*one.edge, 1, "reverted", 1, one.T_receiver_donor, support=one.support) for one in TOLD]
AGAIN = [Claim(*one.edge, 2, "confirmed", 0, one.T_receiver_donor, support=one.support) for one in TOLD]
ACTION = st.one_of(
    st.sampled_from(TOLD),
    st.sampled_from([*GONE, *AGAIN]),
    st.sampled_from(["bravo", "charlie", "delta", "observe", "heard", "merge", "revert"]),
)


def reachable(robot) -> set[str]:
    """By walking over all claims that the robot believes; those about its own merges follow from what stands."""
    known = [one for one in robot.claims if one.is_active and (one.receiver == A or one.state == "confirmed")]
    found, before = {A}, 0
    while len(found) > before:
        before = len(found)
        found |= {end for one in known if set(one.edge) & found for end in one.edge}
    return {source.name for source in found if robot.graph.layers.version(source) is not None}


@given(st.lists(ACTION, min_size=8, max_size=24), st.booleans(), st.booleans())
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_happened_the_map_is_that_of_what_is_known(apart, hear, actions, holds, at_once):
    """Any interleaving of hearing, merging, reverting and mapping ends where a look at the end state says."""
    _, robots = apart()
    alpha, heard = robots["alpha"], 1
    if holds:
        hold(robots, "alpha", "bravo", "charlie", "delta")
    for stamp_ns, one in enumerate(actions):
        if at_once:
            alpha.heard(stamp_ns)
        if isinstance(one, Claim):
            alpha.claims.add(one)
        elif one in WORLD:
            hold(robots, "alpha", one)
        elif one == "observe":
            alpha.observe(hear("alpha", *WORLD["alpha"], stamp_ns=stamp_ns))
            heard += 1
        elif one == "heard":
            alpha.heard(stamp_ns)
        elif one == "merge" and "bravo" not in alpha.merges:
            hold(robots, "alpha", "bravo")
            alpha.consider(robots["bravo"].offer(), robots["bravo"].layer(), stamp_ns)
        elif one == "revert" and "bravo" in alpha.merges:
            alpha.standing.revert(alpha.merges["bravo"], stamp_ns, Grounds("at random", "test"), refuse=False)
    alpha.heard(99)
    inside = {name for name in (*reachable(alpha), *alpha.merges) if name != "alpha"}
    expected = sum([alone("alpha")] * heard, Counter()) + sum(map(alone, inside), Counter())
    assert fused(alpha) == expected
    assert sorted(c.provenance.source for c in alpha.reversal.contributions.values()) == sorted(inside)
    again = alpha.reversal.recomputed(alpha.map_type)
    assert dict(again.counts) == dict(alpha.reversal.fused().counts)
