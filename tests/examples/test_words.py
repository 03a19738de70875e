"""Whose word on which example holds: wherever words are read, and whatever an example's id belonged to before."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_examples import RUN, write_toys

from mapgraft.annotate.desk import Desk
from mapgraft.annotate.opened import open_folders
from mapgraft.calibrate import read_labels
from mapgraft.contracts import Transform
from mapgraft.examples import ExampleFolder, ExampleKey, Word, last_words_on, transform_of
from mapgraft.examples.labels_csv import exported
from mapgraft.examples.publishing import publish
from mapgraft.outputs.labels import label

ELSEWHERE = Transform.planar(50.0, 50.0, 1.0)
NOON = datetime(2026, 3, 1, 12, tzinfo=UTC)
FIRST = ExampleKey(RUN, "alpha.beta.1")


def judged_at(folder: Path, key: ExampleKey = FIRST) -> Transform | None:
    return transform_of(ExampleFolder(folder).row(key)["T_receiver_donor"])


def say(folder: Path, verdict: str, by: str, T: Transform | None, n: int = 1, second: int = 0) -> None:
    about = {"merge_id": f"alpha.beta.{n}", "receiver": "alpha", "donor": "beta"}
    clock = NOON + timedelta(seconds=second)
    label(folder, RUN, **about, verdict=verdict, by=by, T_receiver_donor=T, clock=clock)


def published(dataset: Path) -> dict[str, dict]:
    rows = ExampleFolder(dataset).rows(["example_id", "label", "labels", "T_label"]).to_pylist()
    return {row["example_id"]: row for row in rows}


def test_a_word_on_what_had_the_id_before_is_no_word_on_the_example(tmp_path):
    """As after ``mapgraft revert``: the run's id stays, and the merge's id belongs to another attempt."""
    out = tmp_path / "out"
    write_toys(out, 6, truth=False)
    say(out, "right", "ann", ELSEWHERE)
    folder = ExampleFolder(out)
    assert not folder.labels() and len(folder.words()) == 1  # nothing is lost
    assert not read_labels([out]).labelled
    publish([out], tmp_path / "data")
    rows = published(tmp_path / "data").values()
    assert not any(row["label"] or row["labels"] or transform_of(row["T_label"]) for row in rows)
    assert exported([folder])[1] == 0 and exported([folder], everything=True)[1] == 1
    desk = Desk(open_folders([out]))
    desk.next("ann")
    assert desk.word(0, "ann") is None


def test_it_neither_hides_nor_takes_back_what_was_said_of_the_example(tmp_path):
    write_toys(tmp_path, 3, truth=False)
    say(tmp_path, "right", "ann", judged_at(tmp_path))
    say(tmp_path, "wrong", "ann", ELSEWHERE, second=1)
    say(tmp_path, "withdrawn", "ann", ELSEWHERE, second=2)
    assert [word.label for word in ExampleFolder(tmp_path).labels().values()] == ["right"]


@settings(max_examples=12, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["right", "wrong", "unsure", "withdrawn"]),
            st.sampled_from(["ann", "bob"]),
            st.integers(1, 2),
            st.sampled_from(["its own", "another", "unknown"]),
        ),
        max_size=7,
    )
)
def test_everybody_reads_the_same_words(
    tmp_path_factory: pytest.TempPathFactory, said: list[tuple[str, str, int, str]]
):
    """The page, ``labels``, a dataset, thresholds and the CSV file, after any words on any transforms."""
    folder = tmp_path_factory.mktemp("out")
    write_toys(folder, 2, truth=False)
    for second, (verdict, by, n, what) in enumerate(said):
        own = judged_at(folder, ExampleKey(RUN, f"alpha.beta.{n}"))
        say(folder, verdict, by, {"its own": own, "another": ELSEWHERE, "unknown": None}[what], n, second)
    known = {(key.example_id, by): word.label for (key, by), word in ExampleFolder(folder).labels().items()}
    desk = Desk(open_folders([folder]))
    desk.next("ann")
    shown = {(n, by): word for n in (1, 2) for by in ("ann", "bob") if (word := desk.word(n - 1, by)) is not None}
    assert {(f"alpha.beta.{n}", by): word.said for (n, by), word in shown.items()} == known
    publish([folder], folder / "data")
    told = {
        (i, one["annotator"]): one["label"] for i, row in published(folder / "data").items() for one in row["labels"]
    }
    assert told == known
    assert (
        read_labels([folder], held_back=True).annotators.total() == len(known) == exported([ExampleFolder(folder)])[1]
    )


def test_words_go_with_the_transform_that_a_dataset_takes_over(tmp_path):
    """A run made anew takes its place in the dataset: words on what was there before do not go over to it."""
    before, anew, data = tmp_path / "before", tmp_path / "anew", tmp_path / "data"
    write_toys(before, 12, truth=False)
    write_toys(anew, 12, truth=False, seed=3)
    keys = ExampleFolder(before).keys
    same = {key for key in keys if judged_at(before, key).difference(judged_at(anew, key))[0] < 1e-9}
    assert 0 < len(same) < len(keys)
    for key in keys:
        say(before, "right", "ann", judged_at(before, key), int(key.example_id.rpartition(".")[2]))
    publish([before], data)
    assert {row["label"] for row in published(data).values()} == {"right"}
    publish([anew], data)
    assert {i for i, row in published(data).items() if row["label"]} == {key.example_id for key in same}
    words = last_words_on([ExampleFolder(anew), ExampleFolder(before)])
    assert {key for key, _ in words} == same
    assert {key for key, _ in last_words_on([ExampleFolder(before), ExampleFolder(anew)])} == {*keys}


def test_what_was_judged_may_be_unknown_but_not_of_an_attempt_without_a_transform():
    def word(T: Transform | None) -> Word:
        return Word(FIRST, "wrong", "ann", T, None, "", 0, None)

    assert word(None).is_about(None) and word(None).is_about(ELSEWHERE) and word(ELSEWHERE).is_about(ELSEWHERE)
    assert not word(ELSEWHERE).is_about(None)
    assert word(ELSEWHERE).is_about(ELSEWHERE @ Transform.planar(0.3, 0.3, 0.05))  # for a person's eye the same
    assert not word(ELSEWHERE).is_about(ELSEWHERE @ Transform.planar(0.0, 0.0, 0.1))
