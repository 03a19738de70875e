"""The pairs of an evaluation as examples, and labels of persons as its truth."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from mapgraft.config import parse_config
from mapgraft.contracts import Transform
from mapgraft.errors import OutputError, UsageError
from mapgraft.evaluation import Bench, Course, Drawing, Settings, draw_pairs, evaluate, evaluate_courses
from mapgraft.evaluation.courses import joined, load_courses
from mapgraft.evaluation.exemplified import Identified, environment_of, joined_by, told_of, unused_of
from mapgraft.evaluation.truth import RIGHT_M
from mapgraft.examples import ExampleFolder, transform_of
from mapgraft.examples.labels_csv import exported
from mapgraft.examples.rows import examples_table
from mapgraft.outputs.labels import label
from mapgraft.outputs.lock import LOCK
from mapgraft.plugins import Plugins
from mapgraft_recordings import demo_files
from mapgraft_schemas import arrow_schema

CONFIG = parse_config({"examples": {"environments": {"other": "annex"}}})


def test_every_pair_is_an_example_with_the_truth(courses, plugins, rules, small, tell_truth):
    settings = Settings(small, rules=rules, matcher="oracle", baseline=False, examples=True)
    tell_truth(settings)
    evaluation = evaluate_courses(courses, CONFIG, settings, plugins)
    rows = [row for judged in evaluation.judged for row in judged.examples]
    assert [row["example_id"] for row in rows] == [f"{n}.judged" for n in range(12)]
    for judged, row in zip(evaluation.judged, rows, strict=True):
        scored = judged.by["judged"]
        assert (row["verdict"], row.get("state", "")) == (scored.verdict, scored.state)
        assert row["truth_by"] == "recorded poses" and row["truth_overlap"] == (scored.overlap or 0.0)
        if scored.best is None:
            assert row["truth"] is None and row["chosen"] is None
            continue
        assert row["truth"] == "right" and row["truth_error_m"] == scored.best.error_m < RIGHT_M
        assert dict(row["evidence"]) == pytest.approx(scored.numbers, nan_ok=True)
        assert np.allclose(row["truth_T"], row["T_receiver_donor"], atol=1e-4)
        if scored.final is not None:
            assert row["new_wall_m"] == scored.walls_m and row["truth_final"] == "right"
            assert {**row["later"]} and row["history"][0]["observations"] == 0
    across = [row for row, plan in zip(rows, evaluation.bench.plans, strict=True) if plan.across]
    assert {row["environment"] for row in across} == {"annex+one"}
    assert {row["environment"] for row in rows} <= {"annex", "one", "annex+one"}
    lying = dataclasses.replace(settings, matcher="liar")
    wrong = [row for judged in evaluate_courses(courses, CONFIG, lying, plugins).judged for row in judged.examples]
    assert {row["truth"] for row in wrong} == {"wrong", None}
    table = examples_table([{**row, "position": n} for n, row in enumerate(wrong)])
    assert table.schema.equals(arrow_schema("examples"))


def test_a_person_goes_before_recorded_poses(courses, plugins, rules, small, tell_truth):
    settings = Settings(small, rules=rules, matcher="oracle", baseline=False, examples=True)
    tell_truth(settings)
    before = evaluate_courses(courses, CONFIG, settings, plugins).judged
    (number, *_) = (n for n, judged in enumerate(before) if judged.by["judged"].right)
    elsewhere = Transform.planar(3.0, 0.0, 0.0) @ transform_of(before[number].examples[0]["truth_T"].ravel())
    after = evaluate_courses(courses, CONFIG, dataclasses.replace(settings, given={number: elsewhere}), plugins).judged
    assert after[number].by["judged"].wrong and after[number].examples[0]["truth"] == "wrong"
    assert after[number].examples[0]["truth_by"] == "given"
    others = [n for n in range(len(before)) if n != number]
    assert [after[n].by["judged"].right for n in others] == [before[n].by["judged"].right for n in others]


def test_two_recordings_that_a_person_has_joined_are_one_place(courses, tmp_path):
    ann, bob, _ = courses
    assert {plan.across for plan in draw_pairs(courses, Drawing(20, 20, 5, across=0.5))} == {True, False}
    path = tmp_path / "labels.csv"
    path.write_text("recording,receiver,donor,label,x_m,y_m,yaw_rad\none+other,ann,bob,right,10,2,0.5\n")
    T = joined_by(path, courses)["ann", "bob"]
    together = joined(courses, {("ann", "bob"): T})
    assert len({course.site for course in together}) == 1 and {course.world for course in together} == {"one"}
    places = {course.robot: course.T_world_map for course in together}
    assert (places["ann"].inverse() @ places["bob"]).difference(Transform.planar(10, 2, 0.5))[0] < 1e-9
    kept = (places["bob"].inverse() @ places["cid"]).difference(Transform.identity())
    assert kept[0] < 1e-9 and abs(kept[1]) < 1e-9  # these two the recording knows
    assert {environment_of(course, CONFIG) for course in together} == {"one", "annex"}
    assert {environment_of(course, parse_config({})) for course in together} == {"one"}
    plans = draw_pairs(together, Drawing(40, 20, 5, across=0.5))
    assert not any(plan.across for plan in plans)
    assert any({plan.receiver.course.robot, plan.donor.course.robot} == {"ann", "bob"} for plan in plans)
    assert joined(courses, {("ann", "zoe"): T})[0].site == ann.site and bob.site == ("other",)


def test_a_joint_that_scales_is_refused(courses, tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text("receiver,donor,label,x_m,y_m,yaw_rad,scale\nann,bob,right,10,2,0.5,2\n")
    with pytest.raises(UsageError, match="bob is scaled by 2 in ann, but scans are in metres"):
        joined_by(path, courses)


def test_it_is_said_how_many_lines_of_a_truth_are_about_something_else(courses, tmp_path):
    path = tmp_path / "labels.csv"
    header, ours = "run_id,example_id,recording,receiver,donor,label", "r1,ann.bob.1,one+other,ann,bob,right"
    lines = [
        "r1,ann.bob.1,one+far,ann,bob,right",
        "r1,ann.zoe.1,,ann,zoe,right",
        "e1,3.judged,one,receiver,donor,right",
    ]
    for count, text in ((0, lines[:2]), (1, [*lines[:2], ours]), (1, lines), (2, [*lines, ours])):
        path.write_text("\n".join([header, *text]))
        (said,) = unused_of(path, "e1", courses)
        assert said.startswith(f"{count} of {len(text)} lines of {path} are about these recordings or this evaluation")
    path.write_text("\n".join([header, ours, lines[2]]))
    assert unused_of(path, "e1", courses) == []


@pytest.fixture
def evaluated(plugins: Plugins, rules: Path):
    """What evaluates the demo with few pairs."""
    files, _, _ = demo_files()
    drawing = Drawing(pairs=3, scans=12, further=4, across=0.0, seed=1)
    settings = Settings(drawing, rules=rules, matcher="correlation", baseline=False, resolution_m=0.2)
    return lambda **kwargs: evaluate(files, CONFIG, settings, plugins, **kwargs)


def test_a_folder_of_examples_is_the_same_each_time_and_takes_labels_back(evaluated, tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    first = evaluated(examples=one)
    evaluated(examples=other, jobs=2)
    (ours,), (theirs,) = (sorted(out.glob("examples/**/*.parquet")) for out in (one, other))
    assert ours.relative_to(one) == theirs.relative_to(other) and ours.read_bytes() == theirs.read_bytes()
    assert not any(judged.examples for judged in first.judged)  # they are on disk, and not in memory any more
    folder = ExampleFolder(one)
    assert len(folder) == 3 and folder.keys[0].run_id.startswith("e")
    key = folder.keys[1]
    row = folder.row(key)
    assert row["software"] and len(row["config_sha256"]) == 64 and len(row["recording_sha256"]) == 3
    assert len({folder.row(key)["pair_sha256"] for key in folder.keys}) == 3
    moved = Transform.planar(1.5, 0.0, 0.0) @ transform_of(row["truth_T"])
    label(
        one,
        key.run_id,
        merge_id=key.example_id,
        receiver="receiver",
        donor="donor",
        verdict="wrong",
        T_receiver_donor=transform_of(row["T_receiver_donor"]),
        T_corrected=moved,
    )
    truth = tmp_path / "labels.csv"
    told_nothing = "e0123,0.judged,,far,ann,bob,eve,right"
    header, line = exported([folder])[0].splitlines()
    truth.write_text("\n".join([header, line, *([told_nothing] * 2)]) + "\n")
    again = evaluated(examples=tmp_path / "again", truth=truth)
    told = ExampleFolder(tmp_path / "again")
    assert told.keys == folder.keys and len(again.judged) == 3  # what a person says makes it no other evaluation
    assert f"1 of 3 lines of {truth} are about these recordings" in again.remarks[0]
    assert [told.row(k)["truth_by"] for k in told.keys] == ["recorded poses", "given", "recorded poses"]
    T = transform_of(told.row(key)["truth_T"])
    assert T is not None and T.difference(moved)[0] < 1e-6


def test_the_same_two_windows_have_the_same_digest_whatever_else_is_set(plugins, rules):
    files, _, _ = demo_files()
    courses = load_courses(files, CONFIG, plugins)

    def identified(resolution_m=0.1, pairs=12, seed=1):
        drawing = Drawing(pairs, scans=12, further=4, across=0.0, seed=seed)
        settings = Settings(drawing, rules=rules, matcher="correlation", baseline=False, resolution_m=resolution_m)
        return Identified.of(files, Bench(courses, CONFIG, plugins, settings), {})

    first, again = identified(), identified(resolution_m=0.2, pairs=7)
    assert len(set(first.pairs)) == 12 and {len(digest) for digest in first.pairs} == {64}
    assert again.run_id != first.run_id and again.pairs == first.pairs[:7]
    assert not {*identified(seed=2).pairs} & {*first.pairs}


def test_an_example_that_the_evaluation_does_not_have_is_named(tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text("run_id,example_id,label,x_m,y_m,yaw_rad\ne1,7.judged,right,0,0,0\n")
    assert told_of(path, "e1", 8).keys() == {7} and told_of(path, "e2", 8) == {}
    with pytest.raises(UsageError, match=r"this evaluation \(e1\) has no example '7.judged'"):
        told_of(path, "e1", 7)


def test_who_is_interrupted_leaves_no_folder_that_looks_like_examples(courses, plugins, small, tmp_path):
    bench = Bench(courses, CONFIG, plugins, Settings(small, baseline=False))
    identified = Identified.of((), bench, {})
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt), identified.writing(out):
        raise KeyboardInterrupt
    assert [path.name for path in out.iterdir()] == [LOCK]
    theirs = out / "examples" / "run_id=e1" / "part-00000-00000000.parquet"
    theirs.parent.mkdir(parents=True)
    theirs.touch()
    with pytest.raises(KeyboardInterrupt), identified.writing(out):
        raise KeyboardInterrupt
    assert [path.name for path in (out / "examples").iterdir()] == [theirs.parent.name] and theirs.is_file()


def test_examples_do_not_go_into_a_dataset(evaluated, tmp_path):
    (tmp_path / "dataset.json").write_text("{}")
    with pytest.raises(OutputError, match="holds a dataset"):
        evaluated(examples=tmp_path)


def test_courses_have_the_site_of_their_files():
    course = Course.of(0, "ann", "one", ())
    assert course.site == ("one",) and dataclasses.replace(course, joined=("one", "two")).site == ("one", "two")
