"""The core loop with a map type of a stranger's: offer, merge, go on mapping, verify, revert."""

from __future__ import annotations

import pytest

from mapgraft.config import VerdictConfig
from mapgraft.contracts import Meeting, Prior, Situation, Transform
from mapgraft.persons import Hand, planar_covariance
from mapgraft.replay import Exchange

SECOND = 1_000_000_000


ALIKE = ((0, "alpha", 0, 2, 5), (0, "bravo", 10, 12, 15))


def kinds(memory, receiver: str = "alpha") -> list[str]:
    return [event.kind for event in memory.events if event.receiver == receiver]


def test_two_robots_merge_and_confirm(play):
    memory, robots, exchange = play(*ALIKE, (2, "alpha", 5), (3, "alpha", 0), (4, "alpha", 2), meet=(1,))
    assert kinds(memory) == ["offered", "merged", "verified", "confirmed"]  # what stays as it is is not told each time
    merged = memory.events[1]
    assert merged.merge_id == "alpha.bravo.1"
    assert merged.T_receiver_donor.x_m == -10.0
    assert merged.rule == "beacons with beacons"
    assert merged.measurements[0].name == "disagreement"
    assert dict(robots["alpha"].reversal.fused().counts) == {0: 3, 2: 3, 5: 3}
    told = {kind: exchange.traffic.bytes["bravo", "alpha", kind] for kind in ("hello", "layer")}
    assert sum(told.values()) == sum(e.bytes_received for e in memory.events if e.receiver == "alpha")
    assert [e.seq for e in memory.events] == list(range(len(memory.events)))


def test_a_wrong_merge_is_found_out_by_further_mapping_and_taken_out(play):
    memory, robots, _ = play(*ALIKE, (2, "alpha", 3), meet=(1,))
    assert kinds(memory) == ["offered", "merged", "verified", "reverted"]
    reverted = memory.events[-2] if memory.events[-1].receiver != "alpha" else memory.events[-1]
    assert reverted.exactness.exact
    assert "1 beacons disagree" in reverted.reason
    assert dict(robots["alpha"].reversal.fused().counts) == {0: 1, 2: 1, 3: 1, 5: 1}


@pytest.mark.parametrize("reversal", ("ledger", "multi_map"))
def test_the_bytes_after_a_revert_are_those_of_a_run_without_the_merge(play, reversal):
    observations = (*ALIKE, (2, "alpha", 3), (3, "alpha", 4))
    memory, robots, _ = play(*observations, meet=(1,), reversal=reversal)
    _, alone, _ = play(*observations, reversal=reversal)
    assert "reverted" in kinds(memory)
    assert robots["alpha"].own.encoded_layer() == alone["alpha"].own.encoded_layer()


def test_a_reverted_transform_is_not_tried_again(play):
    memory, _, _ = play(*ALIKE, (2, "alpha", 3), meet=(1, 5))
    assert kinds(memory) == ["offered", "merged", "verified", "reverted"]
    memory, _, _ = play(*ALIKE, (2, "alpha", 3), (6, "alpha", 3), meet=(1, 5))
    second = [e for e in memory.events if e.receiver == "alpha" and e.merge_id == "alpha.bravo.2"]
    assert all(e.T_receiver_donor is None or e.T_receiver_donor.x_m != -10.0 for e in second)


def test_a_donor_that_goes_on_mapping_is_brought_up_to_date(play):
    memory, robots, _ = play(*ALIKE, (2, "bravo", 20), (4, "alpha", 0), meet=(1, 3))
    assert "updated" in kinds(memory)
    assert robots["alpha"].reversal.fused().counts[10] == 1


def test_a_single_map_keeps_the_version_it_merged(play):
    memory, robots, _ = play(*ALIKE, (2, "bravo", 20), (4, "alpha", 0), meet=(1, 3), reversal="single_map")
    assert "updated" not in kinds(memory)
    assert 10 not in robots["alpha"].reversal.fused().counts


def test_nothing_to_compare_is_rejected_by_the_table_with_the_reason(play):
    memory, _, _ = play((0, "alpha", 0), (0, "bravo", 1, 3), (2, "alpha", 4), meet=(1,))
    assert kinds(memory) == ["offered", "rejected"]
    assert memory.events[1].reason == (
        "no rule applies: 'beacons with beacons': own.known_area_m2 is 1, the rule wants at least 2"
    )


def test_too_little_in_common_is_unmatched(play):
    memory, _, _ = play((0, "alpha", 0, 1), (0, "bravo", 0, 5), (2, "alpha", 1), meet=(1,))
    assert kinds(memory) == ["offered", "unmatched"]
    assert memory.events[1].reason == "too little in common"


