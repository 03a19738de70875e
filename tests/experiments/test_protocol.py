"""The protocol of the paper: what is drawn, what is accepted, how it is kept, what a revert leaves."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
import pytest

from mapgraft.config import parse_config
from mapgraft.errors import RecordingError, UsageError
from mapgraft.evaluation import Course, Drawing, draw_pairs
from mapgraft.evaluation.drawing import draw_on
from mapgraft.experiments.andersone2021 import STRATEGIES, Combination, Laboratory, Settings, conduct
from mapgraft.experiments.andersone2021.keeping import compare, time_updates
from mapgraft.experiments.andersone2021.raster import FREE, OCCUPIED, UNKNOWN, raster_of
from mapgraft.experiments.andersone2021.settings import PAPER
from mapgraft.experiments.andersone2021.store import parquet_files
from mapgraft.plugins import load_plugins


def test_as_many_of_each_kind_as_are_wanted(experiment):
    counts = Counter((merge.combination, merge.right) for merge in experiment.merges)
    assert counts == {(combination, right): 2 for combination in PAPER for right in (True, False)}
    for search in experiment.searches:
        assert search.right >= 2 and search.wrong >= 2
        assert search.drawn == search.right + search.wrong + search.refused + search.unmatched
    assert (experiment.matcher, experiment.similarity_min, list(experiment.remarks)) == ("carpin", 0.9, [])


def test_what_is_accepted_is_similar_enough_and_right_is_what_lies_right(experiment):
    for merge in experiment.merges:
        assert merge.by["multi_map"].initial["similarity"] >= 0.9
        assert merge.right == (merge.error_m <= 0.5 and merge.error_deg <= 5.0)


def test_windows_are_of_one_length_and_far_from_each_other(experiment):
    for merge in experiment.merges:
        receiver, donor = merge.plan.receiver, merge.plan.donor
        assert (len(receiver.observations), len(receiver.following), len(donor.observations)) == (30, 10, 30)
        if receiver.course is donor.course:
            assert abs(receiver.first - donor.first) >= 40 + 40


def test_the_ledger_sees_what_two_maps_see_and_leaves_nothing(experiment):
    for merge in experiment.merges:
        ledger, two = merge.by["ledger"], merge.by["multi_map"]
        assert (repr(ledger.initial), repr(ledger.end)) == (repr(two.initial), repr(two.end))  # NaN included
        for kept in (ledger, two):
            left = kept.leftovers
            assert left.identical and kept.exactness.exact
            assert (left.lost, left.alien, left.changed, left.touched) == (0, 0, 0, 0)


def test_a_single_map_agrees_with_what_it_holds_and_keeps_some_of_it(experiment):
    for merge in experiment.merges:
        one, two = merge.by["single_map"], merge.by["multi_map"]
        assert one.initial["similarity"] >= two.initial["similarity"]
        assert not one.leftovers.identical and one.exactness.cells_contaminated > 0
        left = one.leftovers
        assert left.touched <= one.exactness.cells_contaminated  # what shows holds something of the donor
        assert left.lost + left.alien + left.changed <= left.touched


def test_the_maps_that_metrics_see_are_those_of_the_paper(laboratory, experiment):
    """One map: the merged one against the donor's. Two maps: the original, which goes on as if nothing had been."""
    merge = experiment.merges[0]
    graft = regrafted(laboratory, merge)
    one, two = graft.merged("single_map"), graft.merged("multi_map")
    assert graft.comparison(one).target.known() == two.fused().known()
    assert graft.comparison(two).target.known() == graft.pair.receiver.map.known() < two.fused().known()


def regrafted(laboratory, merge):
    pair = laboratory.built(merge.plan, merge.combination)
    found = laboratory.tools.matcher.match(pair.receiver.map, pair.donor.map, None)
    (match,) = (match for match in found if match.T_receiver_donor == merge.T_receiver_donor)
    return laboratory.graft(pair, match)


def test_leftovers_are_counted_cell_by_cell(laboratory, experiment):
    merge = max(experiment.merges, key=lambda merge: merge.by["single_map"].leftovers.changed)
    graft = regrafted(laboratory, merge)
    reverted, never = graft.merged("single_map"), graft.never_merged()
    for observation in graft.pair.further:
        reverted.observe(observation)
    reverted.revert("merge")
    maps = [raster_of(graft.map_type, one.fused()) for one in (reverted, never)]
    cells = [
        {
            (x + one.origin[0], y + one.origin[1]): (int(one.classes[y, x]), int(one.percent[y, x]))
            for y, x in np.ndindex(one.percent.shape)
        }
        for one in maps
    ]
    pairs = [tuple(one.get(cell, (UNKNOWN, -1)) for one in cells) for cell in cells[0].keys() | cells[1].keys()]
    classes = Counter((now[0], then[0]) for now, then in pairs)
    left = compare(graft.map_type, reverted.fused(), never.fused(), identical=False)
    assert left == merge.by["single_map"].leftovers
    assert left.changed == classes[FREE, OCCUPIED] + classes[OCCUPIED, FREE] > 0
    assert left.lost == classes[UNKNOWN, FREE] + classes[UNKNOWN, OCCUPIED]
    assert left.alien == classes[FREE, UNKNOWN] + classes[OCCUPIED, UNKNOWN]
    assert left.touched == sum(now[1] != then[1] for now, then in pairs)
    assert left.known == never.fused().known()


