"""Claims: each holds where the numbers say so, and does not where they do not."""

from __future__ import annotations

import dataclasses
import math

import pytest

from mapgraft.experiments.andersone2021.outcome import Watched
from mapgraft.experiments.andersone2021.settings import PAPER
from mapgraft.experiments.andersone2021.telling.detection import curves
from mapgraft.experiments.andersone2021.telling.statements import statements


@pytest.fixture
def claims(experiment_of):
    """What is said of merges, by name."""

    def told(merges):
        experiment = experiment_of(merges)
        return {one.name: one for one in statements(experiment, curves(experiment))}

    return told


@pytest.fixture
def merges_of(made):
    """Five merges of each kind, as the paper would have it, at two resolutions.

    Wrong DM is the same in metres, right DM in cells.
    """

    def make(count=5, **changes):
        return [
            made(
                right,
                5 * k + n,
                **{
                    "one": (0.99 + 0.001 * n, 0.5 if right else 2.0 + n),
                    "two": (0.98 - 0.005 * n, 1.0) if right else (0.91, 10.0 * 0.07 / combination.own_m),
                    "combination": combination,
                    **changes,
                },
            )
            for combination in (PAPER[0], PAPER[2])
            for k, right in enumerate((True, False))
            for n in range(count)
        ]

    return make


def test_what_the_paper_says_holds_where_it_does(claims, merges_of):
    said = claims(merges_of())
    for name in (
        "ledger_metrics",
        "ledger_revert",
        "ledger_cost",
        "ledger_cost_of_metrics",
        "similarity_in_one_map",
        "distance_in_one_map",
        "two_cost_more",
        "similarity_with_two_maps",
        "distance_with_two_maps",
        "similarity_with_one_map",
        "distance_of_right",
        "distance_of_wrong",
    ):
        assert said[name].holds is True, name
    assert "20 of 20 merges" in said["ledger_metrics"].found
    assert "the evidence alone 0.90 to 0.90 times as much." in said["ledger_cost"].found
    assert "1.29 to 1.54" in said["two_cost_more"].found
    assert {name for name, one in said.items() if one.timed} == {
        "ledger_cost",
        "ledger_cost_of_metrics",
        "two_cost_more",
    }


def test_one_bit_is_enough_for_the_ledger_to_fail(claims, merges_of):
    merges = merges_of()
    kept = merges[7].by["ledger"]
    end = {**kept.end, "distance.metres": math.nextafter(kept.end["distance.metres"], 1.0)}
    merges[7] = dataclasses.replace(merges[7], by={**merges[7].by, "ledger": dataclasses.replace(kept, end=end)})
    said = claims(merges)
    assert said["ledger_metrics"].holds is False
    assert "equal in 19 of 20" in said["ledger_metrics"].found


def test_numbers_that_neither_can_tell_are_equal(claims, merges_of):
    assert claims(merges_of(two=(math.nan, math.nan)))["ledger_metrics"].holds is True


def test_one_map_that_is_not_byte_identical_is_counted(claims, merges_of):
    merges = merges_of()
    kept = merges[0].by["ledger"]
    left = dataclasses.replace(kept.leftovers, identical=False)
    merges[0] = dataclasses.replace(merges[0], by={**merges[0].by, "ledger": dataclasses.replace(kept, leftovers=left)})
    assert claims(merges)["ledger_revert"].holds is False


def test_a_dear_ledger_and_cheap_second_map_are_said(claims, merges_of):
    said = claims(merges_of(costs_s=(1.0, 0.9, 1.2)))
    assert said["ledger_cost"].holds is False
    assert said["ledger_cost_of_metrics"].holds is False
    assert said["two_cost_more"].holds is False


def test_the_ordering_of_one_and_two_maps_can_fail(claims, merges_of):
    said = claims(merges_of(one=(0.9, 5.0), two=(0.95, 2.0)))
    assert said["similarity_in_one_map"].holds is False and said["distance_in_one_map"].holds is False
    assert "0 of 8 averages" in said["similarity_in_one_map"].found
    for name in ("distance_with_two_maps", "distance_with_one_map", "similarity_with_one_map"):
        assert said[name].holds is None, name  # equal for all: there is no area