def test_a_person_forbids_a_pair_both_ways(play):
    hand = Hand(forbidden=frozenset({frozenset(("alpha", "bravo"))}))
    memory, _, _ = play(*ALIKE, (2, "alpha", 5), meet=(1,), hand=hand)
    assert kinds(memory) == ["offered", "rejected"]
    assert kinds(memory, "bravo") == ["offered", "rejected"]
    assert memory.events[1].by == "person"


def test_a_person_reverts_and_what_follows_is_as_if_it_had_not_been(play):
    verdict = VerdictConfig(merge="alpha.bravo.1", action="revert", by="ann", reason="other building")
    memory, robots, _ = play(*ALIKE, (2, "alpha", 5), meet=(1,), hand=Hand(verdicts=[verdict]))
    assert kinds(memory)[:4] == ["offered", "merged", "verified", "reverted"]
    reverted = next(e for e in memory.events if e.kind == "reverted")
    assert reverted.by == "person ann"
    assert reverted.reason == "a person said revert: other building"
    assert robots["alpha"].merges == {}


def test_a_person_confirms_and_the_verifier_no_longer_reverts(play):
    verdict = VerdictConfig(merge="alpha.bravo.1", action="confirm")
    memory, robots, _ = play(*ALIKE, (2, "alpha", 3), meet=(1,), hand=Hand(verdicts=[verdict]))
    assert kinds(memory) == ["offered", "merged", "verified", "confirmed", "verified"]
    assert robots["alpha"].merges["bravo"].state == "confirmed"


def test_snapshots_are_taken_around_merges_and_reverts_and_at_the_end(play):
    memory, _, _ = play(*ALIKE, (2, "alpha", 3), meet=(1,))
    why = [s.why for s in memory.snapshots if s.robot == "alpha"]
    assert why == ["before merge", "after merge", "before revert", "after revert", "end"]
    before, after, *_ = (s for s in memory.snapshots if s.robot == "alpha")
    assert before.layer == after.layer  # the own evidence is never touched
    assert before.fused != after.fused


def test_snapshots_show_the_donors_map_as_it_was_grafted_and_as_long_as_it_stands(play):
    memory, _, _ = play(*ALIKE, (2, "alpha", 3), meet=(1,))
    shown = [{name: dict(d.map.counts) for name, d in s.donors.items()} for s in memory.snapshots if s.robot == "alpha"]
    assert shown == [{"bravo": {0: 1, 2: 1, 5: 1}}] * 3 + [{}] * 2  # before it enters, after, before the revert


def test_what_the_verifier_tells_is_in_the_event_beside_what_the_matcher_told(play, plugins):
    memory, _, _ = play(*ALIKE, (2, "alpha", 3), meet=(1,))
    merged, reverted = (next(e for e in memory.events if e.kind == kind) for kind in ("merged", "reverted"))
    assert "disagreement.revert_at" not in merged.evidence
    assert reverted.evidence == {**merged.evidence, "disagreement.revert_at": 1.0}


def test_three_robots_know_each_other_only_by_raw_layers(play):
    """bravo's share reaches alpha once, although charlie has merged bravo too."""
    memory, robots, _ = play(*ALIKE, (0, "charlie", 30, 32, 35), (2, "alpha", 0), meet=(1,))
    assert robots["alpha"].reversal.fused().counts[2] == 3
    assert {e.donor for e in memory.events if e.kind == "merged" and e.receiver == "alpha"} == {"bravo", "charlie"}


def test_a_policy_may_name_the_pairs(play, plugins):
    class OneWay:
        def due(self, situation: Situation) -> list[Meeting]:
            return [Meeting(situation.now_ns, (("alpha", "bravo"),))] if situation.ending else []

    memory, robots, _ = play(*ALIKE)
    Exchange(OneWay(), robots).until(SECOND, ending=True)
    assert "merged" in kinds(memory)
    assert kinds(memory, "bravo") == []


def test_a_prior_is_a_fact_of_the_table(play):
    prior = Prior(Transform.identity(), planar_covariance(0.1, 0.1), "test")
    memory, _, _ = play(*ALIKE, (2, "alpha", 5), meet=(1,), hand=Hand(priors={("alpha", "bravo"): prior}))
    assert "merged" in kinds(memory)


def test_an_offer_is_not_considered_again_while_neither_map_has_changed(play):
    memory, _, _ = play((0, "alpha", 0, 1), (0, "bravo", 0, 5), (9, "alpha", 1), meet=(1, 2, 3))
    assert kinds(memory) == ["offered", "unmatched"]
    memory, _, _ = play((0, "alpha", 0, 1), (0, "bravo", 0, 5), (2, "alpha", 2), (9, "alpha", 1), meet=(1, 3))
    assert kinds(memory) == ["offered", "unmatched"] * 2


