"""Writing a folder so that nobody ever sees half of a file: ``.partial`` names, fsync, atomic rename."""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from mapgraft.errors import OutputError

SUFFIX = ".partial"
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_REFUSED = (errno.EACCES, errno.EPERM, errno.EROFS)


@contextmanager
def writing(out: Path) -> Iterator[None]:
    """Turns what the operating system refuses inside into an OutputError of one sentence about the folder ``out``."""
    try:
        yield
    except OSError as error:
        raise OutputError(_sentence(out, error)) from error


class Staging:
    """The files of one run in one folder: written under ``.partial`` names, renamed together when all are whole.

    Methods raise OSError; put them inside ``writing``.
    """

    def __init__(self, out: Path) -> None:
        self._out = out
        self._final: dict[str, str] = {}  # name while partial → final name, relative to the folder

    def create(self, name: str) -> BinaryIO:
        """A new file, opened for writing, that will be called ``name`` (relative, with '/')."""
        path = self.partial(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        stream = path.open("wb")
        self._final[name] = name
        return stream

    def write(self, name: str, data: bytes) -> None:
        """A whole file at once, on disk when this returns."""
        with self.create(name) as stream:
            stream.write(data)
            sync(stream)

    def partial(self, name: str) -> Path:
        """Where the file is until it is published."""
        return self._out / (name + SUFFIX)

    def call(self, name: str, final: str) -> None:
        """Give a file that was created as ``name`` another final name, in the same folder."""
        self._final[name] = final

    @property
    def names(self) -> list[str]:
        """Final names of all files so far, sorted."""
        return sorted(self._final.values())

    def publish(self) -> list[str]:
        """Rename all files to their final names; they must be closed and on disk. Returns the names, sorted."""
        for name, final in self._final.items():
            os.replace(self.partial(name), self._out / final)  # noqa: PTH105 (says what it does: atomic)
        for folder in sorted({(self._out / final).parent for final in self._final.values()}):
            sync_folder(folder)
        published = self.names
        self._final.clear()
        return published


def sync(stream: BinaryIO) -> None:
    """Everything written so far is on disk when this returns."""
    stream.flush()
    os.fsync(stream.fileno())


def close_quietly(stream: BinaryIO) -> None:
    """Close a file that could not be written, also where its last bytes cannot be written either."""
    with suppress(OSError):
        stream.close()


def sync_folder(folder: Path) -> None:
    """Renames and removals in the folder are on disk when this returns."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sha256_of(path: Path) -> str:
    """The digest of a file's bytes in hex, read in pieces."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _sentence(out: Path, error: OSError) -> str:
    where = f"{out} ({error.filename})" if error.filename and str(error.filename) != str(out) else str(out)
    if error.errno in _FULL:
        return f"{where} cannot be written because the disk or the quota is full: make room and run again"
    if error.errno in _REFUSED:
        return f"{where} cannot be written because it is read-only for this user: choose another output folder"
    if error.errno in (errno.ENOTDIR, errno.EEXIST, errno.EISDIR):
        return f"{where} cannot be written because a file or folder of that name is in the way: choose another folder"
    return f"{where} cannot be written: {error.strerror or error}"
