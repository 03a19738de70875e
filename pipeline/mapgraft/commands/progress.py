"""Showing how far a replay is."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Protocol, Self

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from mapgraft.console import cell, remarks
from mapgraft.contracts import Observation
from mapgraft.events import Event, Snapshot


class Counted(Protocol):
    """Takes how many things are done, of how many, and what they are."""

    def __call__(self, done: int, wanted: int, said: str = ..., /) -> None: ...


COMPILING = "kernels compile on first use, which takes about a minute"
REFRESH_EVERY = 16  # observations between two updates of the bar: drawing must not cost more than mapping


class ProgressSink:
    """A sink that draws a bar on stderr: share of data time replayed, scans per second, time left, merges so far.

    Where stderr is no terminal it is one line, when the work begins.
    """

    def __init__(self, *, quiet: bool) -> None:
        console = remarks()
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[rate]}", style="dim"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[merges]}"),
            console=console,
            transient=True,
        )
        # The first observation waits for the kernels, which are compiled once per machine and then kept.
        waiting = "starting (kernels compile on first use)"
        self._task = self._bar.add_task(waiting, total=None, merges="", rate="")
        self._quiet = quiet or not console.is_terminal
        self._says = not quiet and not console.is_terminal
        self._count = self._made = self._reverted = 0
        self._start_ns = 0
        self._began_s = time.monotonic()

    def __enter__(self) -> Self:
        if not self._quiet:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if not self._quiet:
            self._bar.stop()

    def spans(self, start_ns: int, end_ns: int) -> None:
        """The data time that will be replayed."""
        self._start_ns = start_ns
        self._bar.update(self._task, total=max(1, end_ns - start_ns))
        if self._says:
            _say(f"replaying {max(0, end_ns - start_ns) / 1e9:,.1f} s")

    def observed(self, observation: Observation) -> None:
        self._count += 1
        if self._count == 1:
            self._began_s = time.monotonic()
            self._bar.update(self._task, description="replaying")
        if self._count % REFRESH_EVERY == 0:
            rate = self._count / max(time.monotonic() - self._began_s, 1e-3)
            done_ns = observation.stamp_ns - self._start_ns
            self._bar.update(self._task, completed=done_ns, rate=f"{self._count:,} scans, {rate:,.0f}/s")

    def happened(self, event: Event) -> None:
        self._made += event.kind == "merged"
        self._reverted += event.kind == "reverted"
        if event.kind in ("merged", "reverted"):
            self._bar.update(self._task, merges=f"{self._made} merged, {self._reverted} reverted")

    def mapped(self, snapshot: Snapshot) -> None:
        pass


@contextmanager
def counting(waiting: str, what: str, *, quiet: bool) -> Iterator[Counted]:
    """A bar on stderr for things that are counted: tell it how many are done, of how many, and what they are.

    It shows what is ``waiting`` until one is done, and ``what`` where nothing else is told. Where stderr is no terminal
    it is one line, when somebody tells before the first that none is done.
    """
    console = remarks()
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=quiet or not console.is_terminal,
    )
    with bar:
        task = bar.add_task(waiting, total=None)

        def count(done: int, wanted: int, said: str = what) -> None:
            bar.update(task, completed=done, total=wanted, description=said if done else waiting)
            if done == 0 and not quiet and not console.is_terminal:
                _say(f"{wanted:,} {what} to do")

        yield count


def _say(begun: str) -> None:
    """Tell a log what has begun, and why nothing may happen for a while."""
    remarks().print(cell(f"mapgraft: {begun} ({COMPILING})"), soft_wrap=True)
