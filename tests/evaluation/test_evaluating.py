"""Whole evaluations: matchers that know the truth, that lie, and that are no oracles."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import mapgraft_landmarks
import pytest

from mapgraft.config import parse_config
from mapgraft.errors import PluginError, UsageError
from mapgraft.evaluation import Settings, document, evaluate_courses
from mapgraft.evaluation.statistics import Share
from mapgraft.job import provenance_of
from mapgraft.plugins import Origin, load_plugin, load_plugins

CONFIG = parse_config({})


def whole(share: Share) -> bool:
    return share.of > 0 and share.count == share.of


def none(share: Share) -> bool:
    return share.of > 0 and share.count == 0


def told(evaluation, courses, **kwargs) -> str:
    """The document without what a clock told."""
    bench = evaluation.bench
    content = document(evaluation, provenance_of([], CONFIG, bench.plugins, bench.contenders[0].table))
    assert content.pop("times")["elapsed_s"] > 0.0
    return json.dumps(content, allow_nan=False)


def test_who_says_the_truth_is_right_and_who_lies_is_wrong(courses, plugins, rules, small, tell_truth):
    settings = Settings(small, rules=rules, matcher="oracle", baseline=False)
    tell_truth(settings)
    right = evaluate_courses(courses, CONFIG, settings, plugins).summaries["judged"]
    assert (right.pairs, right.across, right.right, right.wrong, right.without_hypothesis) == (12, 3, 9, 0, 3)
    assert all(bin_.recall.count == bin_.recall.of for bin_ in right.recall)
    assert sum(bin_.recall.of for bin_ in right.recall) == 9
    assert (right.acceptance.right.count, right.acceptance.right.of) == (9, 12)
    assert none(right.acceptance.wrong) and none(right.acceptance.wrong_across)
    assert none(right.afterwards.right_reverted) and right.afterwards.right_confirmed.count > 0
    assert right.afterwards.right_confirmed.count + right.afterwards.right_provisional.count == 9
    assert none(right.afterwards.wrong_confirmed) and right.afterwards.wrong_reverted.of == 0
    assert whole(right.covariance.inside) and none(right.covariance.degenerate) and right.covariance.without == 0

    lying = dataclasses.replace(settings, matcher="liar")
    wrong = evaluate_courses(courses, CONFIG, lying, plugins).summaries["judged"]
    assert (wrong.right, wrong.wrong, wrong.without_hypothesis) == (0, 9, 3)
    assert all(bin_.recall.count == 0 for bin_ in wrong.recall)
    assert whole(wrong.acceptance.wrong_of_wrong) and none(wrong.acceptance.right)
    assert 0 < wrong.afterwards.wrong_confirmed.count <= 9 and wrong.afterwards.wrong_confirmed.of == 12
    assert wrong.afterwards.wrong_confirmed.count + wrong.afterwards.wrong_provisional.count == 9
    assert wrong.afterwards.right_reverted.of == 0 and wrong.covariance.inside.of == 0


def test_every_pair_can_be_looked_at(courses, plugins, rules, small, tell_truth):
    settings = Settings(small, rules=rules, resolution_m=0.07, other_resolution_m=0.1, baseline=False)
    tell_truth(settings)
    evaluation = evaluate_courses(courses, CONFIG, settings, plugins)
    content = json.loads(told(evaluation, courses))
    assert content["parameters"]["resolution_m"] == 0.07 and content["parameters"]["other_resolution_m"] == 0.1
    assert [pair["pair"] for pair in content["pairs"]] == list(range(12))
    for pair in content["pairs"]:
        judged = pair["judged"]
        if pair["across"]:
            assert (pair["overlap"], pair["new_wall_m"]) == (None, None)
            assert (judged["verdict"], judged["right"], judged["best"]) == ("unmatched", None, None)
            assert "no hypothesis" in judged["reason"]
            continue
        assert judged["verdict"] == "provisional"
        assert judged["state"] == ("provisional" if judged["later"]["similarity"] is None else "confirmed")
        assert judged["best"]["error_m"] < 1e-3 and judged["final"]["error_deg"] < 1e-3
        assert judged["numbers"]["score"] == 2.0 and judged["numbers"]["evidence.told"] == 1.0
        assert judged["numbers"]["similarity"] is None or 0.0 < judged["numbers"]["similarity"] <= 1.0
        assert judged["ellipse_distance2"] < 1e-3
    assert {tuple(sorted(pair)) for pair in content["pairs"]} == {tuple(sorted(content["pairs"][0]))}


def test_a_verifier_takes_the_place_of_the_rules_own(courses, plugins, rules, small, tell_truth):
    settings = Settings(small, rules=rules, matcher="liar", baseline=False)
    tell_truth(settings)
    rules.write_text(rules.read_text().replace("confirm_after: 5, new_support: 0", "confirm_after: null"))
    kept = evaluate_courses(courses, CONFIG, settings, plugins).summaries["judged"]
    assert whole(kept.acceptance.wrong_of_wrong)
    assert kept.afterwards.wrong_provisional.count == 9 and kept.afterwards.wrong_confirmed.count == 0
    strict = rules.read_text().replace("metrics: {similarity: {min: 0.0}}, every", "metrics: {distance: {}}, every")
    rules.write_text(strict)
    judged = evaluate_courses(courses, CONFIG, settings, plugins).summaries["judged"]
    assert judged.afterwards.wrong_reverted.count > 0
    assert judged.afterwards.wrong_reverted.count + judged.afterwards.wrong_provisional.count == 9


def test_the_outcome_is_the_same_again_and_from_several_processes(courses, small):
    settings = Settings(dataclasses.replace(small, pairs=4), matcher="carpin", resolution_m=0.1)
    plugins = load_plugins()
    once, again = (evaluate_courses(courses, CONFIG, settings, plugins) for _ in range(2))
    assert once.titles == {"judged": "carpin", "baseline": "carpin, the paper's rules"}
    shared = evaluate_courses(courses, CONFIG, settings, plugins, jobs=2)
    assert told(once, courses) == told(again, courses) == told(shared, courses)
    assert once.times["judged"].match_ms.count == 4


def test_progress_is_told(courses, plugins, rules, small):
    done: list[int] = []
    settings = Settings(dataclasses.replace(small, pairs=3), rules=rules, baseline=False)
    evaluate_courses(courses, CONFIG, settings, plugins, progress=done.append)
    assert done == [0, 1, 2, 3]


def test_pairs_that_the_table_turns_away_are_counted_apart(courses, plugins, rules, small):
    rules.write_text(rules.read_text().replace("other.type: occupancy_grid", "other.known_area_m2: {min: 1000000}"))
    turned_away = evaluate_courses(courses, CONFIG, Settings(small, rules=rules, baseline=False), plugins)
    summary = turned_away.summaries["judged"]
    assert (summary.rejected, summary.right, summary.wrong, summary.without_hypothesis) == (12, 0, 0, 0)
    assert sum(bin_.rejected for bin_ in summary.recall) == 9
    assert all(bin_.recall.of == 0 for bin_ in summary.recall)
    assert len(turned_away.remarks) == 1
    assert "12 of 12 pairs were turned away" in turned_away.remarks[0] and "1e+06" in turned_away.remarks[0]
    assert turned_away.titles == {"judged": "no rule applied"}
    assert turned_away.judged[0].by["judged"].match_s is None


def test_any_map_type_can_be_evaluated(courses, small):
    """A stranger's: narrow things that stand free. There is no baseline for it."""
    plugins = load_plugins(["point_landmarks"]) if _installed() else load_plugins()
    load_plugin(plugins, mapgraft_landmarks, Origin("point_landmarks", "mapgraft-landmarks", "1.2.0"))
    settings = Settings(dataclasses.replace(small, pairs=4), map_type="point_landmarks")
    evaluation = evaluate_courses(courses, CONFIG, settings, plugins)
    assert list(evaluation.summaries) == ["judged"]
    assert any(remark.startswith("no baseline: ") for remark in evaluation.bench.remarks)
    assert evaluation.summaries["judged"].pairs == 4
    assert all(0.0 <= overlap <= 1.0 for one in evaluation.judged if (overlap := one.by["judged"].overlap) is not None)


