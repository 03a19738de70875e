"""Reading examples for a calibration: what counts as a label, whose word it is, and what is left out and said."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mapgraft.calibrate import Asked, Labelled, calibrate, read_labels
from mapgraft.decision import Rule
from mapgraft.errors import UsageError

Make = Callable[..., list[Labelled]]
WriteFolder = Callable[..., Path]


def test_what_was_written_is_read(made: Make, write_folder: WriteFolder) -> None:
    examples = made("a", 40, 1, watched=True)
    labels = read_labels([write_folder("one", examples)])
    assert [e.numbers for e in labels.examples] == [e.numbers for e in examples]
    assert [e.right for e in labels.examples] == [e.right for e in examples]
    assert [e.looks for e in labels.examples] == [e.looks for e in examples]
    assert {e.group for e in labels.examples} == {examples[0].group}
    assert len({e.unit for e in labels.examples}) == 40
    assert labels.buildings == ["a"]
    assert labels.counts["by truth"] == 40


def test_truth_goes_before_persons_and_persons_must_agree(made: Make, write_folder: WriteFolder) -> None:
    examples = made("a", 6, 1)
    words = [
        {"ann": "right"},
        {"ann": "wrong", "bob": "wrong", "eve": "unsure"},
        {"ann": "right", "bob": "wrong"},
        {"ann": "unsure"},
        {},
        {"bob": "right", "eve": "right"},
    ]
    labels = read_labels([write_folder("d", examples, words=words, split="train", truth=False)])
    assert [e.right for e in labels.examples] == [True, False, None, None, None, True]
    assert [e.contested for e in labels.examples] == [False, False, True, False, False, False]
    assert labels.counts["persons disagree"] == 1
    assert labels.counts["unlabelled"] == 2
    assert labels.annotators == {"ann": 4, "bob": 3, "eve": 2}
    assert len(labels.labelled) == 4
    told = read_labels([write_folder("e", examples, words=words, split="train")])
    assert [e.right for e in told.examples] == [e.right for e in examples]
    contradicted = sum(
        "wrong" in w.values() if e.right else "right" in w.values() for e, w in zip(examples, words, strict=True)
    )
    assert told.counts["a person contradicts the truth"] == contradicted


def test_what_is_put_aside_for_tests_is_not_read(made: Make, write_folder: WriteFolder) -> None:
    folder = write_folder("d", made("a", 30, 1), words=[{}] * 30, split="train")
    write_folder("d", made("b", 20, 2), words=[{}] * 20, split="test", rows=lambda row: row | {"run_id": "other"})
    labels = read_labels([folder])
    assert (labels.buildings, labels.counts["held back for testing"]) == (["a"], 20)
    assert read_labels([folder], held_back=True).buildings == ["a", "b"]


def test_buildings_are_left_out_by_name_pairs_across_them_too(made: Make, write_folder: WriteFolder) -> None:
    across = [dataclasses.replace(e, environment="a+b") for e in made("a+b", 7, 3)]
    folder = write_folder("d", made("a", 10, 1) + made("b", 12, 2) + across)
    labels = read_labels([folder], without=["b"])
    assert (labels.buildings, len(labels.examples), labels.counts["left out by name"]) == (["a"], 10, 19)


def test_the_same_folder_twice_counts_once(made: Make, write_folder: WriteFolder) -> None:
    folder = write_folder("d", made("a", 10, 1))
    labels = read_labels([folder, folder])
    assert (len(labels.examples), labels.counts["repeated"]) == (10, 10)


def test_robots_who_met_again_are_one_unit(made: Make, write_folder: WriteFolder) -> None:
    def met(row: dict[str, Any]) -> dict[str, Any]:
        names = ("x", "y") if row["position"] % 2 else ("y", "x")
        return row | {"merge_id": f"{names[0]}.{names[1]}.{row['position']}", "receiver": names[0], "donor": names[1]}

    labels = read_labels([write_folder("d", made("a", 10, 1), rows=met)])
    assert len({e.unit for e in labels.examples}) == 1


def test_another_than_the_first_hypothesis_tells_only_when_it_is_right(made: Make, write_folder: WriteFolder) -> None:
    first = [{"hypothesis": 0, "name": "score", "value": 5.0}]
    examples = made("a", 20, 1)
    labels = read_labels([write_folder("d", examples, rows=lambda row: row | {"chosen": 1, "rivals": first})])
    assert [e.right for e in labels.examples] == [False if e.right else None for e in examples]
    assert {tuple(e.numbers.items()) for e in labels.examples} == {(("score", 5.0),)}


def test_attempts_without_hypothesis_are_counted(made: Make, write_folder: WriteFolder) -> None:
    folder = write_folder("d", made("a", 5, 1), rows=lambda row: row | {"chosen": None})
    with pytest.raises(UsageError, match=r"no attempt with a hypothesis .* \(5 without hypothesis\): run or evaluate"):
        read_labels([folder])


def test_a_folder_without_examples_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="has no examples"):
        read_labels([tmp_path])


def test_rules_that_a_calibration_made_are_the_one_they_were_made_of(made: Make, write_folder: WriteFolder) -> None:
    examples = made("a", 3, 1)
    steps = examples[0].group.coarser

    def renamed(row: dict[str, Any]) -> dict[str, Any]:
        return row | {"rule": steps[row["position"]].rule_name(row["rule"])}

    labels = read_labels([write_folder("d", examples, rows=renamed)])
    assert {example.group for example in labels.examples} == {examples[0].group}


def drawn(row: dict[str, Any]) -> dict[str, Any]:
    """As an evaluation tells of a pair of windows."""
    return row | {"pair_sha256": f"{row['position']:064x}", "recording_sha256": ["f" * 64]}


def test_the_same_pairs_read_from_several_evaluations_are_no_further_labels(
    made: Make, installed: list[Rule], write_folder: WriteFolder
) -> None:
    examples = made("a", 50, 1, share=0.0)
    folders = [write_folder(f"resolution-{n}", examples, rows=drawn) for n in range(4)]
    for count in (1, 4):
        labels = read_labels(folders[:count])
        assert len(labels.examples) == 50 * count
        assert len({e.unit for e in labels.examples}) == 50
        assert labels.counts["of the same two maps as another"] == 50 * (count - 1)
        found = calibrate(labels, installed, Asked(0.01))
        assert {fit.accept.missing for fit in found.rules[0].fits} == {49}
        assert any("each two maps count once" in remark for remark in found.remarks) == (count > 1)


def test_two_robots_that_were_run_a_hundred_times_are_one_label(made: Make, write_folder: WriteFolder) -> None:
    def met(row: dict[str, Any]) -> dict[str, Any]:
        names = ("x", "y") if row["position"] % 2 else ("y", "x")
        return row | {"merge_id": "x.y.1", "receiver": names[0], "donor": names[1], "recording_sha256": ["f" * 64]}

    examples = made("a", 3, 1)
    runs = [write_folder(f"run-{n}", examples, rows=met) for n in range(10)]
    assert len({e.unit for e in read_labels(runs).examples}) == 1
    other = write_folder("other", examples, rows=lambda row: met(row) | {"recording_sha256": ["0" * 64]})
    assert len({e.unit for e in read_labels([*runs, other]).examples}) == 2


def test_pairs_of_versions_that_told_no_digest_are_known_by_what_was_drawn(
    made: Make, write_folder: WriteFolder
) -> None:
    def old(row: dict[str, Any]) -> dict[str, Any]:
        return row | {"recording_sha256": ["f" * 64], "stamp": 1000 + row["position"], "receiver_version": 30}

    examples = made("a", 20, 1)
    coarse, fine = (write_folder(name, examples, rows=old) for name in ("coarse", "fine"))
    seed = write_folder("seed", examples, rows=lambda row: old(row) | {"stamp": 5000 + row["position"]})
    assert len({e.unit for e in read_labels([coarse, fine]).examples}) == 20
    assert len({e.unit for e in read_labels([coarse, seed]).examples}) == 40


def same_run(row: dict[str, Any]) -> dict[str, Any]:
    return row | {"run_id": "run-out"}


def test_test_examples_stay_aside_in_whichever_order_folders_are_named(made: Make, write_folder: WriteFolder) -> None:
    train, test = made("a", 30, 1), made("b", 20, 2)
    out = write_folder("out", train + test)
    dataset = write_folder("ds", train, words=[{}] * 30, split="train", rows=same_run)
    write_folder("ds", test, words=[{}] * 20, split="test", rows=lambda row: same_run(moved(row)))
    for order in ((out, dataset), (dataset, out)):
        labels = read_labels(order)
        assert labels.buildings == ["a"]
        assert labels.counts["held back for testing"] == 20
        assert labels.counts["repeated"] == 50
        assert len(read_labels(order, held_back=True).examples) == 50


def moved(row: dict[str, Any]) -> dict[str, Any]:
    """The row in the place that it has behind thirty others."""
    position = row["position"] + 30
    return row | {"position": position, "example_id": f"{position}.judged"}


def test_other_examples_of_the_same_two_maps_stay_aside_with_them(made: Make, write_folder: WriteFolder) -> None:
    test = made("b", 20, 2)
    dataset = write_folder("ds", test, words=[{}] * 20, split="test", rows=lambda row: drawn(row) | {"run_id": "x"})
    again = write_folder("again", test + made("b", 10, 3), rows=drawn)
    for order in ((again, dataset), (dataset, again)):
        labels = read_labels(order)
        assert (len(labels.examples), labels.counts["held back for testing"]) == (10, 40)


def test_words_count_in_whichever_folder_they_were_said(made: Make, write_folder: WriteFolder) -> None:
    examples = made("a", 10, 1)
    out = write_folder("out", examples, truth=False)
    words = [{"ann": "right"}] * 5 + [{}] * 5
    dataset = write_folder("ds", examples, words=words, split="train", truth=False, rows=same_run)
    for order in ((out, dataset), (dataset, out)):
        labels = read_labels(order)
        assert [e.right for e in labels.examples] == [True] * 5 + [None] * 5
        assert labels.annotators == {"ann": 5}


def test_what_was_seen_of_another_hypothesis_is_nothing_of_the_first(made: Make, write_folder: WriteFolder) -> None:
    first = [{"hypothesis": 0, "name": "score", "value": 5.0}]
    examples = made("a", 20, 1, watched=True)
    folder = write_folder("d", examples, rows=lambda row: row | {"chosen": 1, "rivals": first, "state": "reverted"})
    for example in read_labels([folder]).examples:
        assert (example.looks, example.right_later, example.reverted) == ((), None, False)


def test_one_moment_may_be_looked_at_twice(made: Make, write_folder: WriteFolder) -> None:
    entry = {"stamp": 5, "observations": 10, "metric": "posterior", "value": 0.05, "support": 1}
    told = [entry, entry | {"metric": "paths", "value": 1.0}, entry | {"value": 0.9}]
    labels = read_labels([write_folder("d", made("a", 1, 1), rows=lambda row: row | {"history": told})])
    assert [look.numbers for look in labels.examples[0].looks] == [
        {"posterior": 0.05, "paths": 1.0},
        {"posterior": 0.9},
    ]
