"""Each building judged by the labels of the others: what refutes that a promise carries over, and what cannot."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import pytest

from mapgraft.calibrate import Asked, Labelled, Labels, RuleFit, calibrate
from mapgraft.calibrate.others import Trial
from mapgraft.calibrate.page import page_of
from mapgraft.calibrate.rates import above
from mapgraft.calibrate.table import rules_text
from mapgraft.decision import Rule

Make = Callable[..., list[Labelled]]


def fit_of(installed: list[Rule], parts: Sequence[Sequence[Labelled]], asked: Asked) -> RuleFit:
    return calibrate(Labels([e for part in parts for e in part], folders=["x"]), installed, asked).rules[0]


@pytest.mark.parametrize("seed", range(5))
def test_buildings_with_a_handful_of_labels_cannot_vouch_for_another(
    made: Make, installed: list[Rule], seed: int
) -> None:
    parts = [made("large", 700, seed), *(made(name, 5, seed, wrong_at=1.3, share=0.0) for name in ("b", "c"))]
    accept = fit_of(installed, parts, Asked()).transfer.accept
    assert accept.verdict == "none"
    assert "no two buildings have labels enough to refute each other: that takes 99 wrong" in accept.reason


def test_a_handful_of_labels_can_refute(made: Make, installed: list[Rule]) -> None:
    parts = [made("large", 700, 1), made("other", 700, 2), made("odd", 4, 3, wrong_at=6.0, share=0.0)]
    accept = fit_of(installed, parts, Asked()).transfer.accept
    assert accept.verdict == "none"
    assert "4/4 of the wrong ones in odd would be accepted" in accept.reason


def test_buildings_that_could_not_refute_are_named(made: Make, installed: list[Rule]) -> None:
    parts = [made("a", 700, 1), made("b", 700, 2), made("c", 10, 3)]
    accept = fit_of(installed, parts, Asked(0.02)).transfer.accept
    assert accept.verdict == "not refuted"
    assert "no building that was left out refutes (c has too few labels to tell)" in accept.reason


def test_each_promise_is_tested_on_the_building_that_was_left_out(made: Make, installed: list[Rule]) -> None:
    parts = [made(name, 900, n, watched=True) for n, name in enumerate("abc")]
    calibration = calibrate(Labels([e for part in parts for e in part], folders=["x"]), installed, Asked(*[0.02] * 3))
    transfer = calibration.rules[0].transfer
    assert [kind for kind, _ in transfer.told] == ["accept", "confirm", "revert"]
    assert {said.verdict for _, said in transfer.told} == {"not refuted"}
    for one in transfer.left_out:
        assert one.confirmed is not None
        assert one.reverted is not None
        assert one.wrong.labels == one.confirmed.labels
        assert one.reverted.beyond.of > 200
    text = " ".join(rules_text(calibration).replace("#", " ").split())
    assert all(f"{what}: on an assumption" in text for what in ("merged", "confirmed", "reverted"))
    assert page_of(calibration).count("elsewhere on an assumption") == 3


def test_wrong_merges_that_look_right_in_one_building_refute_its_confirmations(
    made: Make, installed: list[Rule]
) -> None:
    parts = [made(name, 900, n, watched=True) for n, name in enumerate("abc")]
    rights = [e for e in parts[0] if e.right]
    parts[0] = [
        e if e.right else dataclasses.replace(e, looks=rights[n % len(rights)].looks) for n, e in enumerate(parts[0])
    ]
    transfer = fit_of(installed, parts, Asked(0.05, 0.01, 0.02)).transfer
    assert transfer.accept.verdict == "not refuted"
    assert transfer.confirm is not None
    assert transfer.confirm.verdict == "none"
    assert "of the wrong ones in a would be confirmed" in transfer.confirm.reason


def test_buildings_enough_for_merging_guarantee_nothing_else(made: Make, installed: list[Rule]) -> None:
    parts = [made(f"b{n}", 120, n, watched=True) for n in range(12)]
    transfer = fit_of(installed, parts, Asked(0.1, 0.05, 0.05)).transfer
    assert transfer.accept.verdict == "guaranteed"
    assert transfer.confirm is not None
    assert transfer.revert is not None
    assert {transfer.confirm.verdict, transfer.revert.verdict} <= {"not refuted", "none"}


def test_what_is_not_promised_here_is_not_said_of_other_buildings(made: Make, installed: list[Rule]) -> None:
    transfer = fit_of(installed, [made(name, 400, n) for n, name in enumerate("abc")], Asked(0.02)).transfer
    assert transfer.revert is None
    transfer = fit_of(installed, [made("a", 20, 1), made("b", 20, 2)], Asked()).transfer
    assert (transfer.confirm, transfer.revert) == (None, None)


def test_the_same_two_maps_refute_once(made: Make) -> None:
    examples = made("a", 40, 1)
    beyond = [(example, n < 8) for n, example in enumerate(examples)]
    alone = Trial.of(beyond, "a", 0.05)
    assert alone.doubt == above(8, 40, 0.05)
    assert (alone.labels, alone.beyond.count) == (40, 8)
    four = [(dataclasses.replace(e, unit=("maps", str(n // 4))), hit) for n, (e, hit) in enumerate(beyond)]
    assert Trial.of(four, "a", 0.05).doubt == above(2, 10, 0.05)
    mixed = [(dataclasses.replace(e, unit=("maps", str(n % 10))), hit) for n, (e, hit) in enumerate(beyond)]
    assert Trial.of(mixed, "a", 0.05).doubt == above(2, 10, 0.05)  # eight quarters of two maps
    across = [(dataclasses.replace(e, environment="a+b"), hit) for e, hit in beyond]
    assert (Trial.of(across, "a", 0.05).labels, Trial.of(across, "a", 0.05).doubt) == (0, alone.doubt)
