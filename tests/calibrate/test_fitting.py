"""A calibration as a whole, on made-up buildings: what it promises, to whom, and where it promises nothing."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from mapgraft.calibrate import Asked, Calibration, Fit, Labelled, Labels, RuleFit, calibrate
from mapgraft.calibrate.acceptance import acceptance, members
from mapgraft.calibrate.conformal import threshold
from mapgraft.calibrate.document import document
from mapgraft.calibrate.fitting import choice, parts
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.likeness import unlike
from mapgraft.calibrate.page import page_of
from mapgraft.calibrate.scoring import fitted, single
from mapgraft.calibrate.table import rules_text
from mapgraft.decision import Rule, parse_rules
from mapgraft.errors import UsageError

Make = Callable[..., list[Labelled]]
NUMBER = "posterior.log_odds"


def fit_of(calibration: Calibration) -> RuleFit:
    return calibration.rules[0]


def of_group(calibration: Calibration, own_m: float, other_m: float) -> Fit:
    return next(f for f in fit_of(calibration).fits if (f.group.own_m, f.group.other_m) == (own_m, other_m))


def labels(*parts_: Sequence[Labelled]) -> Labels:
    return Labels([example for part in parts_ for example in part])


def test_wrong_ones_of_the_same_buildings_are_accepted_as_rarely_as_promised(made: Make, installed: list[Rule]) -> None:
    taken, rights, missed = 0, 0, 0
    for seed in range(8):
        known = labels(made("a", 300, seed), made("b", 300, seed + 100))
        limit = fit_of(calibrate(known, installed, Asked(false_accept=0.02))).finest[0].accept
        fresh = made("a", 400, seed + 1000) + made("b", 400, seed + 2000)
        taken += sum(limit.passes(e.numbers[NUMBER]) for e in fresh if e.right is False)
        rights += sum(limit.passes(e.numbers[NUMBER]) for e in fresh if e.right)
        missed += sum(e.right is False for e in fresh)
    assert taken / missed <= 0.02
    assert rights / (8 * 800 - missed) > 0.8


def test_too_few_labels_accept_nothing_and_say_how_many_are_missing(made: Make, installed: list[Rule]) -> None:
    found = fit_of(calibrate(labels(made("a", 60, 1, share=0.5)), installed, Asked(false_accept=0.01)))
    wrong = next(iter(found.fits)).accept.wrong
    assert all(math.isinf(fit.accept.value) and fit.accept.missing == 99 - wrong for fit in found.fits)
    assert all(fit.revert is None and fit.confirm is None for fit in found.fits)


def test_a_group_with_few_labels_falls_back_to_the_coarser_one(
    made: Make, installed: list[Rule], group: Callable[..., Group]
) -> None:
    few = made("a", 20, 2, of=group(0.1, 0.05))
    found = calibrate(labels(made("a", 400, 1), few), installed, Asked(false_accept=0.02))
    fine, coarse = of_group(found, 0.1, 0.05).accept, of_group(found, 0.1, 0.05).group.coarser[1]
    assert fine.set_by == coarse
    assert fine.missing == 49 - sum(e.right is False for e in few)
    assert of_group(found, 0.07, 0.07).accept.own


def test_the_strictest_building_sets_the_threshold(made: Make, installed: list[Rule]) -> None:
    easy, hard = made("easy", 900, 1), made("hard", 300, 2, wrong_at=2.0)
    limit = of_group(calibrate(labels(easy, hard), installed, Asked(false_accept=0.02)), 0.07, 0.07).accept
    wrong = [e.numbers[NUMBER] for e in hard if e.right is False]
    assert limit.value == pytest.approx(threshold(wrong, 0.02), abs=1e-4)
    assert {cell.environment: cell.value is not None for cell in limit.cells} == {"easy": True, "hard": True}


def test_the_same_robots_who_meet_again_are_one_label(made: Make) -> None:
    examples = [dataclasses.replace(e, unit=("run", "a", "b")) for e in made("a", 500, 1)]
    limit = acceptance(examples, single(NUMBER), examples[0].group, 0.01)
    assert math.isinf(limit.value)
    assert limit.missing == 98


def test_what_persons_disagree_about_never_lowers_a_threshold(made: Make) -> None:
    sure = made("a", 400, 1)
    for low in (True, False):
        doubtful = [
            dataclasses.replace(e, unit=("doubt", *e.unit), right=None, contested=True)
            for e in made("a", 200, 2, wrong_at=-9.0 if low else 3.0, share=0.0)
        ]
        before, after = (
            acceptance(some, single(NUMBER), sure[0].group, 0.02).value for some in (sure, sure + doubtful)
        )
        assert after == before if low else after > before


def test_the_order_of_examples_makes_no_difference(made: Make, installed: list[Rule]) -> None:
    examples = made("a", 250, 1, watched=True) + made("b", 250, 2, watched=True)
    shuffled = [examples[n] for n in np.random.default_rng(0).permutation(len(examples))]
    for asked in (Asked(0.02, 0.02, 0.02), Asked(0.05, score="fit")):
        one, other = (fit_of(calibrate(labels(some), installed, asked)) for some in (examples, shuffled))
        assert [f.accept.value for f in one.fits] == [f.accept.value for f in other.fits]
        assert [f.revert and f.revert.value for f in one.fits] == [f.revert and f.revert.value for f in other.fits]
        assert one.score == other.score
        assert one.transfer.accept.reason == other.transfer.accept.reason


def test_costs_raise_a_threshold_and_never_lower_it(made: Make, installed: list[Rule]) -> None:
    known = labels(made("a", 400, 1), made("b", 400, 2))
    free, cheap, dear = (
        of_group(calibrate(known, installed, Asked(0.02, cost_false_accept=cost)), 0.07, 0.07).accept
        for cost in (None, 0.1, 200.0)
    )
    assert free.value == cheap.value < dear.value
    assert (free.raised_by, cheap.raised_by, dear.raised_by) == ("", "", "costs")


def test_buildings_that_differ_too_much_carry_no_guarantee(made: Make, installed: list[Rule]) -> None:
    found = fit_of(calibrate(labels(made("easy", 500, 1), made("hard", 500, 2, wrong_at=2.5)), installed, Asked(0.02)))
    assert found.transfer.accept.verdict == "none"
    assert "in hard would be accepted" in found.transfer.accept.reason


def test_alike_buildings_are_not_refuted_but_guarantee_nothing(made: Make, installed: list[Rule]) -> None:
    found = fit_of(calibrate(labels(*(made(name, 400, n) for n, name in enumerate("abc"))), installed, Asked(0.02)))
    assert found.transfer.accept.verdict == "not refuted"
    assert "3 buildings give no bound below 25 %" in found.transfer.accept.reason


def test_one_building_says_nothing_about_another(made: Make, installed: list[Rule]) -> None:
    found = fit_of(calibrate(labels(made("a", 400, 1)), installed, Asked(0.02)))
    assert (found.transfer.accept.verdict, found.transfer.left_out) == ("none", [])


def test_with_buildings_enough_a_further_one_keeps_the_promise(made: Make, installed: list[Rule]) -> None:
    rng = np.random.default_rng(4)
    taken, of = 0.0, 0
    for seed in range(6):
        middles = rng.normal(0.0, 1.5, 12)
        known = [made(f"b{n}", 40, 100 * seed + n, wrong_at=m) for n, m in enumerate(middles[:-2].tolist())]
        found = fit_of(calibrate(labels(*known), installed, Asked(0.2)))
        assert found.transfer.accept.verdict == "guaranteed"
        limit = found.fits[0].accept
        for middle in middles[-2:].tolist():
            fresh = [e for e in made("new", 60, 9000 + seed, wrong_at=middle) if e.right is False]
            taken += sum(limit.passes(e.numbers[NUMBER]) for e in fresh) / len(fresh)
            of += 1
    assert taken / of <= 0.2 + 2.0 * math.sqrt(0.2 * 0.8 / of)


def test_maps_unlike_those_labelled_are_told(made: Make, installed: list[Rule], group: Callable[..., Group]) -> None:
    known = labels(*(made(name, 400, n) for n, name in enumerate("abc")))
    like, unlike_, other = (
        made("d", 300, 7, share=0.7),
        made("e", 300, 8, wrong_at=2.0),
        made("f", 50, 9, of=group(0.3)),
    )
    for meant, verdict in ((like, "not refuted"), (like[:20], "none"), (unlike_, "none"), (other, "none")):
        blind = [dataclasses.replace(example, right=None, by="") for example in meant]
        found = fit_of(calibrate(known, installed, Asked(0.02), labels(blind)))
        assert found.transfer.accept.verdict == verdict
        assert found.transfer.target[0].refuted == (verdict == "none")


def test_a_mixture_of_what_is_known_is_nothing_new() -> None:
    rng = np.random.default_rng(1)
    right, wrong = rng.normal(4, 1, 2000), rng.normal(0, 1, 2000)
    mixture = np.concatenate((rng.normal(4, 1, 800), rng.normal(0, 1, 200)))
    assert unlike(mixture, right, wrong) < 0.05
    assert unlike(rng.normal(2, 1, 1000), right, wrong) > 0.2
    assert math.isnan(unlike(mixture[:5], right, wrong))


def test_limits_of_the_test_keep_their_promises(made: Make, installed: list[Rule]) -> None:
    known = made("a", 700, 1, watched=True) + made("b", 700, 2, watched=True)
    fit = fit_of(calibrate(labels(known), installed, Asked(0.02, 0.01, 0.02))).finest[0]
    assert fit.revert is not None
    assert fit.confirm is not None
    assert fit.revert.value is not None
    assert fit.confirm.value is not None
    assert fit.confirm.value < fit.revert.value
    fresh = made("a", 1500, 11, watched=True)
    reverted = [
        any(look.numbers["verifier.log_odds_wrong"] >= fit.revert.value for look in e.looks[1:])
        for e in fresh
        if e.right and fit.accept.passes(e.numbers[NUMBER])
    ]
    confirmed = [
        any(look.numbers["verifier.log_odds_wrong"] <= fit.confirm.value for look in e.looks[1:])
        for e in fresh
        if not e.right and fit.accept.passes(e.numbers[NUMBER])
    ]
    assert sum(reverted) / len(reverted) <= 0.04
    assert sum(confirmed) <= 0.02 * sum(not e.right for e in fresh)


def test_what_the_read_run_has_reverted_is_not_called_harmless(made: Make, installed: list[Rule]) -> None:
    known = [dataclasses.replace(e, reverted=bool(e.right)) for e in made("a", 700, 1, watched=True)]
    fit = fit_of(calibrate(labels(known), installed, Asked(0.02, 0.01, 0.02))).finest[0]
    assert fit.revert is not None
    assert fit.revert.value is None


def test_a_score_is_fitted_on_other_buildings_than_thresholds_are_set_on(made: Make, installed: list[Rule]) -> None:
    rule = next(rule for rule in installed if rule.name == made("a", 1, 1)[0].group.rule)
    examples = [e for n, name in enumerate("abcde") for e in made(name, 120, n)]
    across = [dataclasses.replace(e, environment="a+b") for e in made("a+b", 50, 9)]
    score, setting = choice(examples + across, rule, Asked(score="fit"))
    assert score.fitted_on
    assert not set(score.fitted_on) & {name for e in setting for name in e.buildings}
    ours, theirs = parts(examples + across)
    assert ours
    assert not {name for e in ours for name in e.buildings} & {name for e in theirs for name in e.buildings}
    assert choice(examples, rule, Asked()) == (single(NUMBER), examples)
    watched = [e for n, name in enumerate("ab") for e in made(name, 700, n, watched=True)]
    fit = fit_of(calibrate(labels(watched), installed, Asked(0.05, 0.01, 0.05, score="fit"))).finest[0]
    assert fit.confirm is not None
    assert fit.confirm.labels == fit.accept.wrong  # nor are the limits of the test set where the score was fitted


def test_a_fitted_score_takes_what_tells_and_leaves_noise(made: Make) -> None:
    score = fitted([e for n, name in enumerate("ab") for e in made(name, 400, n)])
    assert score is not None
    numbers = {term.number for term in score.terms}
    assert NUMBER in numbers
    assert "noise" not in numbers
    assert score.of({**dict.fromkeys(numbers, 1.0), NUMBER: 5.0}) > score.of(
        {**dict.fromkeys(numbers, 1.0), NUMBER: 0.0}
    )
    assert math.isnan(score.of({}))


def test_coarser_groups_hold_the_finer_ones(made: Make, group: Callable[..., Group]) -> None:
    examples = made("a", 10, 1) + made("a", 10, 2, of=group(0.1, 0.1))
    for step in examples[0].group.coarser:
        assert set(members(examples, examples[0].group)) <= set(members(examples, step))
        assert all(step.holds(example.group) == (step in example.group.coarser) for example in examples)
    assert len(members(examples, group().coarser[-1])) == 20


@pytest.mark.parametrize("asked", [{"false_accept": 0.0}, {"false_revert": 1.0}, {"cost_miss": -1.0}])
def test_rates_and_costs_that_are_none_are_refused(asked: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="must be"):
        Asked(**asked)


def test_labels_of_other_rules_are_refused_in_a_sentence(made: Make, installed: list[Rule]) -> None:
    strange = [dataclasses.replace(e, group=Group("mine")) for e in made("a", 10, 1)]
    with pytest.raises(UsageError, match=r"of the rules mine, the decision table has .* with --rules"):
        calibrate(labels(strange), installed, Asked())
    nobody = [dataclasses.replace(e, right=None, by="") for e in made("a", 10, 1)]
    with pytest.raises(UsageError, match=r"none of 10 examples in .* has a label"):
        calibrate(Labels(nobody, folders=["x"]), installed, Asked())


def test_of_a_verifier_that_keeps_its_limits_it_is_told_what_they_did(made: Make, installed: list[Rule]) -> None:
    rule = next(
        rule for rule in installed if rule.verify and rule.verify.use == "thresholds" and "prior" not in str(rule.when)
    )
    known = [
        dataclasses.replace(
            e, group=dataclasses.replace(e.group, rule=rule.name), reverted=n % 5 == 0, confirmed=n % 7 == 0
        )
        for n, e in enumerate(made("a", 400, 1, watched=True))
    ]
    fit = fit_of(calibrate(labels(known), installed, Asked(0.02, score=NUMBER))).finest[0]
    assert (fit.revert, fit.confirm) == (None, None)
    assert fit.kept is not None
    reverted, confirmed = fit.kept
    assert (reverted.count, reverted.of) == (
        sum(e.reverted for e in known if e.right),
        sum(bool(e.right) for e in known),
    )
    assert confirmed.count == sum(e.confirmed for e in known if not e.right)


def test_labels_that_are_a_choice_are_told(made: Make, installed: list[Rule]) -> None:
    examples = made("a", 400, 1)
    blind = [dataclasses.replace(e, unit=("blind", *e.unit), right=None, by="") for e in made("a", 200, 2)]
    near = [e for e in examples if 0.0 < e.numbers[NUMBER] < 4.0]
    alike, chosen = (calibrate(labels(some, blind), installed, Asked(0.05)).remarks for some in (examples, near))
    assert "of examples like the labelled ones" in " ".join(alike)
    assert "the labels are a choice" in " ".join(chosen)


@pytest.mark.parametrize("kind", ["right", "wrong", "contested", "scoreless"])
def test_labels_of_one_kind_make_no_error(made: Make, installed: list[Rule], kind: str) -> None:
    examples = made("a", 120, 1, watched=True)
    if kind == "contested":
        known = [dataclasses.replace(e, right=None, contested=True) for e in examples]
    elif kind == "scoreless":
        known = [dataclasses.replace(e, numbers={**e.numbers, NUMBER: math.nan}) for e in examples]
    else:
        known = [dataclasses.replace(e, right=kind == "right", right_later=kind == "right") for e in examples]
    for score in ("auto", "fit"):
        found = calibrate(labels(known), installed, Asked(0.05, 0.05, 0.05, score=score))
        parse_rules(rules_text(found), "here")
        assert "</html>" in page_of(found)
        json.dumps(document(found), allow_nan=False)
