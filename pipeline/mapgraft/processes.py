"""Processes that share work: they hear nothing of Ctrl-C, and none outlives the one that started them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.resource_tracker import ensure_running
from typing import Final

GONE: Final = (EOFError, OSError)
"""What a connection raises when nobody is at the other end."""

_PATIENCE_S = 5.0  # for a process that was asked to end


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until this is left, and processes that are started inside never hear of it.

    They inherit the mask of the thread; the handler is for signals that another thread gets.
    """
    ensure_running()  # it lets interrupts through again when it begins
    waiting: list[int] = []
    first = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, lambda number, _: waiting.append(number)) if first else None
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if first:
            signal.signal(signal.SIGINT, handler)
    if waiting:
        raise KeyboardInterrupt


def started(work: Callable[[Connection], None]) -> tuple[Connection, SpawnProcess]:
    """A new process that does ``work`` with the other end of the connection, and ends when this process does.

    ``work`` is a function of a module. Call it within ``uninterrupted``.
    """
    context = multiprocessing.get_context("spawn")  # a fork would copy locks that other threads hold
    ours, theirs = context.Pipe()
    process = context.Process(target=_begin, args=(work, theirs))
    process.start()
    theirs.close()
    return ours, process


def ended(crew: Iterable[tuple[Connection, SpawnProcess]]) -> None:
    """Processes that have ended when this returns, whatever they were doing. Call it within ``uninterrupted``."""
    asked = list(crew)
    for connection, process in asked:
        connection.close()
        process.terminate()
    for _, process in asked:
        process.join(_PATIENCE_S)
        if process.is_alive():
            process.kill()
            process.join()
        process.close()


def _begin(work: Callable[[Connection], None], connection: Connection) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    work(connection)


def _end_with_parent() -> None:
    """Nobody waits for a result any more when the parent has ended, so do not finish what is at hand."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
