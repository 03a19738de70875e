"""The table that a calibration is given: what of it stays, what is refused, and what another calibration has made."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.calibrate import Asked, Calibration, Labelled, Labels, calibrate
from mapgraft.calibrate.collecting import collecting_text
from mapgraft.calibrate.document import document
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.page import page_of
from mapgraft.calibrate.regression import Curve
from mapgraft.calibrate.rules import rules_of
from mapgraft.calibrate.table import rules_text
from mapgraft.decision import Range, Rule, holds, parse_rules
from mapgraft.errors import UsageError
from mapgraft_standard.calibrated import Calibrated
from mapgraft_standard.sequential import Sequential

Make = Callable[..., list[Labelled]]
GRIDS = "grids of any resolution"
CLOUDS = "clouds that know what is free"
KNOWN = "grids with a known pose"


def of_rule(examples: Sequence[Labelled], name: str, **changes: Any) -> list[Labelled]:
    return [dataclasses.replace(e, group=dataclasses.replace(e.group, rule=name), **changes) for e in examples]


def find(rules: Sequence[Rule], name: str) -> Rule:
    return next(rule for rule in rules if rule.name == name)


def changed(rules: Sequence[Rule], name: str, **verify: Any) -> list[Rule]:
    """The same rules, of which one tells its verifier more."""

    def change(rule: Rule) -> Rule:
        told = rule.procedure.verify
        return rule.model_copy(update={"verify": type(told).model_validate({**told.model_dump(), **verify})})

    return [change(rule) if rule.name == name else rule for rule in rules]


@pytest.fixture(scope="module")
def watched(made: Make) -> Labels:
    return Labels([e for n, name in enumerate("ab") for e in made(name, 300, n, watched=True)])


ASKED = Asked(0.02, 0.01, 0.05)


def test_limits_of_the_acceptor_thresholds_stay_as_vetoes(made: Make, installed: list[Rule]) -> None:
    clouds = Group(CLOUDS, "point_cloud", "point_cloud", "ledger", resolutions=True)
    labels = Labels([e for n, name in enumerate("abcd") for e in made(name, 150, n, of=clouds)])
    found = calibrate(labels, installed, Asked(0.05, score="fit"))
    before = find(installed, CLOUDS)
    written = [rule for _, rule in rules_of(found.rules[0])]
    assert [rule.name for rule in written][-1] == CLOUDS
    for rule in written:
        accept = rule.procedure.accept
        assert accept.use == "calibrated"
        assert accept.parameters["limits"] == before.procedure.accept.parameters
        assert set(accept.metric_names) >= set(before.procedure.accept.metric_names)
        assert rule.candidates == before.candidates  # the margin is one to the others
        Calibrated(**accept.parameters)
    assert "Vetoes of the rule stay" in rules_text(found)


def test_a_posteriors_limits_that_metrics_name_themselves_stay_too(watched: Labels, installed: list[Rule]) -> None:
    told: dict[str, Any] = {
        "use": "posterior",
        "refuted": -2.0,
        "metrics": {"posterior": {}, "paths": {"max": 4}, "similarity": {}},
    }
    accept = type(find(installed, GRIDS).procedure.accept).model_validate(told)
    rules = [rule.model_copy(update={"accept": accept}) if rule.name == GRIDS else rule for rule in installed]
    for asked in (ASKED, dataclasses.replace(ASKED, score="kappa")):
        rule = next(rule for _, rule in rules_of(calibrate(watched, rules, asked).rules[0]))
        acceptor = Calibrated(**rule.procedure.accept.parameters)
        assert (set(acceptor.vetoes), acceptor.refuted) == ({"paths", "similarity"}, -2.0)
        assert set(told["metrics"]) <= set(rule.procedure.accept.metric_names)  # the verifier starts from posterior


def test_rules_for_known_poses_stay_and_say_why(made: Make, installed: list[Rule], watched: Labels) -> None:
    known = of_rule(made("a", 60, 5, share=1.0), KNOWN, numbers={"score": 1.0})
    found = calibrate(Labels(watched.examples + known), installed, ASKED)
    text = rules_text(found)
    assert find(parse_rules(text, "here"), KNOWN) == find(installed, KNOWN)
    why = "it goes by a pose that somebody knows, and searches none"
    assert f"nothing is promised of it: {why}." in " ".join(text.replace("#", "").split())
    assert f"labels of the rule {KNOWN!r} set no limits of it: {why}" in found.remarks
    assert {"rule": KNOWN, "why": why} in document(found)["not_calibrated"]
    assert why in page_of(found)
    with pytest.raises(UsageError, match=r"no limit of the rules they are of \('grids with a known pose': it goes by"):
        calibrate(Labels(known), installed, ASKED)


def test_rules_of_one_name_stay_because_labels_do_not_tell_them_apart(watched: Labels, installed: list[Rule]) -> None:
    twice = [*installed, find(installed, GRIDS)]
    with pytest.raises(UsageError, match="several rules have this name"):
        calibrate(watched, twice, ASKED)


def test_rules_for_collecting_are_not_calibrated(watched: Labels, installed: list[Rule]) -> None:
    with pytest.raises(UsageError, match="merges whatever comes first, to collect examples: name the decision table"):
        calibrate(watched, parse_rules(collecting_text(installed), "here"), ASKED)


def test_a_rule_stays_where_it_was(watched: Labels, installed: list[Rule]) -> None:
    grids = find(installed, GRIDS).model_copy(update={"priority": 0})
    tiny = Rule.model_validate(
        {"name": "tiny", "when": {"own.type": "occupancy_grid", "other.known_area_m2": {"max": 40}}, "reject": "small"}
    )
    for rules in ([tiny, grids], [grids, tiny]):
        names = [rule.name.partition(":")[0] for rule in parse_rules(rules_text(calibrate(watched, rules, ASKED)), "x")]
        assert list(dict.fromkeys(names)) == [rule.name for rule in rules]


def test_a_group_is_never_wider_than_the_rule(made: Make, installed: list[Rule], group: Callable[..., Group]) -> None:
    base = find(installed, GRIDS)
    narrow = base.model_copy(update={"when": {**base.when, "own.resolution_m": Range(max=0.07)}})
    labels = Labels([e for n, m in enumerate((0.07, 0.1)) for e in made("a", 200, n, of=group(m))])
    written = [rule for _, rule in rules_of(calibrate(labels, [narrow], ASKED).rules[0])]
    for rule in written:
        assert holds(rule.when["own.resolution_m"], 0.07)
        assert not holds(rule.when["own.resolution_m"], 0.0702)
    assert not any("0.1 m" in rule.name for rule in written)


# the table that was written, given again


@pytest.mark.parametrize("score", ["auto", "fit", "kappa"])
@pytest.mark.parametrize("rates", [(0.02, 0.01, 0.05), (0.02, 0.001, 0.001), (0.001, 0.5, 0.5)])
def test_the_installed_table_given_again_is_written_again(
    made: Make, watched: Labels, installed: list[Rule], group: Callable[..., Group], score: str, rates: Any
) -> None:
    lines = Group("line segments with line segments", "line_segments", "line_segments", "ledger", resolutions=True)
    further = made("a", 200, 3, of=group(0.1), watched=True, wrong_at=1.0) + made("c", 200, 4, of=lines, watched=True)
    single = dataclasses.replace(group(0.07), reversal="single_map")
    labels = Labels([*watched.examples, *further, *made("a", 200, 6, of=single, watched=True)], folders=["x"])
    asked = Asked(rates[0], rates[1], rates[2], score)
    text = rules_text(calibrate(labels, installed, asked))
    rules = parse_rules(text, "here")
    assert len({rule.name for rule in rules}) == len(rules)
    assert rules_text(calibrate(labels, rules, asked)) == text
    if rates[1] == 0.01:
        assert "Never confirms: the rule does not." in text  # under single_map


def test_examples_of_rules_that_were_made_are_those_of_the_rule(watched: Labels, installed: list[Rule]) -> None:
    name = "grids of any resolution: occupancy_grid 0.0702 m ← occupancy_grid 0.07 m, ledger"
    found = calibrate(Labels(of_rule(watched.examples, name), folders=["x"]), installed, ASKED)
    plain = calibrate(Labels(watched.examples, folders=["x"]), installed, ASKED)
    assert rules_text(found) == rules_text(plain)


def limits(found: Calibration) -> list[tuple[float | None, bool]]:
    """Of each rule that was made, where it confirms, and whether it does."""
    told = [rule.procedure.verify.parameters for _, rule in rules_of(found.rules[0])]
    return [(one.get("confirm_at"), one.get("confirm", True)) for one in told]


def test_confirmation_is_never_looser_than_the_rule_had_it(watched: Labels, installed: list[Rule]) -> None:
    free = limits(calibrate(watched, installed, ASKED))
    assert all(at is not None and -9.0 < at <= -5.0 and confirms for at, confirms in free)
    strict = calibrate(watched, changed(installed, GRIDS, confirm_at=-9.0), ASKED)
    assert {at for at, _ in limits(strict)} == {-9.0}
    once = parse_rules(rules_text(calibrate(watched, installed, ASKED)), "here")
    fine = next(rule for rule in once if rule.name.startswith(f"{GRIDS}: occupancy_grid 0.07 m"))
    again = calibrate(watched, changed(once, fine.name, confirm_at=-9.0), ASKED)
    assert limits(again) == [(-9.0, True), *free[1:]]


def test_what_the_rule_never_confirms_gets_no_limit_of_confirmation(watched: Labels, installed: list[Rule]) -> None:
    found = calibrate(watched, changed(installed, GRIDS, confirm=False), ASKED)
    assert set(limits(found)) == {(None, False)}
    text = rules_text(found)
    assert "Never confirms: the rule does not." in text
    assert "Confirms from" not in text
    assert found.rules[0].fits[0].confirm is None


def test_with_too_few_labels_nothing_is_confirmed_under_any_reversal(watched: Labels, installed: list[Rule]) -> None:
    rules = changed(installed, GRIDS, reversals={"ledger": {"confirm": True}, "single_map": {"confirm": False}})
    found = calibrate(watched, rules, Asked(0.02, 1e-4, 0.05))
    assert "Never confirms: 0.01 % cannot be promised" in rules_text(found)
    for _, rule in rules_of(found.rules[0]):
        assert not any(Sequential(**rule.procedure.verify.parameters).confirms.values())


@pytest.mark.parametrize("limit", [{"confirm_at": 3.0, "revert_at": 5.0}, {"false_confirm": 0.6, "revert_at": 1.0}])
@pytest.mark.parametrize("confirms", [True, False])
def test_the_verifier_can_be_made_whatever_the_rule_said(
    watched: Labels, installed: list[Rule], limit: dict[str, float], confirms: bool
) -> None:
    found = calibrate(watched, changed(installed, GRIDS, **limit, confirm=confirms), ASKED)
    for _, rule in rules_of(found.rules[0]):
        test = Sequential(**rule.procedure.verify.parameters)
        assert test.lower < test.upper


def test_parameters_that_no_verifier_takes_are_told(watched: Labels, installed: list[Rule]) -> None:
    with pytest.raises(Exception, match=r"rule 'grids of any resolution': its verifier cannot have the parameters"):
        calibrate(watched, changed(installed, GRIDS, confirm_at="low"), ASKED)


finite = st.floats(-1e300, 1e300)


@settings(deadline=None)
@given(finite, finite | st.floats(0.0, 1.0))
def test_what_is_ambiguous_is_never_above_what_is_accepted(once: Calibration, above: float, apart: float) -> None:
    one = once.rules[0]
    fit = dataclasses.replace(one.fits[0], accept=dataclasses.replace(one.fits[0].accept, value=above))
    curve = Curve("logistic", 1.0, -(above - abs(apart)))
    fitted = dataclasses.replace(one, fits=[fit], quality=dataclasses.replace(one.quality, curve=curve))
    text = rules_text(dataclasses.replace(once, table=[fitted]))
    Calibrated(**parse_rules(text, "here")[0].procedure.accept.parameters)


@pytest.fixture(scope="module")
def once(watched: Labels, installed: list[Rule]) -> Calibration:
    return calibrate(watched, installed, ASKED)
