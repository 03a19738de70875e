"""Words that come one by one: read as they come, put together now and then, lost never."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.outputs.label_parts import MANY, PART_ROWS, LabelParts, gather
from mapgraft.outputs.labels import label
from mapgraft.outputs.lock import locked
from mapgraft.outputs.staging import JOURNAL

RUN = "r1"


def say(out: Path, number: int, by: str = "anna", run_id: str = RUN) -> None:
    clock = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=number)
    told = {"merge_id": f"a.b.{number}", "receiver": "a", "donor": "b", "verdict": "right"}
    label(out, run_id, **told, by=by, clock=clock)


def parts(out: Path, run_id: str = RUN) -> list[Path]:
    return sorted((out / "labels" / f"run_id={run_id}").glob("part-*.parquet"))


def read(out: Path) -> list[tuple[str, dict[str, object]]]:
    """All words, in the order in which they were said; a transform as text, for NaN is not NaN."""
    found = [(run_id, row) for run_id, rows in LabelParts(out).new() for row in rows.to_pylist()]
    told = [(run_id, {name: str(value) for name, value in row.items()}) for run_id, row in found]
    return sorted(told, key=lambda word: word[1]["labelled_at"])


def test_what_has_come_in_since(tmp_path: Path):
    reading = LabelParts(tmp_path)
    assert list(reading.new()) == []
    for number in range(3):
        say(tmp_path, number)
        ((run_id, rows),) = reading.new()
        assert (run_id, rows["merge_id"].to_pylist()) == (RUN, [f"a.b.{number}"])
        assert list(reading.new()) == []


def test_runs_are_told_apart_and_other_names_are_none(tmp_path: Path):
    say(tmp_path, 1)
    say(tmp_path, 2, run_id="r2")
    shutil.copytree(tmp_path / "labels" / "run_id=r1", tmp_path / "labels" / "run_id=1 or ..")
    (tmp_path / "labels" / "run_id=r3").write_text("no folder")
    assert [run_id for run_id, _ in LabelParts(tmp_path).new()] == ["r1", "r2"]


def test_putting_together_changes_no_word(tmp_path: Path):
    for number in range(5):
        say(tmp_path, number)
    before = read(tmp_path)
    assert not gather(tmp_path, RUN)
    assert gather(tmp_path, RUN, at_least=5)
    assert len(parts(tmp_path)) == 1
    assert read(tmp_path) == before
    assert not gather(tmp_path, RUN, at_least=2)
    assert not gather(tmp_path, "r2", at_least=0)


def test_who_has_read_before_reads_nothing_wrong_afterwards(tmp_path: Path):
    reading = LabelParts(tmp_path)
    for number in range(4):
        say(tmp_path, number)
    list(reading.new())
    gather(tmp_path, RUN, at_least=2)
    say(tmp_path, 4)
    again = {row["merge_id"] for _, rows in reading.new() for row in rows.to_pylist()}
    assert again == {f"a.b.{number}" for number in range(5)}
    assert not reading.unread


def test_while_somebody_else_writes_the_folder_nothing_is_put_together(tmp_path: Path):
    for number in range(3):
        say(tmp_path, number)
    with locked(tmp_path):
        assert not gather(tmp_path, RUN, at_least=2)
        say(tmp_path, 3)  # nobody waits
    assert len(parts(tmp_path)) == 4


def test_a_gathering_that_was_killed_is_finished_by_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Between the journal and the last removal: rows are there twice, and none is missing."""
    for number in range(4):
        say(tmp_path, number)
    before = read(tmp_path)

    class Killed(BaseException):
        pass

    with monkeypatch.context() as patched:
        unlink, left = Path.unlink, [2]

        def dying(path: Path, *, missing_ok: bool = False) -> None:
            if path.name.startswith("part-"):
                if not left[0]:
                    raise Killed
                left[0] -= 1
            unlink(path, missing_ok=missing_ok)

        patched.setattr(Path, "unlink", dying)
        with pytest.raises(Killed):
            gather(tmp_path, RUN, at_least=2)
    assert (tmp_path / JOURNAL).exists() and len(parts(tmp_path)) == 3
    assert {str(word) for word in read(tmp_path)} == {str(word) for word in before}
    say(tmp_path, 4)
    gather(tmp_path, RUN, at_least=2)
    assert not (tmp_path / JOURNAL).exists() and len(parts(tmp_path)) == 1
    assert [row["merge_id"] for _, row in read(tmp_path)] == [f"a.b.{number}" for number in range(5)]


