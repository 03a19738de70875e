"""What people say of examples as a CSV file, out and in again."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, get_args

from mapgraft.contracts import Transform
from mapgraft.examples.csv_lines import EPOCH, POSE, Line, lines_of
from mapgraft.examples.reading import ExampleFolder, ExampleKey, Word, all_words, last_words_on, transform_of
from mapgraft.outputs.labels import NOBODY_NAMED, Verdict
from mapgraft.outputs.parquet_log import write_rows
from mapgraft.outputs.tables import Row, rows_table

COLUMNS: Final = (
    *("run_id", "example_id", "environment", "recording", "receiver", "donor", "annotator", "label"),
    *("comment", "labelled_at", "elapsed_s", "scale", *POSE, *(f"judged_{name}" for name in POSE)),
)


def exported(folders: Sequence[ExampleFolder], *, everything: bool = False) -> tuple[str, int]:
    """The last words of all annotators on the examples of some folders as CSV, or ``everything`` that was ever said.

    With the number of words. What several folders hold of one example is put together.
    """
    columns = ["run_id", "example_id", "environment", "recording", "receiver", "donor", "scale"]
    about: dict[ExampleKey, Mapping[str, Any]] = {}
    for folder in reversed(folders):
        about |= {ExampleKey(row["run_id"], row["example_id"]): row for row in folder.rows(columns).to_pylist()}
    words = all_words(folders) if everything else last_words_on(folders).values()
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(
        _cells(word, about[word.key])
        for word in sorted(words, key=lambda word: (word.key, word.annotator, word.said_ns))
    )
    return stream.getvalue(), len(words)


def imported(folder: ExampleFolder, path: Path, annotator: str = "", clock: datetime | None = None) -> tuple[int, int]:
    """Add what a CSV file says to the labels of a folder; how many words were added, and how many were there before.

    A line needs ``example_id`` and ``label``, and ``run_id`` where the folder has several runs; who says it is
    ``annotator`` where the line names nobody, and it is said now (``clock``) where it tells no time. Raises UsageError
    for the first line that does not fit, and then nothing is added.
    """
    now = clock or datetime.now(UTC)
    known = {(word.key, word.annotator, word.said_ns, word.label) for word in folder.words()}
    columns = ["run_id", "example_id", "receiver", "donor", "T_receiver_donor"]
    about = {ExampleKey(row["run_id"], row["example_id"]): row for row in folder.rows(columns).to_pylist()}
    rows: dict[str, list[Row]] = {}
    count = before = 0
    for line in lines_of(path, ("example_id", "label")):
        key = _key_of(line, folder)
        row = _row_of(line, about[key], annotator, now)
        if (key, row["annotator"], row["labelled_at"], row["label"]) in known:
            before += 1
            continue
        rows.setdefault(key.run_id, []).append(row)
        count += 1
    for run_id in sorted(rows):
        write_rows(folder.path, "labels", run_id, rows_table("labels", rows[run_id]))
    return count, before


def _key_of(line: Line, folder: ExampleFolder) -> ExampleKey:
    example_id, run_id = line.text("example_id"), line.text("run_id")
    runs = {run_id} if run_id else {key.run_id for key in folder.keys}
    found = [key for one in sorted(runs) if (key := ExampleKey(one, example_id)) in folder]
    if len(found) != 1:
        why = "none" if not found else f"{len(found)} runs have it: name the run_id"
        raise line.fault(f"{folder.path} has no single example {example_id!r} of run {run_id or '(any)'}: {why}")
    return found[0]


def _row_of(line: Line, about: Mapping[str, Any], annotator: str, now: datetime) -> dict[str, Any]:
    label = line.text("label")
    if label not in get_args(Verdict):
        raise line.fault(f"a label is one of {', '.join(get_args(Verdict))}, found {label!r}")
    judged = line.transform("judged_") or transform_of(about["T_receiver_donor"])
    held = line.transform() or (judged if label == "right" else None)
    said_ns = line.said_ns()
    return {
        "merge_id": about["example_id"],
        "receiver": about["receiver"],
        "donor": about["donor"],
        "label": label,
        "annotator": line.text("annotator") or annotator or NOBODY_NAMED,
        "T_receiver_donor_judged": None if judged is None else judged.matrix,
        "T_receiver_donor": None if held is None else held.matrix,
        "comment": line.text("comment"),
        "labelled_at": (now - EPOCH) // timedelta(microseconds=1) * 1_000 if said_ns is None else said_ns,
        "elapsed_s": line.number_of("elapsed_s"),
    }


def _cells(word: Word, about: Mapping[str, Any]) -> list[str]:
    seconds, nanoseconds = divmod(word.said_ns, 1_000_000_000)
    said = (EPOCH + timedelta(seconds=seconds)).strftime("%Y-%m-%dT%H:%M:%S")
    plain = [about[name] for name in ("environment", "recording", "receiver", "donor")]
    elapsed = "" if word.elapsed_s is None else repr(word.elapsed_s)
    return [
        *(*word.key, *plain, word.annotator, word.label, word.comment),
        *(f"{said}.{nanoseconds:09d}Z", elapsed, repr(about["scale"])),
        *_pose(word.T_receiver_donor),
        *_pose(word.T_judged),
    ]


def _pose(T: Transform | None) -> list[str]:
    if T is None:
        return [""] * len(POSE)
    return [repr(round(float(value), 12) + 0.0) for value in (T.x_m, T.y_m, T.z_m, *T.quaternion_xyzw())]  # no -0.0
