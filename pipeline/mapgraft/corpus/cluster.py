"""A Dask cluster as an executor whose calls come to an end, also when the scheduler goes away."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, InvalidStateError
from concurrent.futures import wait as ended
from contextlib import suppress
from typing import Any, ParamSpec, TypeVar

from distributed.comm.core import CommClosedError

P = ParamSpec("P")
T = TypeVar("T")
_LOOKING_S = 0.5  # between two looks at the connection


class SchedulerGoneError(BrokenExecutor):
    """The scheduler of a cluster cannot be reached any more."""


class Cluster(Executor):
    """The workers of a Dask cluster; as Dask's own executor, whose calls may never end when the scheduler goes away.

    ``client`` is a ``distributed.Client`` that is connected to ``address``. When the connection breaks, Dask cancels
    what is under way and tries to connect again. This is told when it is known how that ended: calls are cancelled
    where the scheduler is there again, and have SchedulerGoneError where the client has given up, or has not reached
    anybody for ``patience_s``.
    """

    def __init__(self, client: Any, address: str, patience_s: float) -> None:
        self._client, self._address, self._patience_s = client, address, patience_s
        self._lock = threading.Lock()
        self._under_way: dict[Future[Any], Any] = {}  # with Dask's futures
        self._interrupted: set[Future[Any]] = set()  # of these: nobody does them any more
        self._gone, self._left = False, threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """See ``Executor.submit``; raises SchedulerGoneError when the scheduler is gone."""
        ours: Future[T] = Future()
        try:
            theirs = self._client.submit(fn, *args, pure=False, **kwargs)  # the same call again is to be done again
            with self._lock:
                if self._gone:
                    raise self._error()
                self._under_way[ours] = theirs
        except Exception:
            if self._client.status in ("closing", "closed"):
                raise self._error() from None
            raise
        told = asyncio.run_coroutine_threadsafe(self._told(theirs), self._client.loop.asyncio_loop)
        told.add_done_callback(lambda done: self._hear(ours, done))
        return ours

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See ``Executor.shutdown``; what nobody waits for is cancelled."""
        if wait and not cancel_futures:
            with self._lock:
                waited_for = list(self._under_way)
            ended(waited_for)
        self._left.set()
        with self._lock:
            under_way = dict(self._under_way)
            self._under_way.clear()
        if under_way and self._client.status == "running":
            with suppress(Exception):  # whoever has gone away in this moment needs not be told
                self._client.cancel(list(under_way.values()))
        for future in under_way:
            _cancel(future)

    async def _told(self, theirs: Any) -> Any:
        return await self._client.gather(theirs, asynchronous=True)

    def _hear(self, ours: Future[Any], told: Future[Any]) -> None:
        """Pass on what came of a call, unless it was interrupted: ``_watch`` sees to that."""
        error = CancelledError() if told.cancelled() else told.exception()
        with self._lock:
            if isinstance(error, CancelledError | CommClosedError):
                self._interrupted.add(ours)
                return
            self._under_way.pop(ours, None)
        with suppress(InvalidStateError):  # it has come to its end meanwhile
            if error is None:
                ours.set_result(told.result())
            else:
                ours.set_exception(error)

    def _watch(self) -> None:
        """See to what was interrupted, until nobody needs the cluster any more or it is gone."""
        unreached_s = 0.0
        while not self._left.wait(_LOOKING_S):
            status = self._client.status
            unreached_s = 0.0 if status == "running" else unreached_s + _LOOKING_S
            if status == "closed" or unreached_s > self._patience_s:
                self._give_up()
                return
            if status == "running":
                for future in self._there_again():
                    _cancel(future)

    def _give_up(self) -> None:
        with self._lock:
            self._gone = True
            under_way = list(self._under_way)
            self._under_way.clear()
        for future in under_way:
            with suppress(InvalidStateError):
                future.set_exception(self._error())

    def _there_again(self) -> list[Future[Any]]:
        """What was interrupted, now that the scheduler can be reached."""
        with self._lock:
            interrupted = [future for future in self._interrupted if future in self._under_way]
            self._interrupted.clear()
            for future in interrupted:
                del self._under_way[future]
        return interrupted

    def _error(self) -> SchedulerGoneError:
        return SchedulerGoneError(f"the Dask scheduler at {self._address} is gone")


def _cancel(future: Future[Any]) -> None:
    if future.cancel():
        future.set_running_or_notify_cancel()  # wakes those who wait for several
