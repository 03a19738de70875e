"""One writer at a time: the lock of an output folder."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mapgraft.errors import OutputError
from mapgraft.outputs.staging import JOURNAL, settle, writing

LOCK = ".mapgraft.lock"
RUN, EXPERIMENT = "summary.json", "experiment.json"  # who finds one of them finds everything that goes with it
CORPUS = "corpus.json"
_HOLDS = {RUN: "a run", EXPERIMENT: "an experiment", CORPUS: "a corpus"}


def require_kind(out: Path, kind: str) -> None:
    """Raises OutputError where the folder holds something of another kind, whose files would be mixed up."""
    for name, what in _HOLDS.items():
        if name != kind and (out / name).is_file():
            raise OutputError(f"{out} holds {what}: choose another folder")


def lock(out: Path) -> int:
    """An open descriptor that holds the folder's lock; closing it, or dying, gives it back.

    What a killed process had begun to publish is published first. Raises OutputError when somebody else holds the lock,
    OSError when the folder cannot be written.
    """
    descriptor = os.open(out / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        settle(out)
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


def settled(out: Path) -> None:
    """See to it that what is read in a folder belongs together, for those who only read.

    Raises OutputError when somebody is writing it just now, or when what a killed process had begun to publish cannot
    be published.
    """
    if (out / JOURNAL).exists():
        with locked(out):
            pass
