"""Which messages of a file are wanted, and in which chunks they can be."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from mapgraft.contracts.sources import Channel
from mapgraft.recording.containers.chunks import Place

_FOREVER_NS = 2**64


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which messages to take: the channels by id, and the window of log time, both ends included.

    ``declared`` are the ids of all channels of the file, so that messages of no channel can be told.
    """

    channels: Mapping[int, Channel]
    declared: frozenset[int]
    start_ns: int
    end_ns: int

    @property
    def is_open(self) -> bool:
        """Whether the window has no end to either side."""
        return self.start_ns == -_FOREVER_NS and self.end_ns == _FOREVER_NS


def wanted(
    channels: Sequence[Channel],
    topics: Collection[str] | None,
    start_ns: int | None,
    end_ns: int | None,
    types: Collection[str] | None = None,
) -> Wanted:
    """The decodable channels of these topics and message types (None: all) in this window (None: open)."""
    chosen = {
        c.id: c
        for c in channels
        if c.decodable and (topics is None or c.topic in topics) and (types is None or c.message_type in types)
    }
    declared = frozenset(c.id for c in channels)
    return Wanted(
        chosen, declared, -_FOREVER_NS if start_ns is None else start_ns, _FOREVER_NS if end_ns is None else end_ns
    )


def places_of(places: Sequence[Place], want: Wanted, vouched: bool = True) -> list[Place]:
    """The chunks that may hold wanted messages; all in the window, unless what they say of channels is vouched for."""
    if not want.channels:
        return []
    return [
        place
        for place in places
        if place.end_ns >= want.start_ns
        and place.start_ns <= want.end_ns
        and (not vouched or place.channels is None or not want.channels.keys().isdisjoint(place.channels))
    ]
