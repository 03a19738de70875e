"""Processes that share the work end with whoever asked for it, and say nothing of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mapgraft.config import parse_config
from mapgraft.errors import PluginError, UsageError
from mapgraft.evaluation import Bench, Drawing, Settings
from mapgraft.evaluation.workers import workers
from mapgraft_recordings import demo_files

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc to find the processes")
BUSY_S = 4.0  # of processor time: past the imports, within the pairs
TICKS = os.sysconf("SC_CLK_TCK")


@pytest.fixture
def evaluating() -> Iterator[subprocess.Popen[str]]:
    """``mapgraft evaluate --jobs 2`` in a session of its own, with more to do than anybody waits for."""
    command = [sys.executable, "-m", "mapgraft", "evaluate", str(demo_files()[0][0]), "--jobs", "2"]
    small = ["--scans", "20", "--further", "5", "--pairs", "500"]
    with subprocess.Popen(
        [*command, *small], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        yield process
        for pid in processor_s_of(process.pid):
            os.kill(pid, signal.SIGKILL)


def processor_s_of(session: int) -> dict[int, float]:
    """The processes of a session, with the processor time that each took."""
    return {pid: taken_s for pid, _, its_session, taken_s in running() if its_session == session}


def sharing() -> set[int]:
    """The processes that share the work of this one; tests that run beside this one have their own."""
    mine = {pid for pid, parent, _, _ in running() if parent == os.getpid()}
    return {pid for pid in mine if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()}


def running() -> Iterator[tuple[int, int, int, float]]:
    """Each process that has not ended: itself, its parent, its session, the processor time that it took."""
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rsplit(")", 1)[1].split()
        except OSError:  # ended meanwhile
            continue
        if fields[0] not in "ZX":
            yield int(path.parent.name), int(fields[1]), int(fields[3]), (int(fields[11]) + int(fields[12])) / TICKS


def wait_until(session: int, enough: Callable[[dict[int, float]], bool]) -> None:
    """Wait for something to hold of the children (the parent left out)."""
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        children = {pid: s for pid, s in processor_s_of(session).items() if pid != session}
        if enough(children):
            return
        time.sleep(0.02)
    pytest.fail("the processes did not come that far")


def begun(children: dict[int, float]) -> bool:
    return len(children) >= 3  # two that share the work, and the one that Python keeps its books with


def busy(children: dict[int, float]) -> bool:
    return sum(taken_s > BUSY_S for taken_s in children.values()) == 2


def gone(children: dict[int, float]) -> bool:
    return not children


@pytest.mark.parametrize(("enough", "send"), [(begun, os.kill), (busy, os.kill), (begun, os.killpg), (busy, os.killpg)])
def test_an_interrupt_leaves_no_process_and_no_traceback(evaluating, enough, send):
    """Of the parent alone, and of all processes at once as Ctrl-C in a terminal does."""
    wait_until(evaluating.pid, enough)
    send(evaluating.pid, signal.SIGINT)
    out, err = evaluating.communicate(timeout=60)  # returns when nobody holds the streams any more
    assert (evaluating.returncode, out) == (130, "")
    *begun, said = err.splitlines()  # where stderr is no terminal a line may tell what has begun
    assert said == "mapgraft: interrupted; no result was written"
    assert all(line.startswith("mapgraft: 500 pairs to do") for line in begun) and len(begun) <= 1
    wait_until(evaluating.pid, gone)  # who closes its streams as it ends is still listed for a moment


def test_when_the_parent_is_killed_the_others_end(evaluating):
    wait_until(evaluating.pid, busy)
    evaluating.kill()
    evaluating.communicate(timeout=60)
    wait_until(evaluating.pid, gone)


@pytest.fixture
def bench(courses, plugins) -> Bench:
    return Bench(courses, parse_config({}), plugins, Settings(Drawing(pairs=6, scans=20, further=5), baseline=False))


def test_leaving_early_ends_the_processes(bench):
    with workers(bench, 2) as results:
        assert next(results).number == 0
        assert len(sharing()) == 2
    assert not sharing()


def test_a_process_that_dies_is_told(bench):
    with pytest.raises(PluginError, match="has ended by itself"), workers(bench, 2) as results:
        for pid in sharing():
            os.kill(pid, signal.SIGKILL)
        list(results)


def test_what_a_process_raises_is_raised(bench):
    bench.settings = Settings(bench.settings.drawing, matcher="none such")
    with pytest.raises(UsageError, match="none such"), workers(bench, 2) as results:
        list(results)