def test_damaged_parts_are_left_alone(tmp_path: Path):
    for number in range(3):
        say(tmp_path, number)
    folder = parts(tmp_path)[0].parent
    for name, content in {"cut": parts(tmp_path)[0].read_bytes()[:-20], "empty": b"", "text": b"hello"}.items():
        (folder / f"part-00000-{name}.parquet").write_bytes(content)
    (folder / "part-00000-folder.parquet").mkdir()
    reading = LabelParts(tmp_path)
    assert sum(len(rows) for _, rows in reading.new()) == 3
    assert sorted(path.name.split("-")[2] for path in reading.unread) == [
        *("cut.parquet", "empty.parquet", "folder.parquet", "text.parquet")
    ]
    assert gather(tmp_path, RUN, at_least=3)
    assert len(read(tmp_path)) == 3 and len(parts(tmp_path)) == 5


def test_columns_of_other_versions(tmp_path: Path):
    """A part that lacks a column is read and put together; one that has more is read and stays."""
    for number in range(3):
        say(tmp_path, number)
    older, newer, _ = parts(tmp_path)
    table = pq.ParquetFile(older).read()
    pq.write_table(table.drop_columns(["elapsed_s"]), older)
    table = pq.ParquetFile(newer).read()
    pq.write_table(table.append_column("mood", pa.array(["good"])), newer)
    assert len(read(tmp_path)) == 3
    assert gather(tmp_path, RUN, at_least=2)
    assert newer in parts(tmp_path) and len(parts(tmp_path)) == 2
    assert len(read(tmp_path)) == 3


def test_a_part_that_claims_too_many_rows_is_not_read(tmp_path: Path):
    say(tmp_path, 0)
    table = pq.ParquetFile(parts(tmp_path)[0]).read()
    names = pa.DictionaryArray.from_arrays(pa.array([0] * (PART_ROWS + 1), pa.int8()), pa.array(["right"]))
    pq.write_table(pa.table({"label": names}), parts(tmp_path)[0].parent / "part-00000-bomb.parquet")
    assert len(table) == len(read(tmp_path)) == 1


def test_a_folder_that_cannot_be_written_stays_as_it_is(tmp_path: Path):
    for number in range(3):
        say(tmp_path, number)
    (tmp_path / ".mapgraft.lock").unlink(missing_ok=True)
    (tmp_path / ".mapgraft.lock").mkdir()
    assert not gather(tmp_path, RUN, at_least=2)
    assert len(read(tmp_path)) == 3


def test_writing_reading_and_putting_together_at_once(tmp_path: Path):
    """Two write, one puts together all the time, one reads: who reads knows all that was written before."""
    written, known, reading = set[str](), set[str](), LabelParts(tmp_path)

    def write(first: int) -> None:
        for number in range(first, first + 40):
            say(tmp_path, number)
            written.add(f"a.b.{number}")

    with ThreadPoolExecutor(3) as pool:
        writing = [pool.submit(write, first) for first in (0, 100)]
        gathering = pool.submit(lambda: sum(gather(tmp_path, RUN, 2) for _ in iter(lambda: len(written) < 80, False)))
        while not all(writer.done() for writer in writing):
            before = set(written)
            known |= {row["merge_id"] for _, rows in reading.new() for row in rows.to_pylist()}
            assert before <= known
        for writer in writing:
            writer.result()
        assert gathering.result() > 2
    assert not reading.unread
    assert {row["merge_id"] for _, row in read(tmp_path)} == written and len(written) == 80


@settings(max_examples=8, deadline=None)
@given(st.lists(st.sampled_from(["anna", "bob", "gather", "read"]), max_size=14))
def test_whoever_writes_reads_and_puts_together_in_any_order(
    tmp_path_factory: pytest.TempPathFactory, steps: list[str]
):
    """Whoever writes, reads and puts together: a reader knows every word, at every moment."""
    out, expected = tmp_path_factory.mktemp("out"), set[str]()
    reading, known = LabelParts(out), set[str]()
    for number, step in enumerate([*steps, "read"]):
        if step == "gather":
            gather(out, RUN, at_least=2)
        elif step == "read":
            known |= {row["merge_id"] for _, rows in reading.new() for row in rows.to_pylist()}
            assert known == expected
        else:
            say(out, number, by=step)
            expected.add(f"a.b.{number}")
    assert len(read(out)) == len(expected) and MANY > 2
