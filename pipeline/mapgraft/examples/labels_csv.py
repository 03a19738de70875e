"""What people say of examples as a CSV file, out and in again, and as the truth about how maps lie to each other."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, get_args

from mapgraft.contracts import Transform
from mapgraft.errors import TransformError, UsageError
from mapgraft.examples.reading import ExampleFolder, ExampleKey, Word, transform_of
from mapgraft.examples.truths import GIVEN, Known
from mapgraft.outputs.labels import NOBODY_NAMED, Verdict
from mapgraft.outputs.parquet_log import write_rows
from mapgraft.outputs.tables import Row, rows_table

_POSE: Final = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
COLUMNS: Final = (
    *("run_id", "example_id", "environment", "recording", "receiver", "donor", "annotator", "label"),
    *("comment", "labelled_at", "elapsed_s", "scale", *_POSE, *(f"judged_{name}" for name in _POSE)),
)
MOST_BYTES: Final = 256 << 20  # about half a million words
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
SAME_M, SAME_RAD = 0.5, math.radians(5.0)  # persons who differ by more mean different places


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """One line of a CSV file: the values of its cells by column, empty ones left out."""

    number: int
    cells: Mapping[str, str]
    path: Path

    def fault(self, said: str) -> UsageError:
        return UsageError(f"{self.path}, line {self.number}: {said}")

    def text(self, name: str, default: str = "") -> str:
        return self.cells.get(name, default)

    def number_of(self, name: str) -> float | None:
        """A finite number; raises UsageError for anything else that is not empty."""
        if (text := self.text(name)) == "":
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.fault(f"{name} is a finite number, found {text!r}")
        return value

    def transform(self, prefix: str = "") -> Transform | None:
        """A pose as ``x_m``, ``y_m`` and a quaternion or ``yaw_rad``; None where all are empty."""
        told = {name: self.number_of(f"{prefix}{name}") for name in (*_POSE, "yaw_rad")}
        x_m, y_m = told["x_m"], told["y_m"]
        if all(value is None for value in told.values()):
            return None
        q = [told[name] for name in ("qx", "qy", "qz", "qw")]
        if x_m is None or y_m is None or (told["yaw_rad"] is None and None in q):
            raise self.fault(f"a pose is {prefix}x_m, {prefix}y_m and {prefix}yaw_rad, or a whole quaternion")
        xyz_m = (x_m, y_m, told["z_m"] or 0.0)
        if None in q:
            return Transform.planar(x_m, y_m, told["yaw_rad"] or 0.0)
        try:
            qx, qy, qz, qw = (value or 0.0 for value in q)
            return Transform.from_quaternion(xyz_m, (qx, qy, qz, qw))
        except TransformError as error:
            raise self.fault(str(error)) from None


def exported(folders: Sequence[ExampleFolder], *, everything: bool = False) -> tuple[str, int]:
    """The last words of all annotators on the examples of some folders as CSV, or ``everything`` that was ever said.

    With the number of words.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    count = 0
    for folder in folders:
        columns = ["run_id", "example_id", "environment", "recording", "receiver", "donor", "scale"]
        about = {ExampleKey(row["run_id"], row["example_id"]): row for row in folder.rows(columns).to_pylist()}
        words = folder.words() if everything else folder.labels().values()
        for word in sorted(words, key=lambda word: (word.key, word.annotator, word.said_ns)):
            writer.writerow(_cells(word, about[word.key]))
            count += 1
    return stream.getvalue(), count


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
    for line in _lines(path, ("example_id", "label")):
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


def robots_truth(path: Path, recordings: Mapping[str, str] | None = None) -> dict[tuple[str, str], Known]:
    """By (receiver, donor), where persons hold the donor's map to lie, from a file that ``exported`` has written.

    ``recordings`` are the stems of the robots' recordings: lines of other recordings are left out. Raises UsageError
    where lines about one pair contradict each other.
    """
    told: dict[tuple[str, str], list[tuple[_Line, Known]]] = {}
    for line, known in _truths(path, ("receiver", "donor", "label")):
        pair = line.text("receiver"), line.text("donor")
        if recordings is not None and (recorded := line.text("recording")):
            if pair[0] not in recordings or pair[1] not in recordings:
                continue
            if recorded != "+".join(sorted({recordings[pair[0]], recordings[pair[1]]})):
                continue
        told.setdefault(pair, []).append((line, known))
    return {pair: _agreed(given) for pair, given in told.items()}


def examples_truth(path: Path, run_id: str) -> dict[str, Known]:
    """By example of one run or evaluation, where persons hold the donor's map to lie; raises as ``robots_truth``."""
    told: dict[str, list[tuple[_Line, Known]]] = {}
    for line, known in _truths(path, ("example_id", "label")):
        if line.text("run_id") == run_id:
            told.setdefault(line.text("example_id"), []).append((line, known))
    return {example_id: _agreed(given) for example_id, given in told.items()}


