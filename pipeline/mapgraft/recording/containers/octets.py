"""The bytes of a file: all of them in memory, or fetched by ranges from wherever the file is."""

from __future__ import annotations

import mmap
import os
import struct
import tempfile
import threading
from collections.abc import Callable, Iterator
from typing import Any, Protocol, overload

from mapgraft.errors import RecordingError

BLOCK_BYTES = 64 << 10
"""What is fetched begins and ends at multiples of this: small neighbours come with one request."""

Read = Callable[[int, int], bytes]  # begin, end → the bytes between; raises OSError; called from several threads


class Octets(Protocol):
    """The bytes of a file; a memory view is such a thing. Slices are views that stay valid as long as they are held."""

    def __len__(self) -> int: ...
    @overload
    def __getitem__(self, at: int, /) -> int: ...
    @overload
    def __getitem__(self, span: slice, /) -> memoryview: ...


def unpacked(form: struct.Struct, octets: Octets, at: int) -> tuple[Any, ...]:
    """The fields that begin at a place; raises struct.error where the bytes end before them."""
    return form.unpack(octets[at : at + form.size])


class RangedOctets:
    """The bytes of a file elsewhere. Only the blocks that somebody looks at are fetched, and kept.

    They are kept in a file without a name, which is gone when nobody holds a view any more, however the process ends.
    Looking raises RecordingError where the bytes cannot be had, and ``broken`` tells of it from then on, whatever came
    of the error. ``fetched_bytes`` and ``requests`` tell what it cost.
    """

    def __init__(self, name: str, size_bytes: int, read: Read) -> None:
        self._name, self._size, self._read = name, size_bytes, read
        if size_bytes == 0:
            raise RecordingError(f"{name} is empty (0 bytes): nothing was recorded, or the copy failed")
        with tempfile.TemporaryFile(prefix="mapgraft-") as file:
            file.truncate(size_bytes)
            self._view = memoryview(mmap.mmap(file.fileno(), size_bytes, access=mmap.ACCESS_READ))
            self._file = os.dup(file.fileno())
        self._here = bytearray(-(-size_bytes // BLOCK_BYTES))
        self._lock = threading.Lock()
        self.fetched_bytes = self.requests = 0
        self.broken = ""

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, at: int, /) -> int: ...
    @overload
    def __getitem__(self, span: slice, /) -> memoryview: ...
    def __getitem__(self, asked: int | slice, /) -> int | memoryview:
        if isinstance(asked, slice):
            begin, end, _ = asked.indices(self._size)
        else:
            begin = asked + self._size if asked < 0 else asked
            end = begin + 1
        for first, last in self._missing(begin, end):
            self._fetch(first, last)
        return self._view[asked]

    def _missing(self, begin: int, end: int) -> Iterator[tuple[int, int]]:
        """The rows of blocks, from first to before last, that are looked at and not here."""
        block, last = max(begin, 0) // BLOCK_BYTES, -(-min(end, self._size) // BLOCK_BYTES)
        while 0 <= (block := self._here.find(0, block, last)) < last:
            after = self._here.find(1, block, last)
            stop = last if after < 0 else after
            yield block, stop
            block = stop

    def _fetch(self, first: int, last: int) -> None:
        """Two threads may fetch the same block: they write the same bytes."""
        begin, end = first * BLOCK_BYTES, min(last * BLOCK_BYTES, self._size)
        try:
            data = self._read(begin, end)
            if len(data) != end - begin:
                raise OSError(f"{len(data):,} of {end - begin:,} bytes at byte {begin:,} came")
        except OSError as error:
            self.broken = f"{self._name} cannot be read: {error.strerror or error}"
            raise RecordingError(self.broken) from error
        try:
            written = 0
            while written < len(data):  # not by the mapping: a full disk would end the process
                written += os.pwrite(self._file, memoryview(data)[written:], begin + written)
        except OSError as error:
            said = f"{self._name} cannot be kept in {tempfile.gettempdir()} while it is read: {error.strerror or error}"
            self.broken = f"{said}; make room there, or name another folder with TMPDIR"
            raise RecordingError(self.broken) from error
        with self._lock:
            self._here[first:last] = b"\1" * (last - first)
            self.fetched_bytes += len(data)
            self.requests += 1

    def __del__(self) -> None:
        if (file := getattr(self, "_file", None)) is not None:
            os.close(file)