def test_the_donor_may_map_something_else(courses, plugins, small):
    """Lines and grids: the truth is told in the receiver's type, and there is no baseline."""
    few = dataclasses.replace(small, pairs=2, further=0, across=0.0)
    settings = Settings(few, map_type="line_segments", other_map_type="occupancy_grid", other_resolution_m=0.1)
    evaluation = evaluate_courses(courses, CONFIG, settings, plugins)
    assert list(evaluation.summaries) == ["judged"]
    assert {one.by["judged"].rule for one in evaluation.judged} == {"a grid into line segments"}
    assert all(one.by["judged"].overlap is not None for one in evaluation.judged)
    parameters = json.loads(told(evaluation, courses))["parameters"]
    assert (parameters["map_type"], parameters["other_map_type"]) == ("line_segments", "occupancy_grid")
    assert (parameters["resolution_m"], parameters["other_resolution_m"]) == (None, 0.1)


def _installed() -> bool:
    return any(offered.origin.plugin == "point_landmarks" for offered in load_plugins().offered.values())


def test_a_broken_matcher_is_named_with_the_pair(courses, plugins, rules, small):
    with pytest.raises(PluginError, match=r"pair 0: rule 'whatever matches': the matcher 'broken'.*by nothing"):
        evaluate_courses(courses, CONFIG, Settings(small, rules=rules, matcher="broken", baseline=False), plugins)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"matcher": "corelation"}, "corelation"),
        ({"verifier": "nobody"}, "nobody"),
        ({"map_type": "sponge"}, "sponge"),
        ({"other_map_type": "sponge"}, "sponge"),
        ({"rules": Path("/nowhere/rules.yaml")}, "/nowhere/rules.yaml"),
    ],
)
def test_what_is_not_there_is_said(courses, plugins, small, wrong, sentence):
    with pytest.raises((UsageError, PluginError), match=sentence):
        evaluate_courses(courses, CONFIG, Settings(small, **wrong), plugins)


@pytest.mark.parametrize("resolution_m", [0.0, -0.1, float("nan"), float("inf")])
def test_resolutions_that_are_none_are_refused(resolution_m):
    with pytest.raises(UsageError, match="above 0 metres"):
        Settings(other_resolution_m=resolution_m)


def test_at_least_one_process_is_needed(courses, plugins, small):
    with pytest.raises(UsageError, match="jobs must be at least 1, found 0"):
        evaluate_courses(courses, CONFIG, Settings(small), plugins, jobs=0)
