"""Processes that share the work of an evaluation; none outlives it, however it ends."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess

from mapgraft.errors import PluginError
from mapgraft.evaluation.bench import Bench, Judged
from mapgraft.processes import GONE, ended, started, uninterrupted


@contextmanager
def workers(bench: Bench, jobs: int) -> Iterator[Iterator[Judged]]:
    """The results of all pairs in order, from ``jobs`` processes, which have ended when this is left.

    What a process raises is raised here; PluginError when one ended by itself.
    """
    crew: dict[Connection, SpawnProcess] = {}
    try:
        with uninterrupted():
            for _ in range(jobs):
                connection, process = started(_work)
                crew[connection] = process
        given = (bench.courses, bench.config, bench.plugins, bench.settings)
        yield _in_order(list(crew), given, len(bench.plans))
    finally:
        with uninterrupted():
            ended(crew.items())


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
    with suppress(*GONE):  # it may have said why before it ended: _hear tells
        connection.send(what)


def _hear(connection: Connection) -> Judged:
    try:
        made: Judged | Exception = connection.recv()
    except GONE:
        raise PluginError(
            "a process that shared the work has ended by itself, perhaps for want of memory: try fewer --jobs"
        ) from None
    if isinstance(made, Exception):
        raise made
    return made


def _work(connection: Connection) -> None:
    """What one process does: take numbers of pairs until there is None, and send back what came of them."""
    with suppress(*GONE):
        for made in _made(connection):
            connection.send(made)


def _made(connection: Connection) -> Iterator[Judged | Exception]:
    """Whatever goes wrong is told, also while what was given is unpacked; where the other end is gone, nobody hears."""
    try:
        bench = Bench(*connection.recv())
        bench.judge(0)  # compiles and loads what there is, so that no time tells of that
        while (number := connection.recv()) is not None:
            yield bench.judge(number)
    except Exception as error:
        yield error
