"""Who writes as which source, as far as one robot has heard: two robots may have been given one name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from mapgraft.graph.claims import Source
from mapgraft.network.wire import WRITER

NOBODY: Final = bytes(WRITER)
MOST_SOURCES: Final = 4096


@dataclass(slots=True)
class Writers:
    """Of several robots that say they are one source it is the one with the smallest id, whoever was heard of first.

    ``shared`` are the sources of which several robots have said so.
    """

    shared: set[Source] = field(default_factory=set)
    _by_source: dict[Source, bytes] = field(default_factory=dict)

    @property
    def sources(self) -> frozenset[Source]:
        """All sources that somebody writes as."""
        return frozenset(self._by_source)

    def of(self, source: Source) -> bytes:
        """Who is a source by all that was heard; ``NOBODY`` where nothing was."""
        return self._by_source.get(source, NOBODY)

    def hear(self, source: Source, writer: bytes, of_several: bool = False) -> bool:
        """Somebody writes as a source, ``of_several`` that do; True where it is that one's by all that is known now.

        More sources than ``MOST_SOURCES`` are not told apart.
        """
        known = self._by_source.get(source)
        if writer == NOBODY or (known is None and len(self._by_source) >= MOST_SOURCES):
            return True
        if of_several or known not in (None, writer):
            self.shared.add(source)
        self._by_source[source] = writer if known is None else min(known, writer)
        return writer == self._by_source[source]
