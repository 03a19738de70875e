"""An executor of local processes that survives the death of any of them."""

from __future__ import annotations

import os
import pickle
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any, NamedTuple, ParamSpec, TypeVar

from mapgraft.processes import GONE, ended, started, uninterrupted

P = ParamSpec("P")
T = TypeVar("T")
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


class WorkerDiedError(Exception):
    """The process that did this has ended by itself, or was ended: by a crash, or for want of memory."""


class Crew(Executor):
    """As ``ProcessPoolExecutor``, but a process that dies takes only its own call with it, and another takes its place.

    Each call is run in the main thread of a process, where a plugin's time can be limited. Each process computes with
    one thread, for there is a process per processor. ``shutdown(cancel_futures=True)`` ends calls under way, too.
    """

    def __init__(self, workers: int) -> None:
        self._calls: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._crew: dict[Connection, SpawnProcess] = {}
        self._open = True
        with uninterrupted():
            for _ in range(workers):
                self._hire()
        self._threads = [threading.Thread(target=self._lead, args=(one,), daemon=True) for one in list(self._crew)]
        for thread in self._threads:
            thread.start()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """See ``Executor.submit``; the function and what it takes and gives must be such that they can be pickled."""
        future: Future[T] = Future()
        with self._lock:
            if not self._open:
                raise RuntimeError("cannot schedule new futures after shutdown")
            self._calls.put(_Call(future, fn, args, kwargs))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See ``Executor.shutdown``; the processes have ended when it returns."""
        with self._lock:
            self._open = False
        if cancel_futures:
            with suppress(queue.Empty):
                while True:
                    if (call := self._calls.get_nowait()) is not None:
                        call.future.cancel()
        for _ in self._threads:
            self._calls.put(None)
        if cancel_futures:
            for process in list(self._crew.values()):
                process.terminate()
        if wait or cancel_futures:
            for thread in self._threads:
                thread.join()
            with uninterrupted(), self._lock:
                ended(self._crew.items())
                self._crew.clear()

    def _hire(self) -> Connection:
        connection, process = started(_work)
        self._crew[connection] = process
        return connection

    def _lead(self, connection: Connection) -> None:
        """Hand one process its calls, one after another, and another one when it has died."""
        while (call := self._calls.get()) is not None:
            if not call.future.set_running_or_notify_cancel():
                continue
            try:
                connection.send_bytes(pickle.dumps(call[1:]))
                good, result = pickle.loads(connection.recv_bytes())
            except GONE:
                replaced = self._replaced(connection)
                call.future.set_exception(WorkerDiedError("its process has ended, perhaps for want of memory"))
                if replaced is None:
                    return
                connection = replaced
            except Exception as error:  # it could not be pickled
                call.future.set_exception(error)
            else:
                (call.future.set_result if good else call.future.set_exception)(result)

    def _replaced(self, connection: Connection) -> Connection | None:
        """A new process in the place of one that has died; None when no more calls are taken."""
        with uninterrupted(), self._lock:
            ended([(connection, self._crew.pop(connection))])
            return self._hire() if self._open else None


class _Call(NamedTuple):
    future: Future[Any]
    function: Callable[..., Any]
    args: tuple[Any, ...]
    kwargs: dict[str, Any]


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
