"""What people say, out to a CSV file and in again."""

from __future__ import annotations

import csv
import io
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_examples import RUN, write_toys

from mapgraft.cli import invoke
from mapgraft.contracts import Transform
from mapgraft.errors import UsageError
from mapgraft.examples import ExampleFolder, ExampleKey, put_at, transform_of
from mapgraft.examples.labels_csv import exported, imported
from mapgraft.examples.publishing import publish
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
    path.write_text("example_id,label,x_m,y_m,yaw_rad\nalpha.beta.7,wrong,1.5,-2,0.5\nalpha.beta.8,Unsure,,,\n")
    assert imported(ExampleFolder(out), path, "eve", clock=NOON) == (2, 0)
    labels = ExampleFolder(out).labels()
    word = labels[ExampleKey(RUN, "alpha.beta.7"), "eve"]
    assert (
        word.T_receiver_donor is not None and word.T_receiver_donor.difference(Transform.planar(1.5, -2, 0.5))[0] < 1e-9
    )
    assert word.T_judged is not None and labels[ExampleKey(RUN, "alpha.beta.8"), "eve"].T_receiver_donor is None


LINES = st.lists(
    st.tuples(
        st.sampled_from(("alpha.beta.7", "alpha.beta.8")),
        st.sampled_from(("right", "wrong", "unsure", "withdrawn")),
        st.sampled_from(("eve", "")),
        st.sampled_from(("", "2026-03-01T12:00:00Z", "2026-03-01T12:00:07Z")),
        st.sampled_from(("", "not here")),
    ),
    max_size=8,
)


@settings(max_examples=25, deadline=None)
@given(LINES)
def test_the_same_file_twice_is_once(lines):
    with TemporaryDirectory() as made:
        out = Path(made)
        write_toys(out, 12)
        path = out / "hand.csv"
        text = "".join(",".join(line) + "\n" for line in lines)
        path.write_text("example_id,label,annotator,labelled_at,comment\n" + text)
        added, before = imported(ExampleFolder(out), path, "ann", clock=NOON)
        assert added + before == len(lines)
        words = exported([ExampleFolder(out)], everything=True)
        assert words[1] == added
        assert imported(ExampleFolder(out), path, "ann", clock=NOON + timedelta(days=1)) == (0, len(lines))
        assert exported([ExampleFolder(out)], everything=True) == words
        untimed = {(one, by or "ann"): verdict for one, verdict, by, said, _ in lines if not said}
        last = {(word.key.example_id, word.annotator): word.label for word in ExampleFolder(out).words()}
        assert untimed.items() <= last.items()  # a line without a time is later than all that have one


@pytest.mark.parametrize("further", ["wrong,", "right,looked again"])
def test_a_line_without_a_time_is_new_where_it_is_not_the_last_word(out, further):
    path = out / "hand.csv"
    for line, expected in (("right,", (1, 0)), (further, (1, 0)), ("right,", (1, 0)), ("right,", (0, 1))):
        path.write_text(f"example_id,label,comment\nalpha.beta.7,{line}\n")
        assert imported(ExampleFolder(out), path, "eve", clock=NOON) == expected
    path.write_text("example_id,label,x_m,y_m,yaw_rad\nalpha.beta.7,right,9,9,0\n")
    assert imported(ExampleFolder(out), path, "eve", clock=NOON) == (1, 0)
    path.write_text("example_id,label\nalpha.beta.1,right\n")
    assert imported(ExampleFolder(out), path, "ann", clock=NOON) == (0, 1)  # said on the page


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("id,label\n1,right\n", "has no column example_id"),
        ("example_id,label\nalpha.beta.1,maybe\n", "line 2: a label is one of right, wrong, unsure, withdrawn"),
        ("example_id,label\nalpha.beta.99,right\n", "line 2: .* has no example 'alpha.beta.99'$"),
        (f"example_id,run_id,label\nalpha.beta.99,{RUN},right\n", f"no example 'alpha.beta.99' of the run {RUN}$"),
        (
            "example_id,run_id,label\nalpha.beta.1,r7,right\n",
            f"line 2: .* holds the run {RUN}, not r7: name the folder",
        ),
        ("example_id;label\nalpha.beta.1;right\n", "found example_id;label; values are separated by commas$"),
        ("example_id,label\nalpha.beta.1,right,7\n", "line 2: more values than the first line names"),
        ("example_id,label,x_m\nalpha.beta.1,right,1\n", "line 2: a pose is x_m, y_m and yaw_rad"),
        ("example_id,label,x_m\nalpha.beta.1,right,inf\n", "line 2: x_m is a finite number, found 'inf'"),
        ("example_id,label,labelled_at\nalpha.beta.1,right,noon\n", "line 2: labelled_at is a time like"),
        ("example_id,label,labelled_at\nalpha.beta.1,right,2026-03-01T12:00:00+99:00\n", "labelled_at is a time like"),
        ("example_id,label,labelled_at\nalpha.beta.1,right,0001-01-01T00:00:00+02:00\n", "labelled_at is a time like"),
        ("example_id,label,labelled_at\nalpha.beta.1,right,2300-01-01T00:00:00Z\n", "labelled_at is a time like"),
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