def test_ranges_that_overlap_do_not_tell_wrong_merges(claims, made):
    said = claims([made(right, 5 * right + n, two=(0.9, 1.0 + n)) for right in (True, False) for n in range(5)])
    assert "10 of 10 merges lie in the range of both" in said["distance_with_two_maps"].found
    assert said["distance_with_two_maps"].holds is False


def test_nothing_is_judged_by_few_merges(claims, merges_of):
    said = claims(merges_of(count=4))
    judged = {name for name, one in said.items() if one.holds is not None}
    assert judged == {"ledger_metrics", "ledger_revert"}  # bytes are equal or not
    assert "fewer than 5" in said["traces"].found and "fewer than 5" in said["distance_of_right"].found
    assert {name for name, one in claims(merges_of()).items() if one.holds is None} == {"verifier"}


def test_useless_similarity_is_judged_over_all_resolutions(claims, merges_of):
    merges = merges_of()
    found = claims(merges)["similarity_with_one_map"]
    assert found.holds is True and "At 0.07-0.07" in found.found and "At 0.1-0.07" in found.found
    apart = [made for made in merges if made.combination == PAPER[0]]
    one = {True: 0.99, False: 0.9}
    for k, merge in enumerate(merges):
        if merge in apart:
            kept = merge.by["single_map"]
            end = {**kept.end, "similarity": one[merge.right] + 0.001 * merge.number}
            merges[k] = dataclasses.replace(merge, by={**merge.by, "single_map": dataclasses.replace(kept, end=end)})
    found = claims(merges)["similarity_with_one_map"]
    assert "0 of 10 merges" in found.found and found.holds is True  # 10 of 20 are still half of them


def test_what_cannot_be_measured_is_in_neither_number(claims, merges_of):
    merges = merges_of()
    kept = merges[0].by["multi_map"]
    nothing = {**kept.end, "similarity": math.nan}
    merges[0] = dataclasses.replace(
        merges[0], by={**merges[0].by, "multi_map": dataclasses.replace(kept, initial=nothing, end=nothing)}
    )
    assert "in 38 of 38" in claims(merges)["similarity_in_one_map"].found


def test_what_two_maps_and_the_ledger_leave_is_counted(claims, merges_of):
    merges = merges_of()
    assert "2M and ledger leave nothing." in claims(merges)["traces"].found
    wrong = next(k for k, merge in enumerate(merges) if not merge.right)
    kept = merges[wrong].by["ledger"]
    left = dataclasses.replace(kept.leftovers, identical=False, touched=7)
    by = {**merges[wrong].by, "ledger": dataclasses.replace(kept, leftovers=left)}
    merges[wrong] = dataclasses.replace(merges[wrong], by=by)
    assert "Of 10 merges something is left by 2M in 0, ledger in 1." in claims(merges)["traces"].found


def test_what_a_revert_leaves_is_told_in_shares_of_what_is_known(claims, merges_of):
    found = claims(merges_of())["traces"]  # 1 + 2 + 3 of 100 cells
    assert found.holds is False
    assert "1.0 lost, 3.0 of the other class, 2.0 known that would not be" in found.found
    assert "20 % of them" in found.found


def test_nothing_is_claimed_of_a_kind_that_is_not_there(claims, made):
    said = claims([made(True, 0), made(True, 1)])
    for name in ("distance_with_two_maps", "distance_with_one_map", "traces", "distance_of_wrong", "verifier"):
        assert said[name].holds is None, name


def test_our_rules_are_judged_by_both_kinds(claims, merges_of):
    def watched(action):
        return Watched("a rule", action, "", {}, {})

    merges = merges_of()
    good = [dataclasses.replace(m, watched=watched("confirm" if m.right else "revert")) for m in merges]
    assert claims(good)["verifier"].holds is True
    bad = [good[0], *(dataclasses.replace(m, watched=watched("revert")) for m in good[1:])]
    assert claims(bad)["verifier"].holds is False
