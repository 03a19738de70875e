"""Showing how far a replay is."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from mapgraft.console import remarks
from mapgraft.contracts import Observation
from mapgraft.events import Event, Snapshot

REFRESH_EVERY = 16  # observations between two updates of the bar: drawing must not cost more than mapping


class Rate(ProgressColumn):
    """Observations per second."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:,.0f} scans/s", style="dim")


class ProgressSink:
    """A sink that draws a bar on stderr: observations, their rate, the time left, merges so far."""

    def __init__(self, total: int | None, *, quiet: bool) -> None:
        console = remarks()
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed:,.0f}" + (f"/{total:,}" if total else "")),
            Rate(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[merges]}"),
            console=console,
            transient=True,
        )
        # The first observation waits for the kernels, which are compiled once per machine and then kept.
        self._task = self._bar.add_task("starting (kernels compile on first use)", total=total, merges="")
        self._count = self._made = self._reverted = 0
        self._quiet = quiet or not console.is_terminal

    def __enter__(self) -> Self:
        if not self._quiet:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if not self._quiet:
            self._bar.stop()

    def observed(self, observation: Observation) -> None:
        self._count += 1
        if self._count == 1:
            self._bar.update(self._task, description="replaying")
        if self._count % REFRESH_EVERY == 0:
            self._bar.update(self._task, completed=self._count)

    def happened(self, event: Event) -> None:
        self._made += event.kind == "merged"
        self._reverted += event.kind == "reverted"
        if event.kind in ("merged", "reverted"):
            self._bar.update(self._task, merges=f"{self._made} merged, {self._reverted} reverted")

    def mapped(self, snapshot: Snapshot) -> None:
        pass
