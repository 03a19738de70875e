"""What jobs are run on, by name: processes or threads of this machine, or a Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import Any, TypeGuard

from mapgraft.corpus.crew import Crew
from mapgraft.errors import UsageError

PROCESSES, THREADS, DASK = "processes", "threads", "dask:"
_CONNECTING_S = 30


@contextmanager
def executor_of(name: str, workers: int | None = None) -> Iterator[Executor]:
    """An executor that ends when this is left; when it is left by an error, without waiting for what is under way.

    ``name`` is ``processes``, ``threads``, or ``dask:`` with a scheduler's address. ``workers`` is how many, on this
    machine (default: one per processor). Raises UsageError for another name, where Dask is not installed or not there,
    or where the machine does not start so many processes.
    """
    if name.startswith(DASK):
        if workers is not None:
            raise UsageError("--workers is for this machine: a Dask cluster has the workers that it has")
        with _dask(name.removeprefix(DASK)) as cluster:
            yield cluster
        return
    executor = _local(name, workers or len(os.sched_getaffinity(0)))
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        raise
    executor.shutdown()


def ends_calls(executor: Executor) -> TypeGuard[Crew]:
    """Whether an executor can end a call that takes too long: processes of ours can be ended, threads cannot."""
    return isinstance(executor, Crew)


def _local(name: str, workers: int) -> Executor:
    if name == THREADS:
        return ThreadPoolExecutor(workers, "mapgraft-job")
    if name != PROCESSES:
        raise UsageError(f"there is no executor {name!r}: choose {PROCESSES}, {THREADS} or {DASK}ADDRESS")
    try:
        return Crew(workers)
    except (OSError, RuntimeError) as error:
        raise UsageError(f"{workers} processes cannot be started: {error}; give fewer --workers") from error


@contextmanager
def _dask(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError:
        raise UsageError("a Dask cluster needs the extra dask: pip install 'mapgraft[dask]'") from None
    from mapgraft.corpus.cluster import Cluster

    connect: Any = Client  # without types
    try:
        client = connect(address, timeout=_CONNECTING_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise UsageError(f"there is no Dask scheduler at {address!r}: {error}") from None
    try:
        executor = Cluster(client, address, 3 * _CONNECTING_S)
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False)
            raise
        executor.shutdown()
    finally:
        with suppress(TimeoutError):
            client.close()
