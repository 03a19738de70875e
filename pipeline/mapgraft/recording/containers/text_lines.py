"""Lines of text files, plain or gzipped, without ever holding a whole file."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast

from mapgraft.contracts.sources import ReadFaults
from mapgraft.errors import RecordingError

GZIP_MAGIC = b"\x1f\x8b"
LONGEST_LINE_BYTES = 1 << 20

_MOST_NS = 2**63 - 1


class Line(NamedTuple):
    """One line without its end, counted from 1."""

    number: int
    text: bytes


def lines(path: Path, faults: ReadFaults) -> Iterator[Line]:
    """The lines of a file that are not empty; a gzip file that is cut off gives what it has, and a fault.

    Raises RecordingError when the file cannot be read at all.
    """
    number = 0
    try:
        with open_text(path) as file:
            while text := file.readline(LONGEST_LINE_BYTES):
                number += 1
                if not text.endswith(b"\n") and len(text) >= LONGEST_LINE_BYTES:
                    _skip_line(file)
                    faults.add("line_unreadable", f"line {number} of {path.name} has no end", place=number)
                elif stripped := text.strip():
                    yield Line(number, stripped)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        faults.add("cut_off", f"{path.name} was cut off or damaged after line {number} ({error})", place=0)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error


def open_text(path: Path) -> BinaryIO:
    """Open a file for reading lines of bytes, unpacking gzip."""
    with path.open("rb") as file:
        packed = file.read(len(GZIP_MAGIC)) == GZIP_MAGIC
    return cast(BinaryIO, gzip.open(path, "rb")) if packed else path.open("rb")


def _skip_line(file: BinaryIO) -> None:
    while (text := file.readline(LONGEST_LINE_BYTES)) and not text.endswith(b"\n"):
        pass


def seconds_to_ns(text: bytes) -> int:
    """Nanoseconds of a decimal number of seconds, exactly; raises ValueError when it is none, or out of range."""
    try:
        ns = int((Decimal(text.decode("ascii")) * 10**9).to_integral_value())
    except (InvalidOperation, UnicodeDecodeError, OverflowError, ValueError) as error:
        raise ValueError(f"{text[:40]!r} is not a time in seconds") from error
    if abs(ns) > _MOST_NS:
        raise ValueError(f"{text[:40]!r} is not a time in seconds")
    return ns
