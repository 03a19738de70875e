"""One writer at a time: the lock of an output folder."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from mapgraft.errors import OutputError
from mapgraft.outputs.staging import JOURNAL, settle, writing

LOCK = ".mapgraft.lock"
RUN, EXPERIMENT, CORPUS, DATASET = "summary.json", "experiment.json", "corpus.json", "dataset.json"
CALIBRATION = "calibration.json"
"""Who finds one of them finds everything that goes with it."""

_OPENED = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK  # no link is followed, no pipe waited for
_HOLDS = {
    RUN: "a run",
    EXPERIMENT: "an experiment",
    CORPUS: "a corpus",
    DATASET: "a dataset",
    CALIBRATION: "a calibration",
}


def require_kind(out: Path, kind: str) -> None:
    """Raises OutputError where the folder holds something of another kind, whose files would be mixed up."""
    for name, what in _HOLDS.items():
        if name != kind and (out / name).is_file():
            raise OutputError(f"{out} holds {what}: choose another folder")


class FolderLock:
    """The lock of one folder; dying gives it back, too."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._held: BinaryIO | None = None

    def take(self) -> None:
        """What a killed process had begun to publish is published first.

        Raises OutputError when somebody else holds the lock, or when what was begun leads out of the folder, OSError
        when the folder cannot be written; then, and when anything else comes through, nothing is held.
        """
        try:
            self._held = os.fdopen(os.open(self._out / LOCK, _OPENED, 0o666), "ab")
            fcntl.flock(self._held.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            settle(self._out)
        except BlockingIOError:
            self.give_back()
            said = f"{self._out} is being written by another run: wait for it or choose another folder"
            raise OutputError(said) from None
        except BaseException:
            self.give_back()
            raise

    def give_back(self) -> None:
        """Does nothing where it is not held."""
        if self._held is not None:
            self._held.close()


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """The folder, made if it is not there, is ours inside.

    Raises OutputError when it cannot be written, or when somebody else is writing it.
    """
    held = FolderLock(out)
    try:
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
            held.take()
        yield
    finally:
        held.give_back()


def settled(out: Path) -> None:
    """See to it that what is read in a folder belongs together, for those who only read.

    Raises OutputError when somebody is writing it just now, or when what a killed process had begun to publish cannot
    be published.
    """
    if (out / JOURNAL).exists():
        with locked(out):
            pass
