"""Lines of text files, plain or gzipped, without ever holding a whole file."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from decimal import Decimal
from io import BufferedIOBase
from pathlib import Path
from typing import NamedTuple

from mapgraft.contracts.sources import ReadFaults
from mapgraft.errors import RecordingError
from mapgraft.recording.containers.limits import DEFAULT_LIMITS, ReadLimits

GZIP_MAGIC = b"\x1f\x8b"
LONGEST_LINE_BYTES = 1 << 20
_BLOCK_BYTES = 1 << 18

_MOST_NS = 2**63 - 1
_MOST_DIGITS = 20  # of the whole seconds; a few bytes may say a million


class Line(NamedTuple):
    """One line without its end, counted from 1."""

    number: int
    text: bytes


def lines(path: Path, faults: ReadFaults, limits: ReadLimits = DEFAULT_LIMITS) -> Iterator[Line]:
    """The lines of a file that are not empty; a gzip file that is cut off gives what it has, and a fault.

    One that unpacks to more than the limits allow gives that much. Raises RecordingError when the file cannot be read
    at all.
    """
    number = 0
    try:
        with open_text(path) as file:
            most = limits.text_bytes(path.stat().st_size) if isinstance(file, gzip.GzipFile) else None
            for number, text in _split(file, most):
                if text is None:
                    sentence = f"{path.name} unpacks to more than {most:,} bytes: raise limits.expansion if it may"
                    faults.add("unpacks_too_far", f"{sentence}; it is left out from line {number} on", place=0)
                elif len(text) >= LONGEST_LINE_BYTES:
                    faults.add("line_unreadable", f"line {number} of {path.name} has no end", place=number)
                elif stripped := text.strip():
                    yield Line(number, stripped)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        faults.add("cut_off", f"{path.name} was cut off or damaged after line {number} ({error})", place=0)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error


def _split(file: BufferedIOBase, most: int | None) -> Iterator[tuple[int, bytes | None]]:
    """The lines of a file with their numbers, of those that are too long no more than shows it; then, if there is more
    than ``most`` bytes, None.
    """
    number, read, rest = 1, 0, b""
    while block := file.read1(_BLOCK_BYTES):
        read += len(block)
        if most is not None and read > most:
            yield number, None
            return
        if not rest and not block.strip(b"\n"):  # nothing but ends of lines
            number += len(block)
            continue
        first, *others = block.split(b"\n")
        rest = (rest + first)[:LONGEST_LINE_BYTES]
        if others:
            *others, last = rest, *others
            for text in others:
                yield number, text
                number += 1
            rest = last
    if rest:
        yield number, rest


def open_text(path: Path) -> BufferedIOBase:
    """Open a file for reading lines of bytes, unpacking gzip."""
    return gzip.open(path, "rb") if is_packed(path) else path.open("rb")


def is_packed(path: Path) -> bool:
    """Whether a file is compressed by gzip."""
    with path.open("rb") as file:
        return file.read(len(GZIP_MAGIC)) == GZIP_MAGIC


def seconds_to_ns(text: bytes) -> int:
    """Nanoseconds of a decimal number of seconds, exactly; raises ValueError when it is none, or out of range."""
    try:
        seconds = Decimal(text.decode("ascii"))
        if seconds and seconds.adjusted() > _MOST_DIGITS:
            raise ValueError("out of range")
        ns = int((seconds * 10**9).to_integral_value()) if seconds else 0
    except (ArithmeticError, ValueError) as error:
        raise ValueError(f"{text[:40]!r} is not a time in seconds") from error
    if abs(ns) > _MOST_NS:
        raise ValueError(f"{text[:40]!r} is not a time in seconds")
    return ns