def test_in_a_single_map_another_merge_makes_every_metric_look_at_everything_again(play, plugins):
    """An incremental tracker may rely on ``touched`` only if nothing else has changed the map."""
    steps = []

    class Watching:
        def __init__(self, tracker):
            self.tracker = tracker

        def update(self, step):
            steps.append(step.touched)
            return self.tracker.update(step)

    _, robots, exchange = play(*ALIKE, (0, "charlie", 30, 32, 35), reversal="single_map")
    alpha = robots["alpha"]
    exchange.hold(Meeting(SECOND, (("alpha", "bravo"),)))
    for watch in alpha.merges["bravo"]._watches:
        watch.tracker = Watching(watch.tracker)
    exchange.hold(Meeting(2 * SECOND, (("alpha", "charlie"),)))
    alpha.standing.verify(alpha.merges["bravo"], 3 * SECOND, everything=True)
    assert steps == [None]


def test_two_verdicts_on_one_pair_both_hold_whatever_the_merges_are_then_called(play):
    """A verdict goes with the place a person judged: taking the first merge out renumbers the ones after it."""
    alike = ((0, "alpha", 0, 2, 4, 6), (0, "bravo", 10, 12, 14, 16))
    observations = (*alike, (2, "alpha", 6), (4, "alpha", 6), (6, "alpha", 6))
    first, _, _ = play(*observations, meet=(1, 3, 5))
    at_first = next(e.T_receiver_donor for e in first.events if e.kind == "merged" and e.receiver == "alpha")
    one = VerdictConfig(merge="alpha.bravo.1", action="revert", T_receiver_donor=at_first.matrix.ravel().tolist())
    second, _, _ = play(*observations, meet=(1, 3, 5), hand=Hand(verdicts=[one]))
    later = [e for e in second.events if e.kind == "merged" and e.receiver == "alpha"][1:]
    assert later, "another hypothesis is tried after the first was refused"
    two = VerdictConfig(
        merge=later[0].merge_id, action="revert", T_receiver_donor=later[0].T_receiver_donor.matrix.ravel().tolist()
    )
    renumbered = one.model_copy(update={"merge": "alpha.bravo.7"})
    hand = Hand(verdicts=[two, renumbered])
    third, _, _ = play(*observations, meet=(1, 3, 5), hand=hand)
    by_person = [e.T_receiver_donor.x_m for e in third.events if e.kind == "reverted" and e.by.startswith("person")]
    assert at_first.x_m in by_person
    assert later[0].T_receiver_donor.x_m in by_person
    assert hand.disregarded == []


def test_a_verdict_on_a_merge_that_does_not_come_up_is_known(play):
    hand = Hand(verdicts=[VerdictConfig(merge="alpha.bravo.9", action="revert")])
    play(*ALIKE, (2, "alpha", 5), meet=(1,), hand=hand)
    assert [verdict.merge for verdict in hand.disregarded] == ["alpha.bravo.9"]


def test_looking_twice_at_one_moment_is_not_seeing_twice(play):
    _, robots, _ = play(*ALIKE, (2, "alpha", 5), (2, "bravo", 20), meet=(1, 2))
    merge = robots["alpha"].merges["bravo"]
    for _ in range(3):
        merge.measure(9 * SECOND, everything=True)
    assert [sample.observations for sample in merge.history] == sorted({s.observations for s in merge.history})


def test_same_place_is_judged_where_the_donors_map_is():
    from mapgraft.persons import same_place

    far = (40.0, 0.0)
    T = Transform.planar(0.0, 0.0, 0.0)
    turned = Transform.planar(40.0, 0.0, 0.02) @ Transform.planar(-40.0, 0.0, 0.0)  # about the middle of the map
    assert T.difference(turned)[0] > 0.5
    assert same_place(T, turned, far)
    assert not same_place(T, Transform.planar(0.0, 0.0, 0.02), far)


def test_a_plugin_that_fails_later_on_is_named(play, plugins):
    from beacons import Disagreement

    class Failing:
        def track(self, comparison):
            tracker = Disagreement().track(comparison)
            calls = []

            class Tracker:
                def update(self, step):
                    calls.append(step)
                    if len(calls) > 1:
                        raise IndexError("boom")
                    return tracker.update(step)

            return Tracker()

    import beacons

    original = beacons.Disagreement
    beacons.Disagreement = Failing
    try:
        memory, robots, _ = play(*ALIKE, (2, "alpha", 5), meet=(1,))
    finally:
        beacons.Disagreement = original
    (failed,) = [event for event in memory.events if event.kind == "failed" and event.receiver == "alpha"]
    assert failed.reason == "the metric 'disagreement' failed: IndexError: boom"
    assert failed.by == "metric disagreement"
    assert [event.seq for event in memory.events] == list(range(len(memory.events)))
    assert not robots["alpha"].merges
