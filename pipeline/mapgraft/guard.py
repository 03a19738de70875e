"""Stands between the engine and plugins: names the one that fails, and ends the call that takes too long.

The time limit is an alarm signal, whose handler raises an exception in the plugin's code as soon as the interpreter is
back in Python, and no kernel is under way (see ``interruption``). Ctrl-C is handled in the same way. So nothing can
stop what never comes back: a loop inside compiled code, or a plugin that catches ``BaseException`` and goes on (it gets
the exception again every second). Signals reach the main thread only: a run in another thread has no limit.
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
from mapgraft.errors import FailedPluginError, MapError, PluginError, SetAsideError
from mapgraft.interruption import interrupt

Asked = tuple[str, ...]  # the kind and name of a plugin, and the method where there are several
AGAIN_S = 1.0  # between two alarms, when the first was caught by the plugin
ALWAYS_ASKED = "integrate"  # of a map type: where it fails that ends the robot's part, and is no matter of the others


class OverTime(BaseException):
    """A plugin's time is over; no ``Exception``, so that a plugin's ``except Exception`` does not take it."""


@dataclass(slots=True)
class Guard:
    """Watches the calls of one run, and remembers which plugins are not to be asked again.

    ``failures`` counts per plugin (its kind and name, and the method where it is asked for many things), ``set_aside``
    says why one is not asked any more.
    """

    limits: LimitsConfig = field(default_factory=LimitsConfig)
    failures: dict[Asked, int] = field(default_factory=dict)
    set_aside: dict[Asked, str] = field(default_factory=dict)
    untold: list[tuple[str, FailedPluginError]] = field(default_factory=list)  # robot, what a sink met with its map
    _until_s: float | None = None
    _is_armed: bool = False

    def calling(self, kind: str, name: str, method: str = "") -> Call:
        """A context in which one plugin is called.

        Whatever it raises becomes a FailedPluginError that names it, but for a MapError, which is a refusal, and what a
        plugin within it did. SystemExit counts as a failure; KeyboardInterrupt passes.
        """
        return Call(self, kind, name, method)

    def naming(self, kind: str, name: str) -> Call:
        """The same without a limit in time: around several calls that have one each."""
        return Call(self, kind, name, counted=False)

    def refused(self, kind: str, name: str, method: str = "") -> SetAsideError | None:
        """Why a plugin is not asked any more, None where it is."""
        if not self.set_aside:
            return None
        said = self.set_aside.get((kind, name)) or self.set_aside.get((kind, name, method))
        return None if said is None else SetAsideError(said, (kind, name))

    @contextmanager
    def armed(self) -> Iterator[None]:
        """Calls within are limited in time, and Ctrl-C does no harm; does nothing outside of the main thread.

        Who has a handler for Ctrl-C of their own keeps it.
        """
        if self._is_armed or threading.current_thread() is not threading.main_thread():
            yield
            return
        alarm, ctrl_c = signal.signal(signal.SIGALRM, self._ring), signal.getsignal(signal.SIGINT)
        if ctrl_c is signal.default_int_handler:
            signal.signal(signal.SIGINT, _interrupted)
        self._is_armed, self._until_s = True, None
        try:
            yield
        finally:
            self._is_armed = False
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, alarm)
            if ctrl_c is signal.default_int_handler:
                signal.signal(signal.SIGINT, ctrl_c)

    def take_untold(self) -> list[tuple[str, FailedPluginError]]:
        """What sinks met since this was last called: they have no voice in the history themselves."""
        found, self.untold = self.untold, []
        return found

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
        asked: Asked = (*error.plugin, error.method) if error.method else error.plugin
        count = self.failures[asked] = self.failures.get(asked, 0) + 1
        if error.method != ALWAYS_ASKED and (error.took_too_long or count >= self.limits.failures):
            kind, name = error.plugin
            times = "took too long" if error.took_too_long else f"failed {count} times (limits.failures)"
            what = f" for its {error.method}" if error.method else ""
            self.set_aside[asked] = f"the {kind} {name!r} {times} and is not asked{what} again"

    def _ring(self, _number: int, frame: FrameType | None) -> None:
        late = self._until_s is not None and monotonic() >= self._until_s
        if late and frame is not None and frame.f_code.co_filename != __file__:  # else the call is just ending
            interrupt(OverTime(), frame, sparing=__file__)


def _interrupted(_number: int, frame: FrameType | None) -> None:
    """Ctrl-C in a program that has no handler of its own."""
    interrupt(KeyboardInterrupt(), frame)


class Call:
    """What ``Guard.calling`` enters, for every scan and merge: a generator would cost ten times as much."""

    __slots__ = ("_began_s", "_counted", "_guard", "_kind", "_method", "_name", "_timed")

    def __init__(self, guard: Guard, kind: str, name: str, method: str = "", counted: bool = True) -> None:
        self._guard, self._kind, self._name, self._method = guard, kind, name, method
        self._counted, self._timed, self._began_s = counted, False, 0.0

    def __enter__(self) -> None:
        if self._counted:
            self._timed, self._began_s = self._guard.start(), monotonic()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._timed:
            self._guard.stop()
        if error is None or isinstance(error, MapError | FailedPluginError | SetAsideError | KeyboardInterrupt):
            return
        if isinstance(error, SystemError) and (signalled := _signalled(error)) is not None:
            if isinstance(signalled, KeyboardInterrupt) or not self._is_to_blame():
                raise signalled from None
            error = signalled
        what, plugin = f"the {self._kind} {self._name!r}", (self._kind, self._name)
        if isinstance(error, OverTime):
            if not self._is_to_blame():
                return
            seconds = f"{self._guard.limits.plugin_s:g} s"
            sentence = f"{what} took longer than {seconds}: raise limits.plugin_s if it may"
            raise FailedPluginError(sentence, plugin, self._method, took_too_long=True) from error
        if isinstance(error, PluginError):
            raise FailedPluginError(f"{what} {error}", plugin, self._method) from error
        if isinstance(error, Exception | SystemExit):
            said = f"{what} failed: {type(error).__name__}: {error}"
            raise FailedPluginError(said, plugin, self._method) from error

    def _is_to_blame(self) -> bool:
        """Whether the time went here: in the innermost call that took more than half of it, else in the outermost."""
        return self._timed or (self._counted and monotonic() - self._began_s > self._guard.limits.plugin_s / 2.0)


def _signalled(error: SystemError) -> OverTime | KeyboardInterrupt | None:
    """What a signal handler has raised where compiled code does not look for it; None where it was something else."""
    for hidden in (error.__cause__, error.__context__):
        if isinstance(hidden, OverTime | KeyboardInterrupt):
            return hidden
    return None
