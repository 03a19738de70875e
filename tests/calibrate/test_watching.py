"""Limits of confirmation and reversal: promised of all that the new rules merge, and in every building by itself."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from mapgraft.calibrate import Asked, Calibration, Fit, Labelled, Labels, calibrate
from mapgraft.calibrate.labelled import Look
from mapgraft.calibrate.table import rules_text
from mapgraft.calibrate.taking import vetoes_of
from mapgraft.calibrate.watching import Limit
from mapgraft.decision import Rule, parse_rules

Make = Callable[..., list[Labelled]]
NUMBER = "posterior.log_odds"
ASKED = Asked(0.02, 0.02, 0.02)


def found(installed: list[Rule], examples: Sequence[Labelled], asked: Asked = ASKED) -> tuple[Calibration, Fit]:
    calibration = calibrate(Labels(list(examples), folders=["x"]), installed, asked)
    return calibration, calibration.rules[0].finest[0]


def limits(fit: Fit) -> tuple[Limit, Limit]:
    assert fit.revert is not None
    assert fit.confirm is not None
    return fit.revert, fit.confirm


def as_run_with(examples: Sequence[Labelled], threshold: float) -> list[Labelled]:
    """The same as a run tells of them that merges above a threshold only: nobody watched the others."""
    return [
        e if e.numbers[NUMBER] > threshold else dataclasses.replace(e, looks=(), right_later=None) for e in examples
    ]


def highest(example: Labelled) -> float:
    return max(look.numbers["verifier.log_odds_wrong"] for look in example.looks[1:])


def test_what_the_new_rules_merge_and_nobody_watched_leaves_no_promise(made: Make, installed: list[Rule]) -> None:
    everything = made("a", 900, 1, watched=True) + made("b", 900, 2, watched=True)
    calibration, fit = found(installed, as_run_with(everything, 4.0))
    revert, confirm = limits(fit)
    assert fit.accept.value < 4.0
    assert revert.value is None
    assert revert.unwatched == sum(
        bool(e.right) and fit.accept.passes(e.numbers[NUMBER]) and e.numbers[NUMBER] <= 4.0 for e in everything
    )
    remark = next(one for one in calibration.remarks if "nobody watched" in one)
    assert "mapgraft calibrate --collecting" in remark
    text = " ".join(rules_text(calibration).replace("#", " ").split())
    assert "Reverts as before" in text
    assert "were not when the examples were made" in text
    rule = parse_rules(rules_text(calibration), "here")[0]
    assert rule.verify is not None
    assert "revert_at" not in rule.verify.parameters
    assert fit.prior_reverts
    assert confirm.labels == fit.accept.wrong  # what is not merged is not confirmed, whether somebody watched or not


def test_with_all_that_is_merged_watched_the_promise_is_kept(made: Make, installed: list[Rule]) -> None:
    reverted, of = 0, 0
    for seed in range(6):
        everything = made("a", 500, seed, watched=True) + made("b", 500, seed + 50, watched=True)
        calibration, fit = found(installed, as_run_with(everything, 1.0))
        revert, confirm = limits(fit)
        assert fit.accept.value > 1.0
        assert revert.value is not None
        assert confirm.value is not None
        assert (revert.unwatched, confirm.unwatched) == (0, 0)
        assert not [one for one in calibration.remarks if "nobody watched" in one]
        fresh = [
            e for e in made("a", 500, seed + 900, watched=True) if e.right and e.numbers[NUMBER] > fit.accept.value
        ]
        reverted += sum(highest(e) >= revert.value for e in fresh)
        of += len(fresh)
    assert reverted / of <= 0.02 + 2.0 * math.sqrt(0.02 / of)


def test_a_few_that_nobody_watched_count_as_the_worst(made: Make, installed: list[Rule]) -> None:
    examples = made("a", 2000, 1, watched=True)
    _, whole = found(installed, examples)
    merged = [n for n, e in enumerate(examples) if e.right and whole.accept.passes(e.numbers[NUMBER])]
    for count in (1, 3, round(0.1 * len(merged))):
        some = list(examples)
        for n in merged[:count]:
            some[n] = dataclasses.replace(some[n], looks=(), right_later=None)
        _, fit = found(installed, some)
        before, after = limits(whole)[0], limits(fit)[0]
        assert (after.unwatched, after.labels) == (count, before.labels)
        assert before.value is not None
        if count < 10:
            assert after.value is not None
            assert after.value >= before.value
            assert after.harm is not None
            assert after.harm.count >= count
        else:
            assert after.value is None


def test_wrong_ones_that_nobody_watched_take_the_promise_on_confirmation(made: Make, installed: list[Rule]) -> None:
    examples = made("a", 900, 1, watched=True)
    _, whole = found(installed, examples)
    taken = [n for n, e in enumerate(examples) if e.right is False and whole.accept.passes(e.numbers[NUMBER])]
    assert limits(whole)[1].value is not None
    strict = Asked(0.02, 0.002, 0.02)
    many = examples + made("a2", 900, 5, watched=True)
    for n in taken:
        many[n] = dataclasses.replace(many[n], looks=(), right_later=None)
    calibration, fit = found(installed, many, strict)
    confirm = limits(fit)[1]
    assert confirm.unwatched >= 1
    assert confirm.value is None
    assert "--collecting" in confirm.why
    assert "Never confirms" in rules_text(calibration)


def test_what_a_veto_stops_is_not_merged(made: Make, installed: list[Rule]) -> None:
    rule = next(rule for rule in installed if rule.name == made("a", 1, 1)[0].group.rule)
    assert [(veto.number, veto.high) for veto in vetoes_of(rule)] == [("paths", 4.0)]
    examples = [
        dataclasses.replace(e, numbers={**e.numbers, "paths": 9.0}, looks=(), right_later=None) if n % 3 == 0 else e
        for n, e in enumerate(made("a", 900, 1, watched=True))
    ]
    _, fit = found(installed, examples)
    revert, _ = limits(fit)
    assert revert.unwatched == 0
    assert revert.value is not None
    unknown = [dataclasses.replace(e, numbers={**e.numbers, "paths": math.nan}) for e in examples]
    assert limits(found(installed, unknown)[1])[0].unwatched > 0  # what cannot be measured breaks no veto


def judged_at(log_odds: float) -> list[Look]:
    """A merge that was judged at one look by these log-odds, and is surely right at all others."""
    return [
        Look(10 * n, {"verifier.log_odds_wrong": log_odds if n == 3 else -4.0, "news.agreed": 4.0 * n + 1.0})
        for n in range(6)
    ]


def buildings(made: Make, rng: np.random.Generator) -> list[Labelled]:
    """Twelve, of which one has right merges that look wrong now and then."""
    out = []
    for number in range(12):
        hard = (number == 0) * 20
        rights = made(f"b{number}", 200, number, share=1.0)
        for k, example in enumerate(rights):
            looks = judged_at(5.0 if k < hard else float(rng.uniform(-3.0, 0.5)))
            out.append(dataclasses.replace(example, looks=looks, right_later=True))
        out += made(f"b{number}", 150, number + 100, share=0.0, watched=True)
    return [dataclasses.replace(e, unit=(*e.unit, str(e.right))) for e in out]


def test_every_building_keeps_the_promise_on_reversal(made: Make, installed: list[Rule]) -> None:
    calibration, fit = found(installed, buildings(made, np.random.default_rng(0)), Asked(0.02, 0.02, 0.01))
    revert, _ = limits(fit)
    assert revert.value is not None
    assert revert.value > 5.0
    alone = {share.environment: share.value for share in revert.environments}
    assert alone["b0"] == revert.value
    assert all(value is not None and value < 1.0 for name, value in alone.items() if name != "b0")
    assert calibration.rules[0].transfer.revert is not None
    assert calibration.rules[0].transfer.revert.verdict == "none"
    assert "of the right merges in b0 would be reverted" in calibration.rules[0].transfer.revert.reason


def test_every_building_keeps_the_promise_on_confirmation(made: Make, installed: list[Rule]) -> None:
    examples = []
    for number in range(6):
        for example in made(f"b{number}", 400, number, watched=True):
            hard = number == 0 and example.right is False and example.numbers[NUMBER] > 1.0
            looks = judged_at(-6.0) if hard else example.looks
            examples.append(dataclasses.replace(example, looks=looks))
    _, fit = found(installed, examples, Asked(0.05, 0.01, 0.05))
    _, confirm = limits(fit)
    assert confirm.value is not None
    assert confirm.value < -6.0
    alone = {share.environment: share.value for share in confirm.environments}
    assert alone["b0"] == confirm.value
    assert all(value is not None and value > -6.0 for name, value in alone.items() if name != "b0")


@pytest.mark.parametrize("kind", ["right", "wrong"])
def test_a_merge_that_nobody_looked_at_again_is_left_out(made: Make, installed: list[Rule], kind: str) -> None:
    examples = made("a", 900, 1, watched=True)
    last = [
        dataclasses.replace(e, unit=("late", *e.unit), looks=[Look(0, {"verifier.log_odds_wrong": -4.0})])
        for e in made("a", 300, 2, watched=True)
        if e.right is (kind == "right")
    ]
    fit = found(installed, examples + last)[1]
    merged = sum(fit.accept.passes(e.numbers[NUMBER]) for e in last)
    assert merged
    limit = limits(fit)[0 if kind == "right" else 1]
    of = [e for e in examples + last if e.right is (kind == "right")]
    of = [e for e in of if kind == "wrong" or fit.accept.passes(e.numbers[NUMBER])]
    assert (limit.labels, limit.unwatched) == (len(of) - merged, 0)
