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
def four(made):
    """As the paper would have it, at two resolutions; wrong DM is the same in metres, right DM in cells."""

    def make(**changes):
        return [
            made(
                right,
                2 * k + n,
                **{
                    "one": (0.99, 0.5 if right else 2.0 + n),
                    "two": (0.98 - 0.01 * n, 1.0) if right else (0.91, 10.0 * 0.07 / combination.own_m),
                    "combination": combination,
                    **changes,
                },
            )
            for combination in (PAPER[0], PAPER[2])
            for k, right in enumerate((True, False))
            for n in (0, 1)
        ]

    return make


def test_what_the_paper_says_holds_where_it_does(claims, four):
    said = claims(four())
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
    assert "8 of 8 merges" in said["ledger_metrics"].found
    assert "0.90 to 0.90 times" in said["ledger_cost"].found
    assert "1.29 to 1.54" in said["two_cost_more"].found
    assert {name for name, one in said.items() if one.timed} == {
        "ledger_cost",
        "ledger_cost_of_metrics",
        "two_cost_more",
    }


def test_one_bit_is_enough_for_the_ledger_to_fail(claims, four):
    merges = four()
    kept = merges[3].by["ledger"]
    end = {**kept.end, "distance.metres": math.nextafter(kept.end["distance.metres"], 1.0)}
    merges[3] = dataclasses.replace(merges[3], by={**merges[3].by, "ledger": dataclasses.replace(kept, end=end)})
    said = claims(merges)
    assert said["ledger_metrics"].holds is False
    assert "equal in 7 of 8" in said["ledger_metrics"].found


def test_numbers_that_neither_can_tell_are_equal(claims, four):
    assert claims(four(two=(math.nan, math.nan)))["ledger_metrics"].holds is True


def test_one_map_that_is_not_byte_identical_is_counted(claims, four):
    merges = four()
    kept = merges[0].by["ledger"]
    left = dataclasses.replace(kept.leftovers, identical=False)
    merges[0] = dataclasses.replace(merges[0], by={**merges[0].by, "ledger": dataclasses.replace(kept, leftovers=left)})
    assert claims(merges)["ledger_revert"].holds is False


def test_a_dear_ledger_and_cheap_second_map_are_said(claims, four):
    said = claims(four(costs_s=(1.0, 0.9, 1.2)))
    assert said["ledger_cost"].holds is False
    assert said["ledger_cost_of_metrics"].holds is False
    assert said["two_cost_more"].holds is False


def test_the_ordering_of_one_and_two_maps_can_fail(claims, four):
    said = claims(four(one=(0.9, 5.0), two=(0.95, 2.0)))
    assert said["similarity_in_one_map"].holds is False and said["distance_in_one_map"].holds is False
    assert "0 of 8 averages" in said["similarity_in_one_map"].found
    assert said["distance_with_two_maps"].holds is False  # all of them lie in the range of both kinds
    assert said["distance_with_one_map"].holds is None  # equal for all: nothing to tell by


def test_what_a_revert_leaves_is_told_in_shares_of_what_is_known(claims, four):
    found = claims(four())["traces"]  # 1 + 2 + 3 of 100 cells
    assert found.holds is False
    assert "1.0 lost, 3.0 of the other class, 2.0 known that would not be" in found.found
    assert "20 % of them" in found.found


def test_nothing_is_claimed_of_a_kind_that_is_not_there(claims, made):
    said = claims([made(True, 0), made(True, 1)])
    for name in ("distance_with_two_maps", "distance_with_one_map", "traces", "distance_of_wrong", "verifier"):
        assert said[name].holds is None, name


def test_our_rules_are_judged_by_both_kinds(claims, four):
    def watched(action):
        return Watched("a rule", action, "", {}, {})

    merges = four()
    good = [dataclasses.replace(m, watched=watched("confirm" if m.right else "revert")) for m in merges]
    assert claims(good)["verifier"].holds is True
    bad = [good[0], *(dataclasses.replace(m, watched=watched("revert")) for m in good[1:])]
    assert claims(bad)["verifier"].holds is False
