"""The lines of a CSV file about examples: what their cells hold, and which line it is when they do not fit."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from mapgraft.contracts import Transform
from mapgraft.errors import TransformError, UsageError

POSE: Final = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
MOST_BYTES: Final = 256 << 20  # about half a million words
ITSELF: Final = 1e-6  # m and rad; a transform that was written down and read again is off by less
EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_TIME: Final = re.compile(r"([^.,]+?)(?:[.,]([0-9]+))?(Z|[+-][0-9]{2}(?::?[0-9]{2})?)?")


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One line of a CSV file: the values of its cells by column, empty ones left out."""

    number: int
    cells: Mapping[str, str]
    path: Path

    def fault(self, said: str) -> UsageError:
        return UsageError(f"{self.path}, line {self.number}: {said}")

    def text(self, name: str, default: str = "") -> str:
        return self.cells.get(name, default)

    def label(self) -> str:
        """What is said, in small letters: spreadsheets like to begin cells with a capital."""
        return self.text("label").lower()

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
        told = {name: self.number_of(f"{prefix}{name}") for name in (*POSE, "yaw_rad")}
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

    def said_ns(self) -> int | None:
        """When it was said, in nanoseconds since 1970: UTC where no zone is told, None where no time is.

        Raises UsageError for anything else that is not empty.
        """
        if (text := self.text("labelled_at")) == "":
            return None
        try:
            whole, fraction, zone = found.groups("") if (found := _TIME.fullmatch(text)) else ("", "", "")
            said = datetime.fromisoformat(whole + zone)
            since = (said if said.tzinfo else said.replace(tzinfo=UTC)) - EPOCH
        except (ValueError, OverflowError):
            since, fraction = timedelta.max, ""
        stamp_ns = since // timedelta(seconds=1) * 1_000_000_000 + int(f"{fraction:0<9}"[:9])
        if abs(stamp_ns) >= 1 << 63:
            raise self.fault(
                f"labelled_at is a time like 2026-03-01T12:00:00Z or 2026-03-01T14:00:00+02:00, found {text!r}"
            )
        return stamp_ns


def lines_of(path: Path, needed: Iterable[str]) -> Iterator[Line]:
    """The lines of a CSV file with a header; raises UsageError when it has not the columns that are needed."""
    reader = csv.reader(io.StringIO(_text(path), newline=""))
    try:
        header = [name.strip() for name in next(reader, [])]
        if missing := [name for name in needed if name not in header]:
            found = ", ".join(header)[:200] or "nothing"
            hint = "; values are separated by commas" if len(header) == 1 and re.search(r"[;\t]", found) else ""
            raise UsageError(
                f"{path} has no column {', '.join(missing)}: the first line names the columns, found {found}{hint}"
            )
        for cells in reader:
            if len(cells) > len(header):
                raise UsageError(f"{path}, line {reader.line_num}: more values than the first line names columns")
            filled = {name: cell.strip() for name, cell in zip(header, cells, strict=False) if cell.strip()}
            if filled:
                yield Line(reader.line_num, filled, path)
    except csv.Error as error:
        raise UsageError(f"{path}, line {reader.line_num}: {error}") from None


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise UsageError(f"{path} has more than {MOST_BYTES:,} bytes: cut it into several files")
        return path.read_bytes().decode("utf-8-sig")  # as spreadsheets write it
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from None
