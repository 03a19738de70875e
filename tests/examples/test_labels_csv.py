"""What people say, out to a CSV file and in again, and as the truth."""

from __future__ import annotations

import csv
import io
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from toy_examples import RUN, write_toys

from mapgraft.contracts import Transform
from mapgraft.errors import UsageError
from mapgraft.examples import ExampleFolder, ExampleKey, put_at, transform_of
from mapgraft.examples.labels_csv import examples_truth, exported, imported, robots_truth
from mapgraft.outputs.labels import label

NOON = datetime(2026, 3, 1, 12, 0, 0, 250_000, tzinfo=UTC)
MOVED = Transform.from_matrix(
    Transform.planar(7.25, 2.75, 0.1).matrix @ Transform.from_quaternion((0, 0, 0.5), (0.02, 0, 0, 0.9998)).matrix
)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Twelve examples, of which two persons judged some."""
    write_toys(tmp_path, 12)
    folder = ExampleFolder(tmp_path)

    clock = (NOON + timedelta(microseconds=n) for n in count())

    def say(n: int, verdict: str, by: str, **said: object) -> None:
        row = folder.row(folder.keys[n])
        about = {"merge_id": row["example_id"], "receiver": row["receiver"], "donor": row["donor"]}
        T = transform_of(row["T_receiver_donor"])
        label(tmp_path, RUN, **about, verdict=verdict, by=by, T_receiver_donor=T, clock=next(clock), **said)

    say(0, "right", "ann", elapsed_s=1.5)
    say(0, "wrong", "bob", reason='two corridors, "alike"\nfirst and second floor')
    say(1, "wrong", "ann", T_corrected=MOVED)
    say(2, "right", "ann")
    say(2, "withdrawn", "ann")
    return tmp_path


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_the_last_words_go_out_and_come_in_again(out, tmp_path_factory):
    text, words = exported([ExampleFolder(out)])
    assert words == 3 and [row["annotator"] for row in rows_of(text)] == ["ann", "bob", "ann"]
    assert rows_of(text)[0]["labelled_at"] == "2026-03-01T12:00:00.250000000Z"
    there = tmp_path_factory.mktemp("there")
    write_toys(there, 12)
    path = there / "labels.csv"
    path.write_text(text, encoding="utf-8-sig")  # as a spreadsheet saves it
    assert imported(ExampleFolder(there), path) == (3, 0)
    ours, theirs = (ExampleFolder(folder).labels() for folder in (out, there))
    assert ours.keys() == theirs.keys()
    for key, word in ours.items():
        other = theirs[key]
        assert (word.label, word.comment, word.said_ns, word.elapsed_s) == (
            (other.label, other.comment, other.said_ns, other.elapsed_s)
        )
        for one, two in ((word.T_judged, other.T_judged), (word.T_receiver_donor, other.T_receiver_donor)):
            assert (one is None) == (two is None)
            assert one is None or np.allclose(one.matrix, two.matrix, atol=1e-9)
    assert imported(ExampleFolder(there), path) == (0, 3)  # twice is once
    assert exported([ExampleFolder(there)])[0] == text


def test_everything_that_was_said_goes_out_if_it_is_wanted(out):
    assert exported([ExampleFolder(out)], everything=True)[1] == 5


def test_a_line_by_hand_needs_little(out):
    path = out / "hand.csv"
    path.write_text("example_id,label,x_m,y_m,yaw_rad\nalpha.beta.7,wrong,1.5,-2,0.5\nalpha.beta.8,unsure,,,\n")
    assert imported(ExampleFolder(out), path, "eve", clock=NOON) == (2, 0)
    labels = ExampleFolder(out).labels()
    word = labels[ExampleKey(RUN, "alpha.beta.7"), "eve"]
    assert (
        word.T_receiver_donor is not None and word.T_receiver_donor.difference(Transform.planar(1.5, -2, 0.5))[0] < 1e-9
    )
    assert word.T_judged is not None and labels[ExampleKey(RUN, "alpha.beta.8"), "eve"].T_receiver_donor is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("id,label\n1,right\n", "has no column example_id"),
        ("example_id,label\nalpha.beta.1,maybe\n", "line 2: a label is one of right, wrong, unsure, withdrawn"),
        ("example_id,label\nalpha.beta.99,right\n", "line 2: .* no single example 'alpha.beta.99'"),
        ("example_id,label\nalpha.beta.1,right,7\n", "line 2: more values than the first line names"),
        ("example_id,label,x_m\nalpha.beta.1,right,1\n", "line 2: a pose is x_m, y_m and yaw_rad"),
        ("example_id,label,x_m\nalpha.beta.1,right,inf\n", "line 2: x_m is a finite number, found 'inf'"),
        ("example_id,label,labelled_at\nalpha.beta.1,right,noon\n", "line 2: labelled_at is a time like"),
        ("example_id,label,elapsed_s\nalpha.beta.1,right,long\n", "elapsed_s is a finite number"),
        ("", "has no column example_id, label"),
    ],
)
def test_a_line_that_does_not_fit_is_named_and_nothing_is_added(out, text, said):
    before = ExampleFolder(out).words()
    path = out / "bad.csv"
    path.write_text(text)
    with pytest.raises(UsageError, match=said):
        imported(ExampleFolder(out), path)
    assert len(ExampleFolder(out).words()) == len(before)


def test_what_is_no_text_is_refused(out):
    (out / "bad.csv").write_bytes(b"\xff\xfe\x00example_id")
    for path in (out / "bad.csv", out / "nothing.csv", out):
        with pytest.raises(UsageError, match="cannot be read"):
            imported(ExampleFolder(out), path)


def test_a_corrected_transform_is_the_truth_about_its_robots(out, tmp_path):
    path = tmp_path / "truth.csv"
    path.write_text(
        "recording,receiver,donor,label,x_m,y_m,yaw_rad\n"
        "one,ann,bob,wrong,1.0,2.0,0.50\n"
        "one,ann,bob,right,1.1,2.0,0.51\n"
        "one,ann,bob,right,1.2,2.0,0.52\n"
        "one,ann,cid,unsure,9,9,0\n"
        "two,ann,bob,right,5,5,0\n"
        "one,cid,ann,wrong,,,\n"
    )
    truth = robots_truth(path, {"ann": "one", "bob": "one", "cid": "one"})
    assert truth.keys() == {("ann", "bob")}
    T = truth["ann", "bob"].T_receiver_donor
    assert T is not None and (T.x_m, T.yaw_rad) == pytest.approx((1.1, 0.51))  # the one in the middle
    with pytest.raises(UsageError, match=r"line 6: this transform lies .* from that of line 2"):
        robots_truth(path)


def test_a_corrected_transform_is_the_truth_about_its_example(out, tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text(exported([ExampleFolder(out)])[0])
    truth = examples_truth(path, RUN)
    assert truth.keys() == {"alpha.beta.1", "alpha.beta.2"} and not examples_truth(path, "r2")
    moved = truth["alpha.beta.2"].T_receiver_donor
    assert moved is not None and np.allclose(moved.matrix, MOVED.matrix, atol=1e-9)


def test_who_moves_a_map_in_the_plane_keeps_its_height_and_tilt():
    put = put_at(MOVED, -3.0, 4.0, 1.0)
    assert (put.x_m, put.y_m, put.yaw_rad) == pytest.approx((-3.0, 4.0, 1.0))
    assert put.z_m == pytest.approx(0.5) and put.matrix[2, 2] == pytest.approx(MOVED.matrix[2, 2])
    assert put_at(None, 1.0, 2.0, 0.3).difference(Transform.planar(1.0, 2.0, 0.3))[0] == 0.0