def test_every_way_of_keeping_is_timed_on_every_scan(laboratory, experiment):
    costs = time_updates(regrafted(laboratory, experiment.merges[0]), rounds=1)
    assert set(costs) == set(STRATEGIES)
    for cost in costs.values():
        assert 0.0 < cost.update_s < cost.mapped_s < math.inf and cost.compared_s > 0.0


def test_our_own_rules_watch_every_merge_for_which_they_have_a_rule(experiment):
    for merge in experiment.merges:
        watched = merge.watched
        assert watched.rule == "grids of any resolution" and watched.action in ("keep", "confirm", "revert")
        assert {"posterior", "news", "rays", "contradiction"} <= watched.initial.keys()
        assert math.isfinite(watched.end["verifier.log_odds_wrong"]) or watched.end["news.against"] == 0
    assert experiment.better["posterior"] == "higher" and experiment.better["contradiction"] == "lower"


def test_the_same_again(laboratory, experiment):
    """But for the times."""
    told: list[tuple[int, int, int]] = []
    again = conduct(laboratory, lambda *counts: told.append(counts))
    drawn = sum(search.drawn for search in again.searches)
    assert told[0] == (0, 12, 0) and told[-1] == (len(again.merges), 12, drawn)
    assert len(told) == 1 + drawn  # every pair moves it on
    ours, theirs = parquet_files(experiment), parquet_files(again)
    assert ours.keys() == theirs.keys() == {"merges.parquet", "evidence.parquet", "verdicts.parquet", "times.parquet"}
    assert all(ours[name] == theirs[name] for name in ours if name != "times.parquet")


def test_the_stream_of_pairs_begins_with_those_that_are_drawn_at_once(laboratory):
    drawing = Drawing(pairs=20, across=0.0, seed=3)
    at_once, stream = draw_pairs(laboratory.courses, drawing), draw_on(laboratory.courses, drawing)
    for plan in at_once:
        other = next(stream)
        assert (plan.number, plan.receiver.first, plan.donor.first) == (
            other.number,
            other.receiver.first,
            other.donor.first,
        )
        assert (plan.receiver_turn_rad, plan.donor_turn_rad) == (other.receiver_turn_rad, other.donor_turn_rad)


def test_the_stream_ends_with_the_last_pair(laboratory):
    course = laboratory.courses[0]
    short = dataclasses.replace(course, observations=course.observations[:124], stamps_ns=None)
    drawn = {(p.receiver.first, p.donor.first) for p in draw_on([short], Drawing(pairs=1, across=0.0))}
    starts = range(124 - 40 + 1)
    assert drawn == {(a, b) for a in starts for b in starts if abs(a - b) >= 80}


def small(courses: Sequence[Course], **settings) -> Laboratory:
    return Laboratory.of(courses, parse_config({}), Settings(**settings), load_plugins())


def test_what_cannot_be_found_is_said(laboratory):
    made = conduct(small(laboratory.courses, right=25, wrong=25, draws=20, combinations=(Combination(0.1, 0.1),)))
    (search,) = made.searches
    assert search.drawn == 20 and search.right > 0 and search.wrong > 0
    assert list(made.remarks) == [
        f"0.1-0.1: {search.right} of 25 right merges were found in 20 pairs; its averages rest on those",
        f"0.1-0.1: {search.wrong} of 25 wrong merges were found in 20 pairs; its averages rest on those",
    ]


def test_nothing_to_merge_is_an_error(laboratory):
    """Two windows only, of which no merge comes."""
    course = laboratory.courses[0]
    short = dataclasses.replace(course, observations=course.observations[:120], stamps_ns=None)
    with pytest.raises(RecordingError, match="of 2 pairs of partial maps none was merged by carpin"):
        conduct(small([short], right=1, wrong=0, combinations=(Combination(0.1, 0.1),)))


def test_another_matcher(laboratory):
    settings = {"right": 1, "wrong": 0, "matcher": "correlation", "combinations": (Combination(0.1, 0.1),)}
    made = conduct(small(laboratory.courses, **settings))
    assert made.matcher == "correlation" and [merge.right for merge in made.merges] == [True]


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"right": -1}, "right must be at least 0, found -1"),
        ({"right": 0, "wrong": 0}, "there is nothing to do"),
        ({"draws": 0}, "draws must be at least 1"),
        ({"further": 0}, "further must be at least 1"),
        ({"matcher": "none such"}, "none such"),
        ({"scans": 500}, "no recording holds two windows"),
    ],
)
def test_wrong_usage_is_one_sentence(laboratory, settings, sentence):
    with pytest.raises(UsageError, match=sentence):
        conduct(small(laboratory.courses, **settings))


def test_maps_of_another_type_are_refused(laboratory):
    config = parse_config({"map": {"type": "landmarks"}})
    with pytest.raises(UsageError, match="occupancy_grid, the configuration wants landmarks"):
        Laboratory.of(laboratory.courses, config, Settings(), load_plugins())