def _truths(path: Path, needed: Iterable[str]) -> Iterator[tuple[_Line, Known]]:
    """The lines that tell a transform which somebody holds for right: confirmed, or put right."""
    for line in _lines(path, needed):
        T = line.transform()
        if T is not None and line.text("label") in ("right", "wrong"):
            yield line, Known(T, GIVEN, line.number_of("scale") or 1.0)


def _agreed(given: Sequence[tuple[_Line, Known]]) -> Known:
    """Of several transforms that mean one place the one in their middle, by the sum of its distances to the others."""
    first = given[0]
    for line, known in given[1:]:
        shift_m, turn_rad = _apart(first[1], known)
        if shift_m > SAME_M or turn_rad > SAME_RAD:
            raise line.fault(
                f"this transform lies {shift_m:.2f} m and {math.degrees(turn_rad):.1f}° from that of line "
                f"{first[0].number} about the same maps: decide which of the two is right, and take the other out"
            )
    sums = [math.fsum(shift_m + turn_rad for shift_m, turn_rad in (_apart(a, b) for _, b in given)) for _, a in given]
    return given[sums.index(min(sums))][1]


def _apart(a: Known, b: Known) -> tuple[float, float]:
    assert a.T_receiver_donor is not None and b.T_receiver_donor is not None
    shift_m, turn_rad = a.T_receiver_donor.difference(b.T_receiver_donor)
    return shift_m, abs(turn_rad)


def _lines(path: Path, needed: Iterable[str]) -> Iterator[_Line]:
    """The lines of a CSV file with a header; raises UsageError when it has not the columns that are needed."""
    reader = csv.reader(io.StringIO(_text(path), newline=""))
    try:
        header = [name.strip() for name in next(reader, [])]
        if missing := [name for name in needed if name not in header]:
            raise UsageError(
                f"{path} has no column {', '.join(missing)}: the first line names the columns, found "
                f"{', '.join(header)[:200] or 'nothing'}"
            )
        for cells in reader:
            if len(cells) > len(header):
                raise UsageError(f"{path}, line {reader.line_num}: more values than the first line names columns")
            filled = {name: cell.strip() for name, cell in zip(header, cells, strict=False) if cell.strip()}
            if filled:
                yield _Line(reader.line_num, filled, path)
    except csv.Error as error:
        raise UsageError(f"{path}, line {reader.line_num}: {error}") from None


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise UsageError(f"{path} has more than {MOST_BYTES:,} bytes: cut it into several files")
        return path.read_bytes().decode("utf-8-sig")  # as spreadsheets write it
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from None


def _key_of(line: _Line, folder: ExampleFolder) -> ExampleKey:
    example_id, run_id = line.text("example_id"), line.text("run_id")
    runs = {run_id} if run_id else {key.run_id for key in folder.keys}
    found = [key for one in sorted(runs) if (key := ExampleKey(one, example_id)) in folder]
    if len(found) != 1:
        why = "none" if not found else f"{len(found)} runs have it: name the run_id"
        raise line.fault(f"{folder.path} has no single example {example_id!r} of run {run_id or '(any)'}: {why}")
    return found[0]


def _row_of(line: _Line, about: Mapping[str, Any], annotator: str, now: datetime) -> dict[str, Any]:
    label = line.text("label")
    if label not in get_args(Verdict):
        raise line.fault(f"a label is one of {', '.join(get_args(Verdict))}, found {label!r}")
    judged = line.transform("judged_") or transform_of(about["T_receiver_donor"])
    held = line.transform() or (judged if label == "right" else None)
    return {
        "merge_id": about["example_id"],
        "receiver": about["receiver"],
        "donor": about["donor"],
        "label": label,
        "annotator": line.text("annotator") or annotator or NOBODY_NAMED,
        "T_receiver_donor_judged": None if judged is None else judged.matrix,
        "T_receiver_donor": None if held is None else held.matrix,
        "comment": line.text("comment"),
        "labelled_at": _stamp_of(line, now),
        "elapsed_s": line.number_of("elapsed_s"),
    }


def _stamp_of(line: _Line, now: datetime) -> int:
    """When it was said, in nanoseconds."""
    said, nanoseconds = now, 0
    if text := line.text("labelled_at"):
        whole, _, fraction = text.removesuffix("Z").partition(".")
        try:
            nanoseconds = int(f"{fraction:0<9}"[:9] or "0")
            said = datetime.fromisoformat(whole).replace(tzinfo=UTC)
        except ValueError:
            raise line.fault(f"labelled_at is a time like 2026-03-01T12:00:00Z (UTC), found {text!r}") from None
        return (said - _EPOCH) // timedelta(seconds=1) * 1_000_000_000 + nanoseconds
    return (said - _EPOCH) // timedelta(microseconds=1) * 1_000


def _cells(word: Word, about: Mapping[str, Any]) -> list[str]:
    seconds, nanoseconds = divmod(word.said_ns, 1_000_000_000)
    said = (_EPOCH + timedelta(seconds=seconds)).strftime("%Y-%m-%dT%H:%M:%S")
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
        return [""] * len(_POSE)
    return [repr(round(float(value), 12) + 0.0) for value in (T.x_m, T.y_m, T.z_m, *T.quaternion_xyzw())]  # no -0.0
