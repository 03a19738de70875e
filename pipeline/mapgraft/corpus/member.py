"""One process that does calls, one after another, until it dies or is ended."""

from __future__ import annotations

import os
import pickle
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from time import monotonic

from mapgraft.processes import GONE, ended, started

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
_LOOKING_S = 1.0  # between two looks whether a process that says nothing still lives


class WorkerDiedError(Exception):
    """The process that did this has ended by itself, or was ended: by a crash, or for want of memory."""


class TimeLimitError(Exception):
    """The process that did this was ended, because it took longer than ``limit_s``."""

    def __init__(self, limit_s: float) -> None:
        super().__init__(f"it was ended after {limit_s:g} s")
        self.limit_s = limit_s


@dataclass(frozen=True, slots=True, eq=False)
class Member:
    """A process of a crew, and the connection to it. One thread calls and dismisses it; any may abandon it."""

    connection: Connection
    process: SpawnProcess
    _abandoned: threading.Event = field(default_factory=threading.Event)

    @classmethod
    def hired(cls) -> Member:
        """A new process; raises OSError when there can be none. Call it within ``uninterrupted``."""
        return cls(*started(_work))

    def call(self, packed: bytes, limit_s: float | None) -> bytes:
        """What came of a call, both pickled: whether it went well, and its result or error.

        Raises WorkerDiedError, and TimeLimitError after ``limit_s``. Whatever it raises, the process is of no more use.
        """
        try:
            self.connection.send_bytes(packed)
            self._await(limit_s)
            return self.connection.recv_bytes()
        except GONE:
            raise WorkerDiedError("its process has ended, perhaps for want of memory") from None

    def _await(self, limit_s: float | None) -> None:
        """Return when there is an answer; raises EOFError when there will be none.

        A process that is dead is asked for, too: what it has started itself may keep the connection open.
        """
        began_s = monotonic()
        while not self._abandoned.is_set():
            left_s = _LOOKING_S if limit_s is None else began_s + limit_s - monotonic()
            if self.connection.poll(min(max(left_s, 0.0), _LOOKING_S)):
                return
            if left_s <= 0 and limit_s is not None:
                raise TimeLimitError(limit_s)
            if not self.process.is_alive() and not self.connection.poll():
                break
        raise EOFError

    def abandon(self) -> None:
        """End the process in the middle of a call, which ends as if it had died; not after ``dismiss``."""
        self._abandoned.set()
        self.process.terminate()

    def dismiss(self) -> None:
        """End the process; it has ended when this returns. In the main thread call it within ``uninterrupted``."""
        ended([(self.connection, self.process)])


def _work(connection: Connection) -> None:
    """What one process does: call what it is sent, and send back what came of it."""
    for name in _THREADS:
        os.environ.setdefault(name, "1")  # read by libraries when they are loaded, which is below
    with suppress(*GONE):
        while True:
            call = connection.recv_bytes()
            try:
                function, args, kwargs = pickle.loads(call)
                made = pickle.dumps((True, function(*args, **kwargs)))
            except Exception as error:
                made = _packed(error)
            connection.send_bytes(made)


def _packed(error: Exception) -> bytes:
    """An error as it can travel: as itself, or as what it says where its kind does not let itself be pickled."""
    try:
        packed = pickle.dumps((False, error))
        pickle.loads(packed)
    except Exception:
        packed = pickle.dumps((False, RuntimeError(f"{type(error).__name__}: {error}")))
    return packed
