"""Processes that share the work of an evaluation; none outlives it, however it ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from multiprocessing.resource_tracker import ensure_running
from typing import Any

from mapgraft.errors import PluginError
from mapgraft.evaluation.bench import Bench, Judged

_PATIENCE_S = 5.0  # for a process that was asked to end
_GONE = (EOFError, OSError)  # what a connection raises when nobody is at the other end


@contextmanager
def workers(bench: Bench, jobs: int) -> Iterator[Iterator[Judged]]:
    """The results of all pairs in order, from ``jobs`` processes, which have ended when this is left.

    What a process raises is raised here; PluginError when one ended by itself.
    """
    crew: dict[Connection, SpawnProcess] = {}
    try:
        ensure_running()  # it would let interrupts through again if it began below
        with _uninterrupted():
            for _ in range(jobs):
                _add(crew)
        given = (bench.courses, bench.config, bench.plugins, bench.settings)
        yield _in_order(list(crew), given, len(bench.plans))
    finally:
        with _uninterrupted():
            _end(crew)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C waits until this is left, and processes that are started inside never hear of it.

    They inherit the mask of the thread; the handler is for signals that another thread gets.
    """
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


def _add(crew: dict[Connection, SpawnProcess]) -> None:
    context = multiprocessing.get_context("spawn")  # a fork would copy locks that other threads hold
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs,))
    process.start()
    theirs.close()
    crew[ours] = process


def _end(crew: dict[Connection, SpawnProcess]) -> None:
    for connection, process in crew.items():
        connection.close()
        process.terminate()
    for process in crew.values():
        process.join(_PATIENCE_S)
        if process.is_alive():
            process.kill()
            process.join()
        process.close()


def _in_order(crew: Sequence[Connection], given: object, count: int) -> Iterator[Judged]:
    """Whoever is done gets the next pair; results wait for their turn."""
    numbers, early = iter(range(count)), dict[int, Judged]()
    for connection in crew:
        _tell(connection, given)
        _tell(connection, next(numbers, None))
    for turn in range(count):
        while turn not in early:
            ready = wait(crew)
            for connection in (one for one in crew if one in ready):
                made = _hear(connection)
                early[made.number] = made
                _tell(connection, next(numbers, None))
        yield early.pop(turn)


def _tell(connection: Connection, what: object) -> None:
    with suppress(*_GONE):  # it may have said why before it ended: _hear tells
        connection.send(what)


def _hear(connection: Connection) -> Judged:
    try:
        made: Judged | Exception = connection.recv()
    except _GONE:
        raise PluginError(
            "a process that shared the work has ended by itself, perhaps for want of memory: try fewer --jobs"
        ) from None
    if isinstance(made, Exception):
        raise made
    return made


def _work(connection: Connection) -> None:
    """What one process does: take numbers of pairs until there is None, and send back what came of them."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(*_GONE):
        for made in _made(connection.recv(), iter(connection.recv, None)):
            connection.send(made)


def _made(given: Sequence[Any], numbers: Iterable[int]) -> Iterator[Judged | Exception]:
    try:
        bench = Bench(*given)
        bench.judge(0)  # compiles and loads what there is, so that no time tells of that
        for number in numbers:
            yield bench.judge(number)
    except Exception as error:
        yield error


def _end_with_parent() -> None:
    """Nobody waits for a result any more when the parent has ended, so do not finish the pair."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
