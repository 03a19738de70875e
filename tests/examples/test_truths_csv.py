"""Where maps really lie, by what people say in a CSV file: the last word of each, and of several only if they agree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from toy_examples import RUN, write_toys

from mapgraft.config import ExamplesConfig
from mapgraft.contracts import Transform
from mapgraft.errors import UsageError
from mapgraft.examples import ExampleFolder, transform_of
from mapgraft.examples.labels_csv import exported
from mapgraft.examples.of_run import truths_of
from mapgraft.examples.truths_csv import examples_truth, robots_truth
from mapgraft.outputs.labels import label

MOVED = Transform.planar(7.25, 2.75, 0.1)
HEAD = (
    "run_id,example_id,recording,receiver,donor,annotator,label,labelled_at,x_m,y_m,yaw_rad,"
    "judged_x_m,judged_y_m,judged_yaw_rad\n"
)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    write_toys(tmp_path / "out", 12)
    return tmp_path / "out"


def say(out: Path, n: int, verdict: str, by: str, T_corrected: Transform | None = None) -> None:
    folder = ExampleFolder(out)
    row = folder.row(folder.keys[n])
    about = {"merge_id": row["example_id"], "receiver": row["receiver"], "donor": row["donor"]}
    T = transform_of(row["T_receiver_donor"])
    label(out, RUN, **about, verdict=verdict, by=by, T_receiver_donor=T, T_corrected=T_corrected)


def told(out: Path, everything: bool = False) -> Path:
    path = out / "labels.csv"
    path.write_text(exported([ExampleFolder(out)], everything=everything)[0])
    return path


def written(folder: Path, *lines: str) -> Path:
    path = folder / "written.csv"
    path.write_text(HEAD + "".join(f"{line}\n" for line in lines))
    return path


def test_a_corrected_transform_is_the_truth_about_its_robots(tmp_path):
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


def test_a_label_may_begin_with_a_capital(tmp_path):
    path = tmp_path / "truth.csv"
    path.write_text("receiver,donor,label,x_m,y_m,yaw_rad\nann,bob,Right,1,2,0.5\nann,cid,RIGHT,1,2,0.5\n")
    assert robots_truth(path).keys() == {("ann", "bob"), ("ann", "cid")}


def test_a_corrected_transform_is_the_truth_about_its_example(out):
    say(out, 0, "right", "ann")
    say(out, 1, "wrong", "ann", MOVED)
    say(out, 2, "unsure", "ann")
    path = told(out)
    truth = examples_truth(path, RUN)
    assert truth.keys() == {"alpha.beta.1", "alpha.beta.2"} and not examples_truth(path, "r2")
    moved = truth["alpha.beta.2"].T_receiver_donor
    assert moved is not None and np.allclose(moved.matrix, MOVED.matrix, atol=1e-9)


def test_a_run_takes_the_truth_of_its_own_recordings_only(tmp_path):
    lines = ["r1,a.b.1,mit,a,b,ann,right,,10,20,0.5,,,", "r2,a.b.1,intel,a,b,ann,right,,1,2,0,,,"]
    path = written(tmp_path, *lines)
    for recording, x_m in (("mit", 10.0), ("intel", 1.0)):
        truths = truths_of(ExamplesConfig(truth=path), {"a": recording, "b": recording}, {}, {})
        assert truths["a", "b"].T_receiver_donor.x_m == x_m and ("b", "a") in truths
    assert not truths_of(ExamplesConfig(truth=path), {"a": "quad", "b": "quad"}, {}, {})
    assert not truths_of(ExamplesConfig(truth=path), {"a": "mit", "b": "intel"}, {}, {})  # each line is of both
    path = written(tmp_path, "r1,a.b.1,,a,b,ann,right,,10,20,0.5,,,")
    assert truths_of(ExamplesConfig(truth=path), {"a": "quad", "b": "quad"}, {}, {})  # written by hand, of any


def test_a_word_that_was_withdrawn_or_replaced_is_not_the_truth(out):
    say(out, 0, "right", "ann")
    say(out, 0, "withdrawn", "ann")
    say(out, 1, "right", "ann")
    say(out, 1, "wrong", "ann", MOVED)
    say(out, 2, "right", "ann")
    say(out, 2, "wrong", "ann")
    truth = examples_truth(told(out, everything=True), RUN)
    assert truth.keys() == {"alpha.beta.2"} == examples_truth(told(out), RUN).keys()
    assert truth["alpha.beta.2"].T_receiver_donor.difference(MOVED)[0] < 1e-9


def test_the_last_word_is_the_latest_and_one_without_a_time_is_of_now(tmp_path):
    early, late = "2026-03-01T12:00:00+02:00", "2026-03-01T11:00:00Z"
    path = written(tmp_path, f"r1,a.b.1,,a,b,ann,right,{late},1,1,0,,,", f"r1,a.b.1,,a,b,ann,right,{early},9,9,0,,,")
    assert examples_truth(path, "r1")["a.b.1"].T_receiver_donor.x_m == 1.0
    path = written(tmp_path, "r1,a.b.1,,a,b,ann,withdrawn,,,,,,,", f"r1,a.b.1,,a,b,ann,right,{early},9,9,0,,,")
    assert not examples_truth(path, "r1")
    path = written(tmp_path, "r1,a.b.1,,a,b,,right,,1,1,0,,,", "r1,a.b.1,,a,b,,right,,9,9,0,,,")
    with pytest.raises(UsageError, match="this transform lies"):  # of nobody it is known that they are the same
        examples_truth(path, "r1")


def test_what_one_holds_for_right_and_another_calls_wrong_is_not_the_truth(out):
    """Whatever the majority says: nobody knows which of the two is right."""
    say(out, 0, "wrong", "ann")
    say(out, 0, "wrong", "bob")
    say(out, 0, "right", "cid")
    for read in (lambda path: examples_truth(path, RUN), robots_truth):
        with pytest.raises(UsageError, match=r"line 2: this line calls wrong what line 4 holds for right: decide"):
            read(told(out))
    say(out, 0, "withdrawn", "cid")
    assert not examples_truth(told(out), RUN)
    say(out, 0, "wrong", "cid", MOVED)  # the two others may well agree with that
    assert examples_truth(told(out), RUN)["alpha.beta.1"].T_receiver_donor.difference(MOVED)[0] < 1e-9


def test_words_on_other_transforms_and_other_examples_do_not_contradict(tmp_path):
    right = "r1,a.b.1,,a,b,ann,right,,1,1,0,1,1,0"
    others = ("r1,a.b.1,,a,b,bob,wrong,,,,,8,8,0", "r1,a.b.2,,a,b,bob,wrong,,,,,1,1,0", ",,,a,b,bob,wrong,,,,,,,")
    for other in others:
        assert robots_truth(written(tmp_path, right, other)).keys() == {("a", "b")}
    with pytest.raises(UsageError, match="line 3: this line calls wrong what line 2 holds for right"):
        robots_truth(written(tmp_path, right, "r1,a.b.1,,a,b,bob,wrong,,,,,,,"))


def test_a_line_whose_label_was_changed_but_not_its_pose_is_named(tmp_path):
    path = written(tmp_path, "r1,a.b.1,,a,b,ann,wrong,,1,2,0.5,1,2,0.5")
    with pytest.raises(UsageError, match="line 2: it gives for right what it calls wrong"):
        robots_truth(path)
