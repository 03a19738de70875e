"""Publishing datasets: split by building, labels joined, added to, the same bytes, all of it or nothing."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML
from toy_examples import ENVIRONMENTS, RUN, write_toys

from mapgraft.cli import invoke
from mapgraft.contracts import Transform
from mapgraft.errors import OutputError, UsageError
from mapgraft.examples import ExampleFolder, ExampleKey, transform_of
from mapgraft.examples.publishing import publish
from mapgraft.examples.splits import SPLITS, split_by_name, split_of
from mapgraft.outputs.labels import label

OTHER = "rfedcba9876543210"
AT = {"aces": "train", "belgioioso": "validation", "fr101": "test", "intel": "train", "mit": "test"}


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def say(out: Path, example_id: str, verdict: str, by: str, T: Transform | None = None, run_id: str = RUN) -> None:
    folder = ExampleFolder(out)
    judged = transform_of(folder.row(ExampleKey(run_id, example_id))["T_receiver_donor"])
    about = {"merge_id": example_id, "receiver": "alpha", "donor": "beta"}
    label(out, run_id, **about, verdict=verdict, by=by, T_receiver_donor=judged, T_corrected=T)


def found(dataset: Path, columns: list[str]) -> dict[str, dict]:
    return {row["example_id"]: row for row in ExampleFolder(dataset).rows(["example_id", *columns]).to_pylist()}


@given(st.text(min_size=1), st.lists(st.text(min_size=1)))
def test_a_building_is_in_the_same_split_whatever_others_there_are(name: str, others: list[str]):
    decided = {other: split_by_name(other) for other in others}
    assert split_of(name, decided) == split_of(name, {}) or "+" in name
    assert split_by_name(name) in SPLITS


def test_about_seventy_of_a_hundred_are_for_training():
    counts = [sum(split_by_name(f"building {n}") == split for n in range(4_000)) for split in SPLITS]
    assert [count / 4_000 for count in counts] == pytest.approx([0.70, 0.15, 0.15], abs=0.03)
    assert split_by_name("intel") == split_by_name("intel")


def test_two_buildings_are_in_a_split_or_in_none():
    assert split_of("aces+intel", AT) == "train" and split_of("aces+fr101", AT) is None


def test_no_building_is_in_two_splits(toys, tmp_path):
    published = publish([toys], tmp_path, AT)
    rows = found(tmp_path, ["environment", "split"])
    assert len(rows) == 150 == sum(published.rows.values()) and published.environments == AT
    assert all(AT[row["environment"]] == row["split"] for row in rows.values())


def test_pairs_between_two_splits_are_left_out_and_counted(tmp_path):
    write_toys(tmp_path / "out", 40, environments=("aces", "aces+intel", "aces+fr101"))
    published = publish([tmp_path / "out"], tmp_path / "data", AT)
    environments = [row["environment"] for row in found(tmp_path / "data", ["environment"]).values()]
    between = 40 - len(environments)
    assert "aces+fr101" not in environments and "aces+intel" in environments
    assert published.left_out == {RUN: between} and between > 5
    assert f"{between} examples of two buildings" in (tmp_path / "data/README.md").read_text()
    again = publish([tmp_path / "out"], tmp_path / "data", {"fr101": "train"})  # now they go together
    assert not again.left_out and sum(again.rows.values()) == 40


def test_what_was_left_out_stays_told_when_a_dataset_is_published_from_itself(tmp_path):
    """Or from another one: what was never in it cannot be counted there."""
    data, card = tmp_path / "data", "README.md"
    write_toys(tmp_path / "out", 40, environments=("aces", "aces+intel", "aces+fr101", "mit"))
    before = publish([tmp_path / "out"], data, AT)
    here = contents(data)
    assert before.left_out[RUN] > 5
    assert publish([data], data).left_out == before.left_out and contents(data) == here
    publish([data], tmp_path / "copy", AT)
    assert (tmp_path / "copy" / card).read_bytes() == here[card]
    more = publish([data], data, {"intel": "test"}).left_out[RUN]  # and now some more
    assert more + sum(publish([], data).rows.values()) == 40 and more > before.left_out[RUN]
    assert publish([data, tmp_path / "out"], data).left_out == {RUN: more}
    assert publish([tmp_path / "out"], data, {"intel": "train"}).left_out == before.left_out  # counted anew


def test_the_same_gives_the_same_bytes_and_twice_is_once(toys, tmp_path):
    for folder in (tmp_path / "a", tmp_path / "b"):
        publish([toys], folder, AT, "cc-by-4.0")
    before = contents(tmp_path / "a")
    assert before == contents(tmp_path / "b")
    publish([toys], tmp_path / "a")
    assert contents(tmp_path / "a") == before  # what was said of splits and licence stays


def test_others_come_in_beside_what_is_there(toys, tmp_path):
    write_toys(tmp_path / "more", 30, seed=1, run_id=OTHER, environments=("mit", "quad"))
    publish([toys], tmp_path / "data", AT)
    before = contents(tmp_path / "data")
    publish([tmp_path / "more"], tmp_path / "data")
    after = contents(tmp_path / "data")
    assert {name: data for name, data in after.items() if name in before and name.endswith(".parquet")} == {
        name: data for name, data in before.items() if name.endswith(".parquet")
    }
    assert len(ExampleFolder(tmp_path / "data")) == 180
    publish([toys, tmp_path / "more"], tmp_path / "at once", AT)
    assert contents(tmp_path / "at once") == after  # the order does not matter


def test_a_building_that_moves_takes_all_its_examples_along(toys, tmp_path):
    publish([toys], tmp_path, AT)
    publish([toys], tmp_path / "other", {**AT, "intel": "test"})
    write_toys(tmp_path / "more", 5, seed=1, run_id=OTHER, environments=("mit",))
    publish([tmp_path / "more"], tmp_path, {"intel": "test"})  # the run with intel is not given again
    rows = found(tmp_path, ["environment", "split"])
    assert {row["split"] for row in rows.values() if row["environment"] == "intel"} == {"test"}
    assert sum(row["environment"] == "intel" for row in rows.values()) > 10
    assert len(ExampleFolder(tmp_path)) == 155


def test_labels_of_persons_are_joined_and_the_truth_goes_before_them(tmp_path):
    out, data = tmp_path / "out", tmp_path / "data"
    write_toys(out, 8, truth=False)
    write_toys(tmp_path / "known", 3, run_id=OTHER)
    moved = Transform.planar(1.0, 2.0, 0.3)
    for by, verdict in (("ann", "right"), ("bob", "wrong"), ("cid", "wrong")):
        say(out, "alpha.beta.1", verdict, by, moved if verdict == "wrong" else None)
    say(out, "alpha.beta.2", "right", "ann")
    say(out, "alpha.beta.2", "wrong", "bob")
    say(out, "alpha.beta.3", "right", "ann")
    say(out, "alpha.beta.3", "withdrawn", "ann")
    say(out, "alpha.beta.4", "wrong", "ann", moved)
    truth = found(tmp_path / "known", ["truth"])["alpha.beta.1"]["truth"]
    say(tmp_path / "known", "alpha.beta.1", "wrong" if truth == "right" else "right", "ann", run_id=OTHER)
    publish([out, tmp_path / "known"], data)
    rows = {
        ExampleKey(row["run_id"], row["example_id"]): row
        for row in ExampleFolder(data)
        .rows(["run_id", "example_id", "label", "label_by", "labels", "T_label"])
        .to_pylist()
    }
    first = rows[ExampleKey(RUN, "alpha.beta.1")]
    assert (first["label"], first["label_by"]) == ("wrong", "persons")
    assert [said["annotator"] for said in first["labels"]] == ["ann", "bob", "cid"]
    put = transform_of(first["T_label"])  # where those hold it to lie who say what counts
    assert put is not None and put.difference(moved)[0] < 1e-9
    assert rows[ExampleKey(RUN, "alpha.beta.2")]["label"] == "unsure"
    assert (
        rows[ExampleKey(RUN, "alpha.beta.3")]["label"] is None and not rows[ExampleKey(RUN, "alpha.beta.3")]["labels"]
    )
    put = transform_of(rows[ExampleKey(RUN, "alpha.beta.4")]["T_label"])
    assert put is not None and put.difference(moved)[0] < 1e-9
    known = rows[ExampleKey(OTHER, "alpha.beta.1")]
    assert (known["label"], known["label_by"]) == (truth, "truth") and len(known["labels"]) == 1


def test_words_on_a_dataset_and_words_that_come_later_are_kept(tmp_path):
    out, data = tmp_path / "out", tmp_path / "data"
    write_toys(out, 4, truth=False)
    say(out, "alpha.beta.1", "right", "ann")
    publish([out], data)
    say(data, "alpha.beta.2", "wrong", "bob")  # somebody labels the dataset itself
    say(out, "alpha.beta.3", "right", "ann")
    say(out, "alpha.beta.1", "withdrawn", "ann")
    say(out, "alpha.beta.4", "wrong", "ann", Transform.planar(1.1, 2.2, 0.333))
    publish([out], data)
    labels = {i: row["label"] for i, row in found(data, ["label"]).items()}
    assert labels == {"alpha.beta.1": None, "alpha.beta.2": "wrong", "alpha.beta.3": "right", "alpha.beta.4": "wrong"}
    before = contents(data)
    publish([data], data)
    assert contents(data) == before
    (tmp_path / "copy").mkdir()
    publish([data], tmp_path / "copy")  # a dataset is a source as good as any
    assert {i: row["label"] for i, row in found(tmp_path / "copy", ["label"]).items()} == labels


def test_the_card_tells_what_is_in_it_and_keeps_what_persons_wrote(toys, tmp_path):
    publish([toys], tmp_path, AT, "cc-by-4.0")
    text = (tmp_path / "README.md").read_text()
    header = YAML(typ="safe", pure=True).load(text.split("---\n")[1])
    assert header["license"] == "cc-by-4.0" and header["size_categories"] == ["n<1K"]
    told = {one["split"]: one["path"] for one in header["configs"][0]["data_files"]}
    assert told == {split: f"examples/split={split}/*.parquet" for split in SPLITS}
    for name in (*ENVIRONMENTS, "recorded poses", "0.5 m", "`classes_own`", "Limits", "150"):
        assert name in text
    begin = "<!-- your own words: they stay as they are -->"
    mine = "Recorded by ann in the old mill. | <b>\\1 $&"
    (tmp_path / "README.md").write_text(text.replace(text.split(begin)[1].split("<!-- end")[0], f"\n{mine}\n"))
    publish([toys], tmp_path)
    again = (tmp_path / "README.md").read_text()
    assert mine in again and again.count("end of your own words") == 1 and "Nobody has written" not in again


def test_names_from_recordings_are_no_markup(tmp_path):
    write_toys(tmp_path / "out", 3, environments=("<script>alert(1)</script>|x\n# y",))
    publish([tmp_path / "out"], tmp_path / "data")
    text = (tmp_path / "data/README.md").read_text()
    assert "<script>" not in text and "\\<script\\>" in text and "\n# y" not in text


def test_what_is_no_dataset_is_not_written_over(toys, tmp_path):
    write_toys(tmp_path, 2)
    with pytest.raises(OutputError, match="holds examples of a run or an evaluation"):
        publish([toys], tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run/summary.json").write_text("{}")
    with pytest.raises(OutputError, match="holds a run"):
        publish([toys], tmp_path / "run")
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd/dataset.json").write_text("[]")
    with pytest.raises(OutputError, match="is not what a dataset has there"):
        publish([toys], tmp_path / "odd")


@pytest.mark.parametrize("split", [{"aces": "dev"}, {"": "test"}, {"aces+mit": "test"}])
def test_a_split_that_is_none_is_refused(toys, tmp_path, split):
    with pytest.raises(UsageError, match=r"--split wants one ENVIRONMENT=train\|validation\|test"):
        publish([toys], tmp_path / "data", split)
    assert not (tmp_path / "data").exists()


def test_a_split_of_a_building_without_examples_is_remarked_upon(toys, tmp_path, capsys):
    to = ["-o", str(tmp_path / "data"), "--split", "nowhere=test"]
    assert invoke(["dataset", str(toys), *to, "--split", "intel=train"]) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "no example in the dataset is of nowhere: what --split says of that is for examples to come" in told
    assert "intel" not in told and "no building" not in told


def test_a_folder_without_examples_is_named(tmp_path):
    with pytest.raises(UsageError, match="has no examples: run or evaluate with --examples"):
        publish([tmp_path], tmp_path / "data")
    with pytest.raises(UsageError, match=f"there is no folder {tmp_path / 'nowhere'}: name the folder of a run"):
        publish([tmp_path / "nowhere"], tmp_path / "data")
    partial = tmp_path / "examples" / "run_id=r1" / ".part-00000.parquet.partial"
    partial.parent.mkdir(parents=True)
    partial.touch()
    with pytest.raises(UsageError, match="has no examples yet, because the run there is not finished"):
        publish([tmp_path], tmp_path / "data")


def test_a_publication_that_is_killed_leaves_the_dataset_or_its_successor(toys, tmp_path):
    """Killed at some moments of its course: what is there is whole, and doing it again ends as if undisturbed."""
    publish([toys], tmp_path / "wanted", AT)
    write_toys(tmp_path / "more", 30, seed=1, run_id=OTHER, environments=("mit", "quad"))
    publish([toys], tmp_path / "data", AT)
    script = f"""
    import sys
    from pathlib import Path
    from mapgraft.examples.publishing import publish
    print("begun", flush=True)
    publish([Path({str(tmp_path / "more")!r})], Path({str(tmp_path / "data")!r}), {{"intel": "test"}})
    """
    for delay_s in (0.02, 0.08, 0.2):
        process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE)
        assert process.stdout is not None and process.stdout.readline()
        time.sleep(delay_s)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert json.loads((tmp_path / "data/dataset.json").read_text())["format"]
        assert len(ExampleFolder(tmp_path / "data")) in (150, 180)
    publish([tmp_path / "more"], tmp_path / "data", {"intel": "test"})
    publish([tmp_path / "more"], tmp_path / "wanted", {"intel": "test"})
    assert contents(tmp_path / "data") == contents(tmp_path / "wanted")