@pytest.mark.parametrize(("to", "said"), [(".", "that is a folder; name a file"), ("no/l.csv", "does not exist")])
def test_where_no_file_can_be_is_said_before_anything_is_read(out, capsys, to, said):
    assert invoke(["labels", "export", str(out / "nowhere"), "-o", str(out / to)]) == 2
    assert f"--out {out / to}: " in (told := capsys.readouterr().err) and said in told


def test_what_is_no_text_is_refused(out):
    (out / "bad.csv").write_bytes(b"\xff\xfe\x00example_id")
    for path in (out / "bad.csv", out / "nothing.csv", out):
        with pytest.raises(UsageError, match="cannot be read"):
            imported(ExampleFolder(out), path)


@pytest.mark.parametrize(
    ("told", "utc"),
    [
        ("2026-03-01T12:00:00Z", "2026-03-01T12:00:00.000000000Z"),
        ("2026-03-01 12:00:00", "2026-03-01T12:00:00.000000000Z"),
        ("2026-03-01T12:00:00+02:00", "2026-03-01T10:00:00.000000000Z"),
        ("2026-03-01T00:30:00.123456789+0530", "2026-02-28T19:00:00.123456789Z"),
        ("2026-03-01T12:00:00,5-08", "2026-03-01T20:00:00.500000000Z"),
        ("2026-03-01", "2026-03-01T00:00:00.000000000Z"),
    ],
)
def test_a_time_means_what_its_zone_says(out, told, utc):
    path = out / "zoned.csv"
    path.write_text(f'example_id,label,annotator,labelled_at\nalpha.beta.9,right,eve,"{told}"\n')
    assert imported(ExampleFolder(out), path) == (1, 0)
    assert [row["labelled_at"] for row in rows_of(exported([ExampleFolder(out)])[0]) if row["annotator"] == "eve"] == [
        utc
    ]


def test_the_later_of_two_words_is_the_one_said_later_wherever_that_was(out):
    path = out / "zoned.csv"
    path.write_text(
        "example_id,label,annotator,labelled_at\n"
        "alpha.beta.9,wrong,eve,2026-03-01T11:00:00Z\n"
        "alpha.beta.9,right,eve,2026-03-01T12:00:00+02:00\n"
    )
    imported(ExampleFolder(out), path)
    assert ExampleFolder(out).labels()[ExampleKey(RUN, "alpha.beta.9"), "eve"].label == "wrong"


def test_what_two_folders_hold_of_one_example_goes_out_once(out, tmp_path_factory):
    """The dataset holds the words of the run, and a later one of its own."""
    data = tmp_path_factory.mktemp("data")
    publish([out], data)
    both = [ExampleFolder(out), ExampleFolder(data)]
    assert exported(both) == exported(both[:1])
    about = {"merge_id": "alpha.beta.1", "receiver": "alpha", "donor": "beta"}
    label(data, RUN, **about, verdict="unsure", by="bob")
    words = {(row["example_id"], row["annotator"]): row["label"] for row in rows_of(exported(both)[0])}
    assert words["alpha.beta.1", "bob"] == "unsure" and exported(both)[1] == len(words) == 3
    assert exported(both, everything=True)[1] == 6


def test_who_moves_a_map_in_the_plane_keeps_its_height_and_tilt():
    put = put_at(MOVED, -3.0, 4.0, 1.0)
    assert (put.x_m, put.y_m, put.yaw_rad) == pytest.approx((-3.0, 4.0, 1.0))
    assert put.z_m == pytest.approx(0.5) and put.matrix[2, 2] == pytest.approx(MOVED.matrix[2, 2])
    assert put_at(None, 1.0, 2.0, 0.3).difference(Transform.planar(1.0, 2.0, 0.3))[0] == 0.0
