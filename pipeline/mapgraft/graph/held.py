"""The layers of others that one robot holds, to attach them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from mapgraft.exchange import SentLayer
from mapgraft.graph.claims import Source


class Layers(Protocol):
    """What a robot holds of others: the newest layer of each source, as it came.

    ``changes`` rises whenever something newer has come.
    """

    @property
    def changes(self) -> int: ...
    def version(self, source: Source) -> int | None:
        """After how many observations the layer was; None where there is none."""
        ...

    def sent(self, source: Source) -> SentLayer | None:
        """The layer; None where there is none."""
        ...


class HeldLayers:
    """Whole layers in memory; a join: whatever the order in which they come, the newest of each source is kept.

    Of two robots that are called the same the one with the smaller writer is the source.
    """

    __slots__ = ("_held", "changes")

    def __init__(self) -> None:
        self._held: dict[Source, SentLayer] = {}
        self.changes = 0

    def add(self, sent: SentLayer) -> bool:
        """Keep a layer if it is newer than what is held, or its source's by better right."""
        source = Source(sent.provenance.source, sent.provenance.epoch)
        held = self._held.get(source)
        if held is not None and _rank(held) <= _rank(sent):
            return False
        self._held[source] = sent
        self.changes += 1
        return True

    def belongs(self, source: Source, writer: bytes) -> None:
        """A source is that writer's: forget what is held of it by one of a larger id."""
        held = self._held.get(source)
        if held is not None and held.writer > writer:
            del self._held[source]
            self.changes += 1

    def version(self, source: Source) -> int | None:
        return self._held[source].provenance.version if source in self._held else None

    def sent(self, source: Source) -> SentLayer | None:
        return self._held.get(source)

    def corrections(self, source: Source) -> int:
        """How often the map of which the layer is had been corrected; 0 where there is none."""
        return self._held[source].corrections if source in self._held else 0

    def __iter__(self) -> Iterator[Source]:
        return iter(sorted(self._held))


def _rank(sent: SentLayer) -> tuple[bytes, int]:
    """Of two layers of one source the smaller rank is kept."""
    return sent.writer, -sent.provenance.version
