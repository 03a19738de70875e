"""Stands between the engine and plugins: names the one that fails, and ends the call that takes too long.

The time limit is an alarm signal, whose handler raises an exception in the plugin's code as soon as the interpreter is
back in Python. That is safe with threads and with compiled kernels, because nothing is interrupted in their middle; and
so it cannot stop what never comes back: a loop inside compiled code, or a plugin that catches ``BaseException`` and
goes on (it gets the exception again every second). Signals reach the main thread only: a run in another thread has no
limit.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from time import monotonic
from types import FrameType, TracebackType

from mapgraft.config import LimitsConfig
from mapgraft.errors import FailedPluginError, MapError, PluginError

AGAIN_S = 1.0  # between two alarms, when the first was caught by the plugin


class OverTime(BaseException):
    """A plugin's time is over; no ``Exception``, so that a plugin's ``except Exception`` does not take it."""


@dataclass(slots=True)
class Guard:
    """Watches the calls of one run, and remembers which plugins are not to be asked again.

    ``failures`` counts per plugin (its kind and name), ``set_aside`` says why one is not asked any more.
    """

    limits: LimitsConfig = field(default_factory=LimitsConfig)
    failures: dict[tuple[str, str], int] = field(default_factory=dict)
    set_aside: dict[tuple[str, str], str] = field(default_factory=dict)
    _until_s: float | None = None
    _is_armed: bool = False

    def calling(self, kind: str, name: str) -> Call:
        """A context in which one plugin is called.

        Whatever it raises becomes a FailedPluginError that names it, but for a MapError, which is a refusal, and what a
        plugin within it did. SystemExit counts as a failure; KeyboardInterrupt passes.
        """
        return Call(self, kind, name)

    @contextmanager
    def armed(self) -> Iterator[None]:
        """Calls within are limited in time; does nothing outside of the main thread."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = signal.signal(signal.SIGALRM, self._ring)
        self._is_armed = True
        try:
            yield
        finally:
            self._is_armed = False
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)

    def start(self) -> bool:
        """Begin to count the time, unless somebody has; whether it was begun."""
        if not self._is_armed or self._until_s is not None:
            return False
        self._until_s = monotonic() + self.limits.plugin_s
        signal.setitimer(signal.ITIMER_REAL, self.limits.plugin_s, AGAIN_S)
        return True

    def stop(self) -> None:
        self._until_s = None
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    def note(self, error: PluginError) -> None:
        """Count a failure; set the plugin aside when there are too many, or at once when it took too long."""
        if not isinstance(error, FailedPluginError):
            return
        count = self.failures[error.plugin] = self.failures.get(error.plugin, 0) + 1
        if error.took_too_long or count >= self.limits.failures:
            kind, name = error.plugin
            times = "took too long" if error.took_too_long else f"failed {count} times (limits.failures)"
            self.set_aside[error.plugin] = f"the {kind} {name!r} {times} and is not asked again"

    def _ring(self, _number: int, frame: FrameType | None) -> None:
        late = self._until_s is not None and monotonic() >= self._until_s
        if late and frame is not None and frame.f_code.co_filename != __file__:  # else the call is just ending
            raise OverTime


class Call:
    """What ``Guard.calling`` enters, for every scan and merge: a generator would cost ten times as much."""

    __slots__ = ("_guard", "_kind", "_name", "_timed")

    def __init__(self, guard: Guard, kind: str, name: str) -> None:
        self._guard, self._kind, self._name = guard, kind, name
        self._timed = False

    def __enter__(self) -> None:
        self._timed = self._guard.start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._timed:
            self._guard.stop()
        if error is None or isinstance(error, MapError | FailedPluginError | KeyboardInterrupt):
            return
        what, plugin = f"the {self._kind} {self._name!r}", (self._kind, self._name)
        if isinstance(error, OverTime):
            if not self._timed:
                return  # the outermost call is to blame, for its time is over
            seconds = f"{self._guard.limits.plugin_s:g} s"
            sentence = f"{what} took longer than {seconds}: raise limits.plugin_s if it may"
            raise FailedPluginError(sentence, plugin, took_too_long=True) from error
        if isinstance(error, PluginError):
            raise FailedPluginError(f"{what} {error}", plugin) from error
        if isinstance(error, Exception | SystemExit):
            raise FailedPluginError(f"{what} failed: {type(error).__name__}: {error}", plugin) from error
