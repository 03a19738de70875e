"""A data set's files appear as wholes, on a disk and in an object store."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from mapgraft.corpus.dataset import Dataset
from mapgraft.corpus.fetching import scratch
from mapgraft.corpus.patterns import matching, recordings_of
from mapgraft.corpus.recordings import far_recording, recordings_in
from mapgraft.corpus.stores import UNFINISHED, FolderStore, Store, open_store
from mapgraft.errors import OutputError, RecordingError, UsageError


@pytest.fixture(params=["folder", "s3"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    if request.param == "folder":
        return open_store(f"file://{tmp_path}/data set")
    bucket = f"store-{os.getpid()}-{time.monotonic_ns()}"
    request.getfixturevalue("s3").mkdir(bucket)
    return open_store(f"s3://{bucket}/data set/")


@pytest.fixture
def file(tmp_path: Path) -> Callable[[bytes], Path]:
    def made(data: bytes) -> Path:
        path = tmp_path / "file"
        path.write_bytes(data)
        return path

    return made


def test_files_are_put_replaced_listed_and_removed(store: Store, file: Callable[[bytes], Path]) -> None:
    assert store.names("runs") == [] and not store.has("runs/run_id=a/part.parquet")
    for name in ("runs/run_id=b/part.parquet", "runs/run_id=a/part.parquet", "runsx/part.parquet"):
        store.put(file(name.encode()), name)
    store.put(file(b"other"), "runs/run_id=a/part.parquet")
    assert store.names("runs") == ["runs/run_id=a/part.parquet", "runs/run_id=b/part.parquet"]
    assert store.has("runs/run_id=a/part.parquet")
    filesystem, root = store.arrow()
    assert filesystem.open_input_file(f"{root}/runs/run_id=a/part.parquet").read() == b"other"
    store.remove("runs/run_id=a/part.parquet")
    store.remove("runs/run_id=a/part.parquet")
    assert store.names("runs") == ["runs/run_id=b/part.parquet"]


def test_a_file_that_cannot_be_put_leaves_nothing(tmp_path: Path) -> None:
    store = FolderStore(tmp_path / "out")
    with pytest.raises(OutputError):
        store.put(tmp_path / "not there", "a/b")
    assert store.names("a") == [] and not list((tmp_path / "out" / UNFINISHED).iterdir())
    (tmp_path / "plain").write_bytes(b"")
    with pytest.raises(OutputError, match="file or folder of that name is in the way"):
        FolderStore(tmp_path / "plain").put(tmp_path / "plain", "a/b")


def test_what_killed_processes_left_is_swept_and_nothing_else(tmp_path: Path) -> None:
    store, aside = FolderStore(tmp_path), tmp_path / UNFINISHED
    aside.mkdir()
    (aside / "old").write_bytes(b"half")
    os.utime(aside / "old", (0, 0))
    (aside / "new").write_bytes(b"half")
    store.tidy()
    assert [path.name for path in aside.iterdir()] == ["new"]


@pytest.mark.parametrize("link", [UNFINISHED, "runs", "runs/run_id=a", "runs/run_id=a/part.parquet"])
@pytest.mark.parametrize("to", ["", "not there"])
def test_through_links_of_a_data_set_nothing_is_written_or_removed(
    tmp_path: Path, file: Callable[[bytes], Path], link: str, to: str
) -> None:
    home, root = tmp_path / "home", tmp_path / "data"
    home.mkdir()
    (home / "part.parquet").write_bytes(b"mine")
    os.utime(home / "part.parquet", (0, 0))
    (root / link).parent.mkdir(parents=True)
    (root / link).symlink_to(home / to)
    store = FolderStore(root)
    for act in (
        store.tidy,
        lambda: store.put(file(b"new"), "runs/run_id=a/part.parquet"),
        lambda: store.remove("runs/run_id=a/part.parquet"),
        Dataset(str(root)).prepare,
    ):
        with suppress(OutputError):
            act()
    assert [(path.name, path.read_bytes()) for path in home.iterdir()] == [("part.parquet", b"mine")]


@pytest.mark.parametrize("name", [UNFINISHED, "runs", "failures", "labels", "events"])
def test_a_data_set_with_a_table_elsewhere_is_refused_before_anything_is_done(tmp_path: Path, name: str) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / name).symlink_to(tmp_path)
    with pytest.raises(OutputError, match=f"{name} is a link, which may lead out of"):
        Dataset(str(tmp_path / "data")).prepare()
    (tmp_path / "disk").mkdir()
    (tmp_path / "here").symlink_to(tmp_path / "disk")
    Dataset(str(tmp_path / "here")).prepare()  # the folder itself may be on another disk
    assert (tmp_path / "disk" / "corpus.json").is_file()


def test_scratch_of_the_dead_is_swept_and_that_of_the_living_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    left = tmp_path / "mapgraft-corpus-dead"
    left.mkdir()
    (left / ".lock").touch()
    (left / "data").write_bytes(b"x")
    for name, age_s in (("half", 100), ("young", 0)):
        (tmp_path / f"mapgraft-corpus-{name}").mkdir()
        os.utime(tmp_path / f"mapgraft-corpus-{name}", (time.time() - age_s,) * 2)
    with scratch() as mine, scratch() as other:
        assert not left.exists()
        assert mine.exists() and other.exists() and mine != other
    assert [path.name for path in tmp_path.iterdir()] == ["mapgraft-corpus-young"]  # it may be locked in a moment


def test_refusals_of_an_object_store_are_sentences(s3: Any, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"s3://no-such-bucket/x/a cannot be written: .*bucket"):
        (tmp_path / "f").write_bytes(b"x")
        open_store("s3://no-such-bucket/x").put(tmp_path / "f", "a")
    s3.mkdir("refusing")
    with pytest.raises(RecordingError, match=r"s3://refusing/a\.mcap does not exist"):
        far_recording("s3://refusing/a.mcap")
    s3.pipe_file("refusing/folder/a.txt", b"x")
    with pytest.raises(RecordingError, match=r"is a folder without metadata\.yaml"):
        far_recording("s3://refusing/folder")
    with pytest.raises(UsageError, match="nowhere://bucket cannot be opened"):
        open_store("nowhere://bucket")


def test_names_of_an_object_store_mean_what_they_would_on_a_disk(s3: Any) -> None:
    s3.mkdir("named")
    for name in ("m1/lidar.mcap", "m2/lidar.mcap", "m2/notes.txt", "bags/one/one_0.db3", "empty/notes.txt"):
        s3.pipe_file(f"named/{name}", b"x")
    s3.pipe_file("named/bags/one/metadata.yaml", b"rosbag2_bagfile_information: {}")
    both = ["s3://named/m1/lidar.mcap", "s3://named/m2/lidar.mcap"]
    assert recordings_of("s3://named/*/lidar.mcap") == both == recordings_of("s3://named/m?")
    assert recordings_of("s3://named/m?/") == both == matching("s3://named/m?/l*")
    assert recordings_of(both[0]) == both[:1]
    for bag in ("s3://named/bags", "s3://named/bags/*", "s3://named/bags/one", "s3://named/bags/one/"):
        assert recordings_of(bag) == ["s3://named/bags/one"]
    for nothing in ("s3://named/empty", "s3://named/emp*", "s3://named/none.mcap"):
        with pytest.raises(RecordingError, match="holds no recording"):
            recordings_of(nothing)


def test_recordings_of_an_object_store_are_known_by_what_it_says(s3: Any) -> None:
    s3.mkdir("kept")
    for name in ("a.mcap", "a.mcap.old", "bag/metadata.yaml", "bag/bag_0.db3", "x.merge.mcap"):
        s3.pipe_file(f"kept/deep/{name}", name.encode())
    assert recordings_in("s3://kept/deep/") == ["s3://kept/deep/a.mcap", "s3://kept/deep/bag"]
    first, bag = far_recording("s3://kept/deep/a.mcap"), far_recording("s3://kept/deep/bag")
    assert (first.input_file.size_bytes, first.is_folder, bag.is_folder) == (6, False, True)
    assert first.input_file == far_recording("s3://kept/deep/a.mcap").input_file
    assert bag == far_recording("s3://kept/deep/bag/")
    s3.pipe_file("kept/deep/a.mcap", b"A.mcap")
    s3.pipe_file("kept/deep/bag/bag_0.db3", b"BAG_0.db3")
    assert first.input_file.identity != far_recording("s3://kept/deep/a.mcap").input_file.identity
    assert bag.input_file.identity != far_recording("s3://kept/deep/bag").input_file.identity
