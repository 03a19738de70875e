"""An executor of local processes that survives the death of any of them."""

from __future__ import annotations

import pickle
import queue
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import suppress
from itertools import count
from typing import Any, NamedTuple, ParamSpec, TypeVar

from mapgraft.corpus.member import Member
from mapgraft.processes import uninterrupted

P = ParamSpec("P")
T = TypeVar("T")
_PAUSES_S = (0.1, 1.0, 5.0, 15.0, 30.0)  # between tries to start a process where the machine refuses one


class BrokenCrewError(BrokenExecutor):
    """No process is left, and the machine lets none be started."""


class Crew(Executor):
    """As ``ProcessPoolExecutor``, but a process that dies takes only its own call with it, and another takes its place.

    Each call is run in the main thread of a process, where a plugin's time can be limited. Each process computes with
    one thread, for there is a process per processor. ``shutdown(cancel_futures=True)`` ends calls under way, too.
    Where no process can be started any more, what is left ends with BrokenCrewError. Raises OSError when not all of
    the ``workers`` can be started.
    """

    def __init__(self, workers: int) -> None:
        self._calls: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._members: set[Member] = set()
        self._leaders = workers  # threads that hand out calls
        self._closed, self._abandoned = threading.Event(), threading.Event()  # no more calls; nor those under way
        self._threads: list[threading.Thread] = []
        self._refused = ""  # why no process could be started
        try:
            with uninterrupted():
                members = [self._hired() for _ in range(workers)]
            for member in members:
                thread = threading.Thread(target=self._lead, args=(member,), daemon=True)
                thread.start()
                self._threads.append(thread)
        except BaseException:
            self.shutdown(cancel_futures=True)
            raise

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """See ``Executor.submit``; the function and what it takes and gives must be such that they can be pickled."""
        return self._taken(_Call(Future(), None, (fn, args, kwargs)))

    def submit_within(self, limit_s: float, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """As ``submit``, but a call that takes longer than ``limit_s`` is ended, and its future has TimeLimitError."""
        return self._taken(_Call(Future(), limit_s, (fn, args, kwargs)))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See ``Executor.shutdown``; the processes have ended when it returns, unless it is not to ``wait``."""
        with self._lock:
            self._closed.set()
        if cancel_futures:
            for call in self._queued():
                call.future.cancel()
            with self._lock:
                self._abandoned.set()
                for member in self._members:
                    member.abandon()
        for _ in self._threads:
            self._calls.put(None)
        if wait or cancel_futures:
            for thread in self._threads:
                thread.join()
            with uninterrupted():
                for member in list(self._members):  # those that never got a thread
                    self._dismiss(member)

    def _taken(self, call: _Call) -> Future[Any]:
        with self._lock:
            if self._closed.is_set():
                raise RuntimeError("cannot schedule new futures after shutdown")
            if not self._leaders:
                raise BrokenCrewError(self._broken())
            self._calls.put(call)
        return call.future

    def _lead(self, member: Member | None) -> None:
        """Hand one process its calls, one after another, and another one when it has died.

        A thread without a process takes no call, and the last one leaves none without an outcome, however it ends.
        """
        try:
            while member is not None and (call := self._calls.get()) is not None:
                if not _begun(call.future):
                    continue
                outcome = _outcome(member, call)
                _settle(call.future, outcome)
                if not outcome.usable:
                    member = self._replacement(member)
        finally:
            self._leave()
            if member is not None:
                self._dismiss(member)

    def _leave(self) -> None:
        """One thread less; where it was the last, the calls that are left will not be done."""
        with self._lock:
            self._leaders -= 1
            left = [] if self._leaders else self._queued()
        for call in left:
            _settle(call.future, _Outcome(False, BrokenCrewError(self._broken())))

    def _replacement(self, member: Member) -> Member | None:
        """A process in the place of one that is of no more use; None when nobody needs it, or none can be started.

        As long as others of the crew have work, a machine that refuses is asked again.
        """
        self._dismiss(member)
        for tried in count(1):
            with self._lock:
                others = bool(self._members)
            if self._abandoned.is_set() or (others and self._closed.is_set()):
                break
            try:
                with uninterrupted():
                    return self._hired()
            except OSError as error:
                self._refused = error.strerror or str(error)
            if tried > len(_PAUSES_S) and not others:
                break
            (self._closed if others else self._abandoned).wait(_PAUSES_S[min(tried, len(_PAUSES_S)) - 1])
        return None

    def _hired(self) -> Member:
        member = Member.hired()
        with self._lock:
            self._members.add(member)
            if self._abandoned.is_set():
                member.abandon()
        return member

    def _dismiss(self, member: Member) -> None:
        with self._lock:
            self._members.discard(member)
        member.dismiss()

    def _queued(self) -> list[_Call]:
        """All calls that nobody has taken yet, which are taken out."""
        found = list[_Call]()
        with suppress(queue.Empty):
            while True:
                if (call := self._calls.get_nowait()) is not None:
                    found.append(call)
        return found

    def _broken(self) -> str:
        return "no process is left to work" + (f", and none can be started: {self._refused}" if self._refused else "")


class _Call(NamedTuple):
    future: Future[Any]
    limit_s: float | None
    what: tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]


class _Outcome(NamedTuple):
    """The result of a call, or the error where it is not ``good``, and whether its process can do another one."""

    good: bool
    result: Any
    usable: bool = True


def _begun(future: Future[Any]) -> bool:
    """Whether a call is to be done now: not where it was cancelled, or settled by somebody else."""
    return (future.cancelled() or not future.done()) and future.set_running_or_notify_cancel()


def _outcome(member: Member, call: _Call) -> _Outcome:
    """Have a call done. Whatever goes wrong on the way is its outcome: the thread is needed for the next one."""
    try:
        packed = pickle.dumps(call.what)
    except BaseException as error:
        return _Outcome(False, error)
    try:
        answer = member.call(packed, call.limit_s)
    except BaseException as error:
        return _Outcome(False, error, usable=False)
    try:
        good, result = pickle.loads(answer)
    except BaseException as error:
        return _Outcome(False, error)
    return _Outcome(good, result)


def _settle(future: Future[Any], outcome: _Outcome) -> None:
    with suppress(BaseException):  # somebody else has settled it, or one of those who wait for it raises
        (future.set_result if outcome.good else future.set_exception)(outcome.result)
