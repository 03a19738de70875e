"""One writer at a time: the lock of an output folder."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mapgraft.errors import OutputError
from mapgraft.outputs.staging import writing

LOCK = ".mapgraft.lock"
RUN, EXPERIMENT = "summary.json", "experiment.json"  # who finds one of them finds everything that goes with it
_HOLDS = {RUN: "a run", EXPERIMENT: "an experiment"}


def require_kind(out: Path, kind: str) -> None:
    """Raises OutputError where the folder holds something of another kind, whose page would be overwritten."""
    for name, what in _HOLDS.items():
        if name != kind and (out / name).is_file():
            raise OutputError(f"{out} holds {what}: choose another folder")


def lock(out: Path) -> int:
    """An open descriptor that holds the folder's lock; closing it, or dying, gives it back.

    Raises OutputError when somebody else holds it, OSError when the folder cannot be written.
    """
    descriptor = os.open(out / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise OutputError(f"{out} is being written by another run: wait for it or choose another folder") from None
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """The folder, made if it is not there, is ours inside.

    Raises OutputError when it cannot be written, or when somebody else is writing it.
    """
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        descriptor = lock(out)
    try:
        yield
    finally:
        os.close(descriptor)
