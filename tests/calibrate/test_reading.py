"""Reading examples for a calibration: what counts as a label, whose word it is, and what is left out and said."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mapgraft.calibrate import Labelled, read_labels
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
