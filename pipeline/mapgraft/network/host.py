"""What a node asks of its robot: the seam between how robots talk and what they make of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Literal, Protocol

from mapgraft.exchange import Form
from mapgraft.graph.claims import Claims, Source
from mapgraft.network.replica import Whole
from mapgraft.network.wire import Aspect

Wish = Literal["layer", "preview", "nothing"]


class Host(Protocol):
    """What a node asks of its robot. Whatever it raises ends the robot's part, and comes through."""

    @property
    def claims(self) -> Claims: ...
    def offer(self) -> bytes:
        """What there is to tell of the robot's map (``mapgraft.exchange.Offer``), its source and version in it."""
        ...

    def cut(self, aspect: Aspect, stamp_ns: int) -> tuple[Form, Mapping[bytes, bytes]]:
        """The offered layer, or its preview, as it travels; MapError for a preview that cannot be had ends nothing."""
        ...

    def wants(self, offer: bytes, size: int, stamp_ns: int) -> Wish:
        """What is wanted of a map that is offered; ``size`` is how many bytes told of it."""
        ...

    def consider(self, whole: Whole, aspect: Aspect, size: int, stamp_ns: int) -> Wish:
        """A layer or preview that was wanted is here, for so many bytes; says what is wanted now of that source."""
        ...

    def passed_on(self, whole: Whole, size: int, stamp_ns: int) -> None:
        """A layer of a third robot is here, for so many bytes."""
        ...

    def refused(self, offer: bytes, reason: str, stamp_ns: int) -> None:
        """A layer or preview that was wanted cannot be had."""
        ...

    def heard(self, stamp_ns: int) -> None:
        """Draw the consequences of all claims and layers that are known by now; asked whenever something new may be."""
        ...

    def lacks(self) -> Collection[Source]:
        """The third robots whose layers are of use: of those whatever is newer than what is held is asked for."""
        ...

    def renamed(self, source: Source, stamp_ns: int) -> None:
        """Another robot of the same name has it by right: this one is that other source from now on."""
        ...

    def belongs(self, source: Source, writer: bytes, stamp_ns: int) -> None:
        """Another writer than until now turns out to be a source: what came from others as its is none of its."""
        ...
