"""What people say of examples as a CSV file, out and in again."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, get_args

from mapgraft.contracts import Transform
from mapgraft.examples.csv_lines import EPOCH, ITSELF, POSE, Line, lines_of
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
    ``annotator`` where the line names nobody, and "person" where that is empty. Where it tells no time it is said now
    (``clock``), if it is not what its annotator has said last. Raises UsageError for the first line that does not fit,
    and then nothing is added.
    """
    columns = ["run_id", "example_id", "receiver", "donor", "T_receiver_donor"]
    about = {ExampleKey(row["run_id"], row["example_id"]): row for row in folder.rows(columns).to_pylist()}
    timed: list[Word] = []
    untimed: list[Word] = []
    for line in lines_of(path, ("example_id", "label")):
        said_ns = line.said_ns()
        word = _word_of(line, _key_of(line, folder), about, annotator, said_ns or 0)
        (untimed if said_ns is None else timed).append(word)
    there = folder.words()
    known = {_identity(word) for word in there}
    added = list({_identity(word): word for word in timed if _identity(word) not in known}.values())
    now_ns = ((clock or datetime.now(UTC)) - EPOCH) // timedelta(microseconds=1) * 1_000
    added += _said_now(untimed, sorted([*there, *added], key=lambda word: word.said_ns), now_ns)
    for run_id in sorted({word.key.run_id for word in added}):
        rows = [_row_of(word, about[word.key]) for word in added if word.key.run_id == run_id]
        write_rows(folder.path, "labels", run_id, rows_table("labels", rows))
    return len(added), len(timed) + len(untimed) - len(added)


def _identity(word: Word) -> tuple[ExampleKey, str, int, str]:
    return word.key, word.annotator, word.said_ns, word.label


def _said_now(words: Sequence[Word], there: Sequence[Word], now_ns: int) -> list[Word]:
    """Of words without a time those that are new, one nanosecond after the other from ``now_ns``.

    ``there`` is what was said before, in its order. What a file says of one example in several lines is there already
    as far as it is how the annotator's words on that example end.
    """
    said: dict[tuple[ExampleKey, str], list[Word]] = {}
    for word in there:
        said.setdefault((word.key, word.annotator), []).append(word)
    told: dict[tuple[ExampleKey, str], list[Word]] = {}
    for word in words:
        here = told.setdefault((word.key, word.annotator), [])
        if not here or not _says_again(word, here[-1]):
            here.append(word)
    new: list[Word] = []
    for who, here in told.items():
        before = said.get(who, [])
        first_ns = max(now_ns, before[-1].said_ns + 1 if before else now_ns)  # their clock may be ahead of ours
        new += [replace(word, said_ns=first_ns + n) for n, word in enumerate(here[_ends_with(before, here) :])]
    return new


def _ends_with(before: Sequence[Word], here: Sequence[Word]) -> int:
    """How many of the first words of ``here`` are the last words of ``before``; the most that are."""
    for count in range(min(len(before), len(here)), 0, -1):
        if all(map(_says_again, here[:count], before[len(before) - count :])):
            return count
    return 0


def _says_again(word: Word, before: Word) -> bool:
    """Whether a word says nothing that ``before``, of the same annotator on the same example, has not said."""
    T, T_before = word.T_receiver_donor, before.T_receiver_donor
    if word.label != before.label or word.comment != before.comment or not before.is_about(word.T_judged):
        return False
    if T is None or T_before is None:
        return T is T_before
    return max(T.difference(T_before)) < ITSELF


def _key_of(line: Line, folder: ExampleFolder) -> ExampleKey:
    example_id, run_id = line.text("example_id"), line.text("run_id")
    here = sorted({key.run_id for key in folder.keys})
    if run_id and run_id not in here:
        raise line.fault(f"{folder.path} holds {_listed(here)}, not {run_id}: name the folder of that run")
    found = [key for one in ([run_id] if run_id else here) if (key := ExampleKey(one, example_id)) in folder]
    if not found:
        raise line.fault(f"{folder.path} has no example {example_id!r}" + (f" of the run {run_id}" if run_id else ""))
    if len(found) > 1:
        raise line.fault(f"{folder.path} has an example {example_id!r} of {len(found)} runs: name the run_id")
    return found[0]


def _listed(runs: Sequence[str]) -> str:
    return f"the run {runs[0]}" if len(runs) == 1 else f"{len(runs)} runs ({', '.join(runs[:3])}, …)"


def _word_of(
    line: Line, key: ExampleKey, about: Mapping[ExampleKey, Mapping[str, Any]], annotator: str, said_ns: int
) -> Word:
    label = line.label()
    if label not in get_args(Verdict):
        raise line.fault(f"a label is one of {', '.join(get_args(Verdict))}, found {line.text('label')!r}")
    judged = line.transform("judged_") or transform_of(about[key]["T_receiver_donor"])
    held = line.transform() or (judged if label == "right" else None)
    by = line.text("annotator") or annotator or NOBODY_NAMED
    return Word(key, label, by, judged, held, line.text("comment"), said_ns, line.number_of("elapsed_s"))


def _row_of(word: Word, about: Mapping[str, Any]) -> Row:
    return {
        "merge_id": about["example_id"],
        "receiver": about["receiver"],
        "donor": about["donor"],
        "label": word.label,
        "annotator": word.annotator,
        "T_receiver_donor_judged": None if word.T_judged is None else word.T_judged.matrix,
        "T_receiver_donor": None if word.T_receiver_donor is None else word.T_receiver_donor.matrix,
        "comment": word.comment,
        "labelled_at": word.said_ns,
        "elapsed_s": word.elapsed_s,
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
