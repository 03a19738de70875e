"""The decision table that comes of a calibration: what a run makes of it is what the labels said."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from mapgraft.calibrate import Asked, Calibration, Labelled, Labels, calibrate
from mapgraft.calibrate.collecting import collecting_text
from mapgraft.calibrate.groups import Group
from mapgraft.calibrate.rules import plain
from mapgraft.calibrate.table import rules_text
from mapgraft.config import load_config
from mapgraft.contracts import Candidate, Match, Measurement, Transform
from mapgraft.decision import Rule, Value, build_table, parse_rules
from mapgraft.plugins import load_plugins
from mapgraft_standard.calibrated import Calibrated
from mapgraft_standard.sequential import Sequential

Make = Callable[..., list[Labelled]]


def facts(own_m: float, other_m: float, reversal: str = "ledger") -> dict[str, Value]:
    sides = {"own": own_m, "other": other_m}
    told: dict[str, Value] = {f"{side}.type": "occupancy_grid" for side in sides}
    told |= {f"{side}.resolution_m": metres for side, metres in sides.items()}
    told |= {f"{side}.known_area_m2": 50.0 for side in sides}
    return told | {"resolution_ratio": own_m / other_m, "scale_known": True, "prior": False, "reversal": reversal}


@pytest.fixture(scope="module")
def calibration(made: Make, installed: list[Rule], group: Callable[..., Group]) -> Calibration:
    parts = [made(name, 400, n, watched=True) for n, name in enumerate("ab")]
    parts += [made("a", 400, 7, of=group(0.1, 0.05), wrong_at=1.0), made("a", 10, 8, of=group(0.2, 0.2))]
    return calibrate(Labels([e for part in parts for e in part]), installed, Asked(0.02, 0.01, 0.05))


def chosen(text: str, tmp_path: Path, about: dict[str, Value]) -> Rule:
    path = tmp_path / "rules.yaml"
    path.write_text(text, encoding="utf-8")
    for own in (path, load_config(path).rules):  # decide --rules, and run -c
        rule = build_table(load_plugins(), own).choose(about).rule
        assert rule is not None
    return rule


def test_every_pair_meets_the_thresholds_of_its_group(calibration: Calibration, tmp_path: Path) -> None:
    text = rules_text(calibration)
    fits = {(f.group.own_m, f.group.other_m): f for f in calibration.rules[0].fits if f.group.receiver_type}
    for asked, group in (((0.07, 0.07), (0.07, 0.07)), ((0.1, 0.05), (0.1, 0.05)), ((0.2, 0.2), (None, None))):
        rule = chosen(text, tmp_path, facts(*asked))
        assert rule.accept is not None
        assert rule.verify is not None
        assert rule.accept.parameters["accept_above"] == fits[group].accept.value
        assert rule.candidates == 1
        revert, confirm = fits[group].revert, fits[group].confirm
        assert revert is not None
        assert confirm is not None
        assert rule.verify.parameters.get("revert_at") == revert.value
        assert rule.verify.parameters.get("confirm_at") == confirm.value
        Sequential(**rule.verify.parameters)
    other = chosen(text, tmp_path, facts(0.07, 0.07, "single_map"))
    assert other.name == "grids of any resolution"


@pytest.mark.parametrize("score", ["auto", "fit"])
def test_the_acceptor_decides_as_the_calibration_counted(made: Make, installed: list[Rule], score: str) -> None:
    known = [e for n, name in enumerate("abcd") for e in made(name, 300, n)]
    found = calibrate(Labels(known), installed, Asked(0.05, score=score))
    rules = parse_rules(rules_text(found), "here")
    rule = next(rule for rule in rules if rule.accept is not None and rule.accept.use == "calibrated")
    assert rule.accept is not None
    acceptor = Calibrated(**rule.accept.parameters)
    fit = found.rules[0].finest[0]
    for example in made("e", 200, 9):
        candidate = as_candidate(example)
        assert acceptor.score(candidate) == pytest.approx(found.rules[0].score.of(example.numbers), abs=1e-9)
        taken = acceptor.accept([candidate]).verdict == "provisional"
        assert taken == fit.accept.passes(found.rules[0].score.of(example.numbers))


def as_candidate(example: Labelled) -> Candidate:
    """A candidate that tells the numbers of an example."""
    measured: dict[str, Measurement] = {}
    for name in ("posterior", "kappa", "noise", "paths"):
        details = {n.partition(".")[2]: v for n, v in example.numbers.items() if n.startswith(f"{name}.")}
        measured[name] = Measurement(name, example.numbers[name], "1", 9, "higher", details)
    return Candidate(Match(Transform.identity(), example.numbers["score"], 0.0), measured)


def test_too_few_labels_make_rules_that_accept_nothing(made: Make, installed: list[Rule]) -> None:
    text = rules_text(calibrate(Labels(made("a", 30, 1)), installed, Asked()))
    rules = [rule for rule in parse_rules(text, "here") if rule.accept and rule.accept.use == "calibrated"]
    assert rules
    for rule in rules:
        assert rule.accept is not None
        assert "accept_above" not in rule.accept.parameters
    assert "more are needed" in text


def test_rules_without_labels_stay_as_they_were(calibration: Calibration, installed: list[Rule]) -> None:
    written = {rule.name: rule for rule in parse_rules(rules_text(calibration), "here")}
    for rule in installed:
        if rule.name != "grids of any resolution":
            assert written[rule.name] == rule
            assert Rule.model_validate(plain(rule)) == rule


def test_the_same_labels_give_the_same_bytes(calibration: Calibration, made: Make, installed: list[Rule]) -> None:
    again = calibrate(calibration.labels, installed, calibration.asked)
    assert rules_text(again) == rules_text(calibration)


def test_names_cannot_end_a_comment(made: Make, installed: list[Rule]) -> None:
    labels = Labels(made("a", 200, 1), folders=["x\n- name: injected\u202e\r\nrules: []"])
    text = rules_text(calibrate(labels, installed, Asked(0.05)))
    assert "injected" not in {rule.name for rule in parse_rules(text, "here")}
    assert "\u202e" not in text


def test_rules_for_collecting_merge_whatever_comes_first(installed: list[Rule]) -> None:
    rules = {rule.name: rule for rule in parse_rules(collecting_text(installed), "here")}
    assert list(rules) == [rule.name for rule in installed]
    rule = rules["grids of any resolution"]
    assert rule.accept is not None
    assert rule.verify is not None
    acceptor = Calibrated(**rule.accept.parameters)
    worst = Measurement("posterior", 0.0, "1", 9, "higher"), Measurement("paths", 99.0, "cells", 9, "lower")
    candidate = Candidate(Match(Transform.identity(), -1e9, 0.0), {m.name: m for m in worst})
    assert acceptor.accept([candidate]).verdict == "provisional"
    assert math.isfinite(Sequential(**rule.verify.parameters).upper)
    assert (
        rules["grids with a known pose"].accept
        == next(r for r in installed if r.name == "grids with a known pose").accept
    )
