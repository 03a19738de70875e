"""Processes that die take only their own call with them."""

from __future__ import annotations

import os
import signal
import threading
import time
from concurrent.futures import Future
from pathlib import Path

import pytest

from mapgraft.corpus.crew import Crew, WorkerDiedError
from mapgraft.corpus.executors import executor_of
from mapgraft.errors import UsageError

# Functions of the standard library: a process that is started imports nothing of this file.


def test_a_process_that_dies_is_replaced_and_the_others_go_on() -> None:
    with Crew(2) as crew:
        before = {crew.submit(os.getpid).result() for _ in range(8)}
        killed = [crew.submit(os._exit, 3) for _ in range(3)]
        good = [crew.submit(pow, 2, k) for k in range(20)]
        for future in killed:
            with pytest.raises(WorkerDiedError, match="its process has ended"):
                future.result()
        assert [future.result() for future in good] == [2**k for k in range(20)]
        after = {crew.submit(os.getpid).result() for _ in range(8)}
        assert os.getpid() not in before | after
        assert len(before) <= 2 and len(after) <= 2


def test_what_a_call_raises_is_raised_and_so_is_what_cannot_travel() -> None:
    with Crew(1) as crew:
        with pytest.raises(ZeroDivisionError):
            crew.submit(divmod, 1, 0).result()
        with pytest.raises(Exception, match="pickle"):
            crew.submit(threading.Lock).result()
        with pytest.raises(Exception, match="pickle"):
            crew.submit(str, threading.Lock()).result()
        assert crew.submit(len, "abc").result() == 3


def test_calls_compute_with_one_thread_in_the_main_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    with Crew(1) as crew:
        assert crew.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
        assert crew.submit(threading.current_thread().__class__.__name__.lower).result()
        name = crew.submit(eval, "__import__('threading').current_thread() is __import__('threading').main_thread()")
        assert name.result() is True
    assert os.getenv("OMP_NUM_THREADS") is None


def test_left_by_an_error_it_does_not_wait_for_what_is_under_way() -> None:
    futures: list[Future[None]] = []
    pids: list[int] = []

    def leave() -> None:
        with executor_of("processes", 2) as executor:
            pids.extend(executor.submit(os.getpid).result() for _ in range(4))
            futures.extend(executor.submit(time.sleep, 600) for _ in range(5))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        leave()
    assert all(future.done() for future in futures)
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


def test_processes_do_not_hear_of_ctrl_c() -> None:
    with Crew(1) as crew:
        pid = crew.submit(os.getpid).result()
        os.kill(pid, signal.SIGINT)
        assert crew.submit(os.getpid).result() == pid


def test_after_the_end_nothing_is_taken() -> None:
    crew = Crew(1)
    crew.shutdown()
    with pytest.raises(RuntimeError, match="after shutdown"):
        crew.submit(pow, 2, 2)


def test_executors_have_names() -> None:
    with executor_of("threads", 1) as executor:
        assert executor.submit(os.getpid).result() == os.getpid()
    with pytest.raises(UsageError, match="there is no executor 'cloud'"), executor_of("cloud"):
        pass
    with pytest.raises(UsageError, match="--workers is for this machine"), executor_of("dask:tcp://x:1", 2):
        pass
