"""Curves and thresholds, against cases counted by hand and against laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapgraft.evaluation.statistics import area
from mapgraft.experiments.andersone2021.outcome import Watched
from mapgraft.experiments.andersone2021.settings import PAPER
from mapgraft.experiments.andersone2021.telling.detection import (
    POOLED,
    WATCHED,
    best_threshold,
    curves,
    judged,
    roc,
    shipped_limits,
    transfers,
    verdicts,
)

NAN = math.nan
numbers = st.lists(st.tuples(st.integers(-4, 4).map(float) | st.just(NAN), st.booleans()), min_size=1, max_size=30)


def arrays(pairs):
    values, right = zip(*pairs, strict=True)
    return np.array(values), np.array(right)


def test_a_threshold_lies_in_the_middle_of_the_gap_that_separates():
    values, right = arrays([(1.0, True), (2.0, True), (4.0, False), (NAN, False), (9.0, False)])
    found = best_threshold(values, right, "lower")
    assert (found.value, found.false_positives, found.false_negatives, found.of) == (3.0, 0, 0, 4)
    found = best_threshold(-values, right, "higher")
    assert (found.value, found.errors) == (-3.0, 0)


def test_of_equally_good_thresholds_the_one_that_misses_fewest_wrong_merges():
    values, right = arrays([(1.0, True), (2.0, False), (3.0, True), (4.0, False)])
    found = best_threshold(values, right, "lower")  # 1.5 and 3.5 both make one error
    assert (found.value, found.false_positives, found.false_negatives) == (1.5, 1, 0)


def test_of_equally_good_gaps_the_widest():
    values, right = arrays([(0.0, True), (1.0, False), (2.0, True), (7.0, True), (8.0, False), (9.0, False)])
    found = best_threshold(values, right, "lower")
    assert (found.value, found.false_positives, found.false_negatives) == (7.5, 0, 1)


@pytest.mark.parametrize("right", [True, False])
def test_with_one_kind_alone_nothing_or_everything_is_called_wrong(right):
    values, kinds = arrays([(1.0, right), (2.0, right)])
    found = best_threshold(values, kinds, "higher")
    assert found.errors == 0
    assert judged(values, kinds, found.value, "higher").errors == 0


def test_without_a_number_there_is_no_threshold():
    found = best_threshold(np.array([NAN]), np.array([True]), "lower")
    assert math.isnan(found.value) and (found.errors, found.of) == (0, 0)


@given(numbers, st.sampled_from(["higher", "lower"]), st.floats(-5.0, 5.0))
def test_no_threshold_makes_fewer_errors_than_the_best(pairs, better, other):
    values, right = arrays(pairs)
    best = best_threshold(values, right, better)
    again = judged(values, right, best.value, better)
    assert (again.false_positives, again.false_negatives) == (best.false_positives, best.false_negatives)
    assert best.errors <= judged(values, right, other, better).errors


@given(numbers, st.sampled_from(["higher", "lower"]))
def test_the_area_below_the_points_is_the_area_that_is_told(pairs, better):
    values, right = arrays(pairs)
    there = ~np.isnan(values)
    if not 0 < right[there].sum() < there.sum():
        with pytest.raises(ValueError, match="right and wrong"):
            roc(values, right, better)
        return
    points = roc(values, right, better)
    assert points[0].tolist() == [0.0, 0.0] and points[-1].tolist() == [1.0, 1.0]
    assert (np.diff(points, axis=0) >= 0.0).all()
    told = area(values, right, np.ones((1, len(values))), better)
    assert np.trapezoid(points[:, 1], points[:, 0]) == pytest.approx(told.value)


def test_curves_are_of_every_number_that_can_tell(made, experiment_of):
    seen = [
        Watched("a rule", "keep", "", {"posterior": p, "same": 1.0}, {"posterior": p}) for p in (0.9, 0.8, 0.1, 0.2)
    ]
    merges = [
        made(right, n, two=(0.9, distance), watched=watched)
        for n, (right, distance, watched) in enumerate(
            zip((True, True, False, False), (1.0, NAN, 5.0, 6.0), seen, strict=True)
        )
    ]
    found = {(c.number, c.moment, c.source, c.group): c for c in curves(experiment_of(merges))}
    posterior = found["posterior", "end", WATCHED, POOLED]
    assert (posterior.area.value, posterior.area.told, posterior.threshold.value) == (1.0, False, pytest.approx(0.5))
    assert posterior.area.low == pytest.approx(0.025**0.5)  # two pairs of one right and one wrong merge
    assert ("same", "initial", WATCHED, POOLED) not in found  # equal for all
    assert ("distance", "end", "multi_map", POOLED) not in found  # one right merge has none, one is too few
    assert not any(key[2] == WATCHED for key in map(_key, curves(experiment_of(merges), watched=False)))


def _key(curve):
    return curve.number, curve.moment, curve.source, curve.group


def test_thresholds_are_applied_to_what_had_no_part_in_choosing_them(made, experiment_of):
    def result(held_out_distance):
        merges = [
            made(right, n, two=(0.9, distance), combination=combination)
            for combination, shift in ((PAPER[0], 0.0), (PAPER[2], held_out_distance))
            for n, (right, distance) in enumerate([(True, 1.0 + shift), (True, 2.0 + shift), (False, 4.0 + shift)])
        ]
        return {(t.rule.name, t.strategy, t.held_out): t for t in transfers(experiment_of(merges))}

    near, far = (result(shift)["distance_cells", "ledger", "one combination"] for shift in (0.0, 10.0))
    assert near.thresholds == {"0.07-0.07": 3.0, "0.1-0.07": 3.0} and (near.false_positives, near.false_negatives) == (
        0,
        0,
    )
    assert far.thresholds == {"0.07-0.07": 13.0, "0.1-0.07": 3.0}  # each chosen on the other one
    assert (far.false_positives, far.false_negatives, far.of) == (2, 1, 6)


def test_halves_hold_a_pair_with_all_its_resolutions(made, experiment_of):
    merges = [
        made(right, n, two=(0.9, float(n + 1)), combination=combination)
        for combination in (PAPER[0], PAPER[2])
        for n, right in enumerate((True, True, False, False))
    ]
    found = [t for t in transfers(experiment_of(merges)) if t.held_out == "half of the draws"]
    assert {tuple(t.thresholds) for t in found} == {("even draws", "odd draws")}
    cells = next(t for t in found if t.rule.name == "distance_cells" and t.strategy == "multi_map")
    assert cells.thresholds == {"even draws": 3.0, "odd draws": 2.0}  # draws 1, 3 have 2 and 4; draws 0, 2 have 1 and 3


def test_the_metrics_own_limits_are_counted(made, experiment_of):
    merges = [made(True, 0, two=(0.95, 1.0)), made(True, 1, two=(0.8, 2.0)), made(False, 2, two=(0.95, 1.2))]
    assert shipped_limits(merges, "distance", "ledger").false_positives == 1
    assert shipped_limits(merges, "distance", "ledger").false_negatives == 1
    similarity = shipped_limits(merges, "similarity", "ledger")
    assert (similarity.false_positives, similarity.false_negatives, similarity.of) == (1, 1, 3)
    assert math.isnan(similarity.value)


def test_verdicts_are_counted_by_kind(made, experiment_of):
    actions = ("revert", "confirm", "", "revert")
    merges = [
        made(n < 2, n, watched=Watched("rule" if action else "", action, "", {}, {}))
        for n, action in enumerate(actions)
    ]
    experiment = experiment_of(merges)
    assert verdicts(experiment, None, right=True) == {"revert": 1, "confirm": 1, "keep": 0, "unseen": 0}
    assert verdicts(experiment, PAPER[0], right=False) == {"revert": 1, "confirm": 0, "keep": 0, "unseen": 1}
    assert sum(verdicts(experiment, PAPER[1], right=False).values()) == 0
