"""Processes that die take only their own call with them."""

from __future__ import annotations

import os
import resource
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from mapgraft.corpus.crew import BrokenCrewError, Crew
from mapgraft.corpus.executors import ends_calls, executor_of
from mapgraft.corpus.member import TimeLimitError, WorkerDiedError
from mapgraft.errors import UsageError

# Functions of the standard library: a process that is started imports nothing of this file.
LONG_S = 60.0  # nothing here takes so long, but what would wait for ever


@contextmanager
def no_room() -> Iterator[None]:
    """A machine that lets no process be started: nothing can be opened that it would need."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    free = os.open(os.devnull, os.O_RDONLY)
    os.close(free)
    resource.setrlimit(resource.RLIMIT_NOFILE, (free, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


class Raising:
    """An argument that cannot be sent, for whatever reason."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def __reduce__(self) -> Any:
        raise self.error


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


def test_where_no_process_can_be_started_every_call_comes_to_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapgraft.corpus.crew._PAUSES_S", (0.0, 0.0))
    with Crew(2) as crew:
        with no_room():
            died = [crew.submit(os._exit, 3) for _ in range(2)]
            left = [crew.submit(len, "abc") for _ in range(3)]
            for future in died:
                with pytest.raises(WorkerDiedError):
                    future.result(LONG_S)
            for future in left:
                with pytest.raises(BrokenCrewError, match="none can be started: Too many open files"):
                    future.result(LONG_S)
        with pytest.raises(BrokenCrewError, match="no process is left to work"):
            crew.submit(len, "abc")


def test_a_machine_that_refuses_a_process_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapgraft.corpus.crew._PAUSES_S", (0.01,) * 3000)
    with Crew(1) as crew:
        with no_room(), pytest.raises(WorkerDiedError):
            crew.submit(os._exit, 3).result(LONG_S)
        assert crew.submit(len, "abc").result(LONG_S) == 3


def test_processes_that_cannot_all_be_started_are_a_sentence() -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    said = pytest.raises(UsageError, match=r"64 processes cannot be started: .*Too many open files; give fewer")
    with no_room(), said, executor_of("processes", 64):
        pass
    assert len(list(Path("/proc/self/fd").iterdir())) <= before


def test_what_is_queued_is_done_before_the_end_though_a_process_dies() -> None:
    with Crew(1) as crew:
        died = crew.submit(os._exit, 3)
        good = [crew.submit(pow, 2, k) for k in range(5)]
    assert isinstance(died.exception(LONG_S), WorkerDiedError)
    assert [future.result(LONG_S) for future in good] == [2**k for k in range(5)]


@pytest.mark.parametrize("error", [OSError("no such line"), EOFError(), SystemExit(), MemoryError()], ids=repr)
def test_what_cannot_be_sent_or_taken_is_its_own_calls_affair(error: BaseException) -> None:
    unpacked = f"type('', (), {{'__reduce__': lambda self: (exec, ('raise {type(error).__name__}()',))}})()"
    with Crew(1) as crew:
        pid = crew.submit(os.getpid).result()
        for future in (crew.submit(str, Raising(error)), crew.submit(eval, unpacked)):
            assert isinstance(future.exception(LONG_S), type(error))
        assert crew.submit(os.getpid).result(LONG_S) == pid


def test_those_who_wait_for_a_call_may_do_what_they_like(tmp_path: Path) -> None:
    def leave(future: Future[Any]) -> None:
        raise SystemExit

    os.mkfifo(line := tmp_path / "line")
    with Crew(1) as crew:
        pid = crew.submit(os.getpid).result()
        crew.submit(os.open, str(line), os.O_RDONLY).add_done_callback(leave)  # until somebody writes there
        settled, cancelled = crew.submit(time.sleep, 600), crew.submit(time.sleep, 600)
        settled.set_result(None)
        assert cancelled.cancel()
        line.open("w").close()
        assert crew.submit(os.getpid).result(LONG_S) == pid


def test_a_process_that_dies_is_noticed_though_its_child_keeps_the_line_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapgraft.processes._PATIENCE_S", 0.1)
    with Crew(1) as crew:
        child = crew.submit(eval, "(os := __import__('os')).fork() or (__import__('time').sleep(600), os._exit(0))")
        pid = child.result()
        try:
            with pytest.raises(WorkerDiedError):
                crew.submit(os._exit, 3).result(LONG_S)
        finally:
            os.kill(pid, signal.SIGKILL)
        assert crew.submit(len, "abc").result(LONG_S) == 3


def test_a_call_that_takes_too_long_is_ended_and_the_next_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapgraft.processes._PATIENCE_S", 0.1)
    with Crew(1) as crew:
        pid = crew.submit(os.getpid).result()
        crew.submit(signal.signal, signal.SIGTERM, signal.SIG_IGN).result()
        with pytest.raises(TimeLimitError, match=r"ended after 0\.2 s"):
            crew.submit_within(0.2, time.sleep, 600).result(LONG_S)
        assert crew.submit_within(LONG_S, os.getpid).result(LONG_S) != pid
        assert not Path(f"/proc/{pid}").exists()


def test_a_process_that_does_not_want_to_end_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mapgraft.processes._PATIENCE_S", 0.1)
    crew = Crew(1)
    crew.submit(signal.signal, signal.SIGTERM, signal.SIG_IGN).result()
    endless = crew.submit(time.sleep, 600)
    crew.shutdown(cancel_futures=True)
    assert endless.done()


def test_executors_have_names() -> None:
    with executor_of("processes", 1) as executor:
        assert ends_calls(executor)
    with executor_of("threads", 1) as executor:
        assert not ends_calls(executor)
        assert executor.submit(os.getpid).result() == os.getpid()
    with pytest.raises(UsageError, match="there is no executor 'cloud'"), executor_of("cloud"):
        pass
    with pytest.raises(UsageError, match="--workers is for this machine"), executor_of("dask:tcp://x:1", 2):
        pass
