"""A process that dies in the middle of its n-th step of writing a folder: half of the bytes of a write are there.

Everything that a program does to the files below a folder through ``pathlib`` and ``os`` is one step: a write to a
file, a sync, a rename, a removal. A death in a write comes after the first half of its bytes has gone to the operating
system, one in another step before that is done. So it is certain where the process was, which no signal from outside
can tell.
"""

from __future__ import annotations

import io
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

WRITE, SYNC, RENAME, REMOVE = "write", "sync", "rename", "remove"


class Steps:
    """Counts steps, remembers of which kind they were and on which file, and dies in the one that it is told."""

    def __init__(self, folder: Path, fatal: int | None) -> None:
        self.folder, self.fatal = folder.resolve(), fatal
        self.kinds: list[str] = []
        self.names: list[str] = []

    def take(self, kind: str, path: object) -> bool:
        """One more step; whether it is the last one."""
        self.kinds.append(kind)
        self.names.append(str(path))
        return len(self.kinds) - 1 == self.fatal

    def concern(self, path: object) -> bool:
        if not isinstance(path, str | os.PathLike):
            return False
        return Path(os.path.abspath(os.fsdecode(path))).is_relative_to(self.folder)  # noqa: PTH100 (the file may be gone)


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


class Torn:
    """A binary file that is open for writing."""

    def __init__(self, stream: Any, steps: Steps, path: object) -> None:
        self._stream, self._steps, self._path = stream, steps, path

    def write(self, data: Any) -> int:
        if self._steps.take(WRITE, self._path):
            view = memoryview(data).cast("B") if not isinstance(data, str) else data
            self._stream.write(view[: len(view) // 2])
            self._stream.flush()
            die()
        return int(self._stream.write(data))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def __enter__(self) -> Torn:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()


@contextmanager
def counted(folder: Path, fatal: int | None = None) -> Iterator[Steps]:
    """What is done to the files below the folder inside is counted; step number ``fatal`` (from 0) is the last one."""
    steps, real = Steps(folder, fatal), (io.open, os.fsync, os.replace, os.unlink)

    def open_(file: Any, mode: str = "r", *more: Any, **named: Any) -> Any:
        stream = real[0](file, mode, *more, **named)
        return Torn(stream, steps, file) if set(mode) & set("wax+") and steps.concern(file) else stream

    def fsync(descriptor: int) -> None:
        if steps.concern(path := Path(f"/proc/self/fd/{descriptor}").readlink()) and steps.take(SYNC, path):
            die()
        real[1](descriptor)

    def replace(source: Any, target: Any, **named: Any) -> None:
        if steps.concern(target) and steps.take(RENAME, target):
            die()
        real[2](source, target, **named)

    def unlink(path: Any, **named: Any) -> None:
        if steps.concern(path) and steps.take(REMOVE, path):
            die()
        real[3](path, **named)

    io.open, os.fsync, os.replace, os.unlink = open_, fsync, replace, unlink
    try:
        yield steps
    finally:
        io.open, os.fsync, os.replace, os.unlink = real
