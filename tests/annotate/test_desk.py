"""What becomes of answers, and who is shown what."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from toy_examples import ENVIRONMENTS, RUN, write_toys

from mapgraft.annotate.desk import Answer, Desk
from mapgraft.annotate.opened import open_folders
from mapgraft.annotate.queue import AGREED, DISPUTED, SECOND, TRUE, UNDECIDED, UNSEEN, Queue, standing_order
from mapgraft.annotate.shown import Place
from mapgraft.annotate.words import Words
from mapgraft.errors import UsageError
from mapgraft.examples import ExampleFolder
from mapgraft.examples.publishing import publish
from mapgraft.outputs.label_parts import MANY

RIGHT, WRONG, UNSURE = Answer("right"), Answer("wrong"), Answer("unsure")


def rows(out: Path) -> list[dict[str, Any]]:
    """All that was written down, the earliest first."""
    parts = sorted((out / "labels").glob("run_id=*/part-*.parquet"))
    found = [row for path in parts for row in pq.ParquetFile(path).read().to_pylist()]
    return sorted(found, key=lambda row: row["labelled_at"])


def answers(desk: Desk, annotator: str, count: int, answer: Answer = RIGHT) -> list[int]:
    """Judge the next ``count`` examples."""
    numbers = []
    for _ in range(count):
        n = desk.next(annotator)
        assert n is not None
        desk.say(n, annotator, answer)
        numbers.append(n)
    return numbers


@pytest.fixture
def desk(out: Path) -> Desk:
    return Desk(open_folders([out]))


def test_an_answer_is_a_row_beside_its_example(desk: Desk, out: Path):
    n = desk.next("anna")
    desk.say(n, "anna", Answer("wrong", "slipped along the corridor", Place(1.5, -2.0, 0.25), 7.5))
    (row,) = rows(out)
    key = ExampleFolder(out).keys[n]
    example = ExampleFolder(out).row(key)
    assert (row["merge_id"], row["receiver"], row["donor"]) == (key.example_id, example["receiver"], example["donor"])
    assert (row["label"], row["annotator"], row["elapsed_s"]) == ("wrong", "anna", 7.5)
    assert row["comment"] == "slipped along the corridor"
    assert row["T_receiver_donor_judged"] == example["T_receiver_donor"]
    held = np.reshape(row["T_receiver_donor"], (4, 4))
    assert held[:2, 3] == pytest.approx([1.5, -2.0])
    assert math.atan2(held[1, 0], held[0, 0]) == pytest.approx(0.25)
    assert (out / f"labels/run_id={key.run_id}").is_dir()


def test_what_was_said_is_read_as_everybody_reads_it(desk: Desk, out: Path):
    first, second = answers(desk, "anna", 2)
    desk.undo("anna")
    desk.say(second, "bob", UNSURE)
    folder = ExampleFolder(out)
    assert {(key, by): word.label for (key, by), word in folder.labels().items()} == {
        (folder.keys[first], "anna"): "right",
        (folder.keys[second], "bob"): "unsure",
    }


def test_the_same_is_shown_until_it_is_answered(desk: Desk):
    n = desk.next("anna")
    assert desk.next("anna") == n
    following = desk.after("anna", n)
    desk.say(n, "anna", RIGHT)
    assert desk.next("anna") == following


def test_everything_is_shown_once(desk: Desk):
    assert sorted(answers(desk, "anna", 60)) == list(range(60))
    assert desk.next("anna") is None
    progress = desk.progress("anna")
    assert (progress.answered, progress.of, progress.labelled, progress.mine["right"]) == (60, 60, 60, 60)


def test_undo_withdraws_and_shows_it_again(desk: Desk, out: Path):
    first, second = answers(desk, "anna", 2)
    assert desk.undo("anna") == second == desk.next("anna")
    assert desk.word(second, "anna") is None and desk.word(first, "anna") is not None
    assert [row["label"] for row in rows(out)] == ["right", "right", "withdrawn"]
    assert desk.undo("anna") == first
    assert desk.undo("anna") is None
    assert desk.progress("anna").answered == 0
    assert len(rows(out)) == 4


def test_nobody_undoes_what_another_said(desk: Desk):
    answers(desk, "anna", 1)
    assert desk.undo("bob") is None
    assert desk.progress("anna").answered == 1


def test_the_last_word_holds(desk: Desk, out: Path):
    n = desk.next("anna")
    for answer in (RIGHT, WRONG, UNSURE):
        desk.say(n, "anna", answer)
    assert desk.word(n, "anna").said == "unsure"
    assert desk.progress("anna").mine == {"right": 0, "wrong": 0, "unsure": 1}
    assert len(rows(out)) == 3


def test_another_desk_goes_on(desk: Desk, out: Path):
    done = answers(desk, "anna", 10)
    desk.undo("anna")
    again = Desk(open_folders([out]))
    assert again.next("anna") == desk.next("anna") == done[-1]
    assert again.progress("anna") == desk.progress("anna")
    assert again.annotators() == ("anna",)


def test_two_servers_of_one_folder_hear_of_each_other(desk: Desk, out: Path):
    other = Desk(open_folders([out]))
    for _ in range(5):
        answers(desk, "anna", 1)
        answers(other, "bob", 1)
    assert desk.next("carl") is not None
    assert desk.progress("anna").said == other.progress("bob").said == {"anna": 5, "bob": 5}


def test_a_clock_that_was_set_back_does_not_bring_old_words_back(desk: Desk, out: Path, monkeypatch):
    import mapgraft.annotate.desk as module

    n = desk.next("anna")
    desk.say(n, "anna", RIGHT)

    class Earlier(module.datetime):
        @classmethod
        def now(cls, tz=None):
            return super().now(tz) - module.timedelta(days=400)

    monkeypatch.setattr(module, "datetime", Earlier)
    desk.say(n, "anna", WRONG)
    assert desk.word(n, "anna").said == "wrong"
    assert desk.undo("anna") == n
    assert desk.word(n, "anna") is None


def test_two_annotators_are_not_shown_the_same_unless_that_is_meant(desk: Desk):
    """Two who begin at once share what is meant for two, a fifth; the rest each judges alone."""
    seen: dict[str, list[int]] = {"anna": [], "bob": []}
    for _ in range(20):
        for name in seen:
            seen[name] += answers(desk, name, 1)
    both = set(seen["anna"]) & set(seen["bob"])
    shared = Queue(open_folders([desk._opened.paths[0]]))._shared
    assert len(both) > 2 and all(shared[n] for n in both)


def test_agreement_is_told(desk: Desk):
    both = answers(desk, "anna", 60)
    for n in both:
        desk.say(n, "bob", RIGHT if n % 3 else WRONG)
    (pair,) = desk.progress("bob").agreements
    assert (pair.one, pair.other, pair.both, pair.same) == ("bob", "anna", 60, 40)
    assert pair.kappa == pytest.approx(0.0)


def test_classes(desk: Desk, out: Path):
    opened = open_folders([out])
    queue = Queue(opened)
    alone = [n for n in range(60) if not queue._shared[n]]
    disputed, unsure, single, agreed = alone[:4]
    for name, answer in (("anna", RIGHT), ("bob", WRONG)):
        desk.say(disputed, name, answer)
        desk.say(agreed, name, RIGHT)
    desk.say(unsure, "anna", UNSURE)
    desk.say(single, "anna", RIGHT)
    words = Words(opened)
    words.refresh()
    classes = queue.classes(words)
    assert [classes[n] for n in (disputed, unsure, single, agreed)] == [DISPUTED, UNDECIDED, SECOND, AGREED]
    assert classes[alone[4]] == UNSEEN
    assert queue.classes(words, [alone[4]])[alone[4]] == SECOND
    assert queue.next(words, "carl") == disputed


def test_the_least_certain_come_first_and_environments_take_turns(sixty: Path):
    opened = open_folders([sixty])
    order = np.argsort(standing_order(opened))
    turns = [{opened.environments[n] for n in order[at : at + 5]} for at in range(0, 30, 5)]
    assert turns == [set(ENVIRONMENTS)] * len(turns)
    for environment in ENVIRONMENTS:
        certain = [opened.uncertainty[n] for n in order if opened.environments[n] == environment]
        assert certain == sorted(certain, reverse=True)
    assert opened.uncertainty.min() >= 0.0 and opened.uncertainty.max() <= 1.0


def test_the_order_is_the_same_every_time(sixty: Path, out: Path):
    assert standing_order(open_folders([sixty])).tolist() == standing_order(open_folders([out])).tolist()


def test_what_is_known_comes_last(tmp_path: Path):
    write_toys(tmp_path / "known", 10, truth=True)
    write_toys(tmp_path / "unknown", 10, truth=False, run_id="r1")
    opened = open_folders([tmp_path / "known", tmp_path / "unknown"])
    desk = Desk(opened)
    assert all(n >= 10 for n in answers(desk, "anna", 10))
    assert set(Queue(opened).classes(Words(opened))[:10]) == {TRUE}


def test_skipped_comes_again_at_the_end(desk: Desk, out: Path):
    first = desk.next("anna")
    desk.skip("anna", first)
    second = desk.next("anna")
    desk.skip("anna", second)
    assert first not in answers(desk, "anna", 58)
    assert answers(desk, "anna", 2) == [first, second]
    assert len(rows(out)) == 60


def test_several_folders_and_the_same_one_twice(out: Path, tmp_path: Path):
    write_toys(tmp_path / "more", 10, truth=False, run_id="r1")
    opened = open_folders([out, tmp_path / "more", out / "." / ""])
    assert len(opened) == 70
    desk = Desk(opened)
    desk.say(65, "anna", RIGHT)
    assert not (out / "labels").exists()
    assert len(rows(tmp_path / "more")) == 1


def test_an_example_that_is_in_two_folders_is_judged_once(out: Path, sixty: Path):
    opened = open_folders([out, sixty])
    assert len(opened) == 60
    assert opened.left_out == {"in an earlier folder, too": 60}


def test_words_about_another_transform_are_not_taken(desk: Desk, out: Path):
    """When a run is made anew its ids may belong to other merges; what was judged is written with the word."""
    from mapgraft.contracts import Transform
    from mapgraft.outputs.labels import label

    key = ExampleFolder(out).keys[0]
    told = {"merge_id": key.example_id, "receiver": "alpha", "donor": "beta", "verdict": "wrong"}
    label(out, key.run_id, **told, by="anna", T_receiver_donor=Transform.planar(900.0, 0.0, 0.0))
    label(out, key.run_id, **told, by="bob")
    again = Desk(open_folders([out]))
    again.next("anna")
    assert again.word(0, "anna") is None
    assert again.word(0, "bob").said == "wrong"


def test_labels_of_an_earlier_version_count(desk: Desk, out: Path):
    """A part that has not all columns, and one in which transforms are null, not NaN."""
    done = answers(desk, "anna", 3)
    parts = sorted((out / "labels").glob("*/part-*.parquet"))
    table = pq.ParquetFile(parts[0]).read()
    pq.write_table(table.drop_columns(["T_receiver_donor", "comment"]), parts[0])
    table = pq.ParquetFile(parts[1]).read()
    at = table.schema.get_field_index("T_receiver_donor_judged")
    nulls = pa.nulls(len(table), table.schema.field(at).type)
    pq.write_table(table.set_column(at, table.schema.field(at), nulls), parts[1])
    again = Desk(open_folders([out]))
    again.next("anna")
    assert {n for n in range(60) if again.word(n, "anna") is not None} == set(done)


def test_words_that_came_with_a_dataset_count(desk: Desk, out: Path, tmp_path: Path):
    """A published dataset holds them in a column; what is said there goes to its own labels."""
    answers(desk, "anna", 3)
    publish([out], tmp_path / "dataset")
    published = Desk(open_folders([tmp_path / "dataset"]))
    assert published.progress("anna").mine == {"right": 3, "wrong": 0, "unsure": 0}
    answers(published, "anna", 1, WRONG)
    assert published.undo("anna") is not None and published.undo("anna") is not None
    assert published.progress("anna").answered == 2
    assert len(rows(tmp_path / "dataset")) == 3 and len(rows(out)) == 3


def hidden(out: Path, key: Any) -> list[str]:
    """What must not be told before the answer, as it would be spelt."""
    row = ExampleFolder(out).row(key)
    numbers = [row["score"], row["margin"], *(pair["value"] for pair in row["evidence"])]
    return [key.example_id, row["reason"], row["rule"], *(f"{number:.4g}" for number in numbers if number is not None)]


def test_score_and_verdict_are_hidden_until_answered(serve: Callable, out: Path):
    client, folder = serve(out), ExampleFolder(out)
    for n in range(0, 60, 7):
        for path in (f"example/{n}", "", "next", "progress"):
            text = client.get(path).text
            body = re.sub(r'data-places=\'.*?\'|href="[^"]*"|d="[^"]*"', "", text, flags=re.DOTALL)
            for secret in hidden(out, folder.keys[n])[:3]:
                assert not secret or secret not in text
            for verdict in ("provisional", "confirmed", "reverted", "unmatched", "ambiguous"):
                assert verdict not in body
        assert client.get(f"revealed/{n}").status == 403
        assert client.label(n, "unsure").status == 200
        revealed = client.get(f"revealed/{n}")
        assert revealed.status == 200 and folder.row(folder.keys[n])["reason"] in revealed.text.replace("&#39;", "'")
        other = type(client)(client.port, client.token, "bob")
        assert other.get(f"revealed/{n}").status == 403
    client.post("undo")
    assert client.get(f"revealed/{n}").status == 403


def test_places_carry_no_scores_and_no_order(sixty: Path):
    opened = open_folders([sixty])
    for n in range(60):
        shown = opened.shown(n)
        assert list(shown.others) == sorted(shown.others, key=lambda place: (place.x_m, place.y_m, place.yaw_rad))
        assert shown.place not in shown.others


@pytest.mark.parametrize("name", ["no such folder", "file", "empty", "run"])
def test_wrong_folders_have_a_sentence(tmp_path: Path, name: str):
    (tmp_path / "file").write_text("x")
    (tmp_path / "empty").mkdir()
    (tmp_path / "run" / "events").mkdir(parents=True)
    with pytest.raises(UsageError, match=re.escape(str(tmp_path / name))):
        open_folders([tmp_path / name])


def threads(count: int, work: Callable[[int], None]) -> None:
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(count) as pool:
        list(pool.map(work, range(count)))


def test_many_at_once(serve: Callable, out: Path):
    """Six annotators answer at the same time over six connections; every answer is there, each beside its example."""
    client = serve(out)

    def work(number: int) -> None:
        own = type(client)(client.port, client.token, f"name{number}")
        n = own.get().n
        for _ in range(10):
            n = own.label(n, ("right", "wrong", "unsure")[number % 3]).n

    threads(6, work)
    found = ExampleFolder(out).labels()
    counts = {f"name{number}": sum(by == f"name{number}" for _, by in found) for number in range(6)}
    assert counts == {f"name{number}": 10 for number in range(6)}


def test_every_64th_answer_words_are_put_together(serve: Callable, out: Path):
    """In the background: the answer itself does not wait. A later start finds the same words."""
    client = serve(out)
    for _ in range(MANY):
        assert client.label(7, "right").status == 200
    folder = out / "labels" / f"run_id={RUN}"
    for _ in range(600):
        if len(list(folder.glob("part-*.parquet"))) == 1:
            break
        time.sleep(0.05)
    assert len(rows(out)) == MANY
    assert len(list(folder.glob("part-*.parquet"))) == 1
    assert Desk(open_folders([out])).undo("anna") == 7


def test_a_start_puts_words_together(out: Path):
    desk = Desk(open_folders([out]))
    for _ in range(MANY):
        desk.say(7, "anna", RIGHT)
    assert len(list((out / "labels").glob("*/part-*.parquet"))) == MANY
    open_folders([out]).tidy()
    assert len(list((out / "labels").glob("*/part-*.parquet"))) == 1
    assert desk.undo("anna") == 7  # who has read them before goes on
