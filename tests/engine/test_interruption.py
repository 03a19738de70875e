"""Signals that come while a kernel runs that gives back arrays in a tuple: Python code of numba makes that tuple."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
from slow_kernel import kernel

from mapgraft.config import LimitsConfig
from mapgraft.errors import FailedPluginError
from mapgraft.guard import Guard
from mapgraft.interruption import interrupt

LONG = 100_000_000  # a tenth of a second and more
SHORT = LimitsConfig(plugin_s=0.02)


def once() -> None:
    kernel(LONG)


def again_and_again() -> None:
    while True:
        kernel(LONG // 20)


def careless() -> None:
    try:
        len(kernel(LONG))
    except Exception:  # as many do
        pytest.fail("a signal is no Exception")


@pytest.fixture(autouse=True)
def _compiled():
    kernel(3)
    yield
    assert sys.gettrace() is None or "coverage" in sys.modules


@pytest.fixture
def ctrl_c():
    """Ctrl-C by another process: a thread of this one would have to wait for the kernel."""
    started = []

    def press(after_s: float) -> None:
        started.append(subprocess.Popen(["/bin/sh", "-c", f"sleep {after_s}; kill -INT {os.getpid()}"]))

    yield press
    for process in started:
        process.wait()


@pytest.mark.parametrize("call", [once, again_and_again, careless])
def test_a_kernel_that_takes_too_long_is_ended_and_named(call):
    guard = Guard(SHORT)
    with guard.armed():
        for _ in range(5):
            with (
                pytest.raises(FailedPluginError, match="the metric 'slow' took longer"),
                guard.calling("metric", "slow"),
            ):
                call()
        with guard.calling("metric", "quick"):
            assert kernel(8)[2] == 21.0


@pytest.mark.parametrize("call", [once, again_and_again, careless])
def test_ctrl_c_in_a_kernel_is_ctrl_c_and_no_plugins_failure(call, ctrl_c):
    guard, before = Guard(), signal.getsignal(signal.SIGINT)
    ctrl_c(0.05)
    with pytest.raises(KeyboardInterrupt), guard.armed(), guard.calling("metric", "m"):
        while True:
            call()
    assert not guard.failures
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize("hidden", [KeyboardInterrupt(), KeyError("k")])
def test_a_kernel_that_stumbled_over_a_signal_is_not_to_blame(hidden):
    """By a handler that is not ours: numba tells of any error as a SystemError."""
    signalled = isinstance(hidden, KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt if signalled else FailedPluginError), Guard().calling("metric", "m"):
        raise SystemError("returned a result with an exception set") from hidden


def test_of_several_that_wait_ctrl_c_goes_first():
    def ring(number, frame):
        for error in (TimeoutError(), KeyboardInterrupt(), TimeoutError()):
            interrupt(error, frame)

    before = signal.signal(signal.SIGALRM, ring)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        with pytest.raises(KeyboardInterrupt):
            once()
        assert kernel(8)[2] == 21.0
    finally:
        signal.signal(signal.SIGALRM, before)


def test_outside_of_kernels_it_is_raised_at_once():
    with pytest.raises(TimeoutError):
        interrupt(TimeoutError(), sys._getframe())
