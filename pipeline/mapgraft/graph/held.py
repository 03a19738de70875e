"""The layers of others that one robot holds, to attach them and to pass them on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from mapgraft.exchange import LayerMessage
from mapgraft.graph.claims import Source


class Layers(Protocol):
    """What a robot holds of others: the newest layer of each source, as the message in which it came.

    ``changes`` rises whenever something newer has come.
    """

    @property
    def changes(self) -> int: ...
    def version(self, source: Source) -> int | None:
        """After how many observations the layer was; None where there is none."""
        ...

    def message(self, source: Source) -> bytes | None:
        """The encoded ``LayerMessage``; None where there is none."""
        ...


class HeldLayers:
    """Whole layers in memory; a join: whatever the order in which they come, the newest of each source is kept."""

    __slots__ = ("_held", "changes")

    def __init__(self) -> None:
        self._held: dict[Source, tuple[int, bytes]] = {}
        self.changes = 0

    def add(self, message: bytes) -> bool:
        """Keep a layer if it is newer than what is held; raises MapError when the bytes are none."""
        name, epoch, version = LayerMessage.decode(message).provenance
        source = Source(name, epoch)
        if (held := self._held.get(source)) is not None and (held[0], held[1]) >= (version, message):
            return False
        self._held[source] = (version, message)
        self.changes += 1
        return True

    def version(self, source: Source) -> int | None:
        return self._held[source][0] if source in self._held else None

    def message(self, source: Source) -> bytes | None:
        return self._held[source][1] if source in self._held else None

    def __iter__(self) -> Iterator[Source]:
        return iter(sorted(self._held))
