"""How long the stages of a run took. Nothing that is decided or mapped ever looks at it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import TypeVar

Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class Stage:
    """Wall clock of one stage, and how many things were done in it."""

    name: str
    elapsed_s: float
    count: int


class Stopwatch:
    """Adds up the wall clock of named stages; stages may lie within each other."""

    __slots__ = ("_counts", "_elapsed_s")

    def __init__(self) -> None:
        self._elapsed_s: dict[str, float] = {}
        self._counts: dict[str, int] = {}

    @property
    def stages(self) -> list[Stage]:
        """All stages, in the order in which they were first over."""
        return [Stage(name, elapsed_s, self._counts[name]) for name, elapsed_s in self._elapsed_s.items()]

    def elapsed_s(self, name: str) -> float:
        """What a stage took so far; 0 when there was none of that name."""
        return self._elapsed_s.get(name, 0.0)

    def add(self, name: str, elapsed_s: float, count: int) -> None:
        self._elapsed_s[name] = self._elapsed_s.get(name, 0.0) + elapsed_s
        self._counts[name] = self._counts.get(name, 0) + count

    @contextmanager
    def stage(self, name: str, count: int = 1) -> Iterator[None]:
        """What happens inside belongs to the stage, also when it fails."""
        began_s = perf_counter()
        try:
            yield
        finally:
            self.add(name, perf_counter() - began_s, count)

    def waiting(self, name: str, items: Iterable[Item]) -> Iterator[Item]:
        """The items; waiting for each belongs to the stage, what is done with it does not."""
        elapsed_s, count, clock = 0.0, 0, perf_counter
        try:
            began_s = clock()
            for item in items:
                elapsed_s += clock() - began_s
                count += 1
                yield item
                began_s = clock()
            elapsed_s += clock() - began_s
        finally:
            self.add(name, elapsed_s, count)
