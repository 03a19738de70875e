"""Which messages of a file are wanted, and in which chunks they can be."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from mapgraft.recording.containers.chunks import Place
from mapgraft.recording.source import Channel

_FOREVER_NS = 2**64


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which messages to take: the channels by id, and the window of log time, both ends included."""

    channels: Mapping[int, Channel]
    start_ns: int
    end_ns: int


def wanted(
    channels: Iterable[Channel], topics: Collection[str] | None, start_ns: int | None, end_ns: int | None
) -> Wanted:
    """The decodable channels of these topics (None: all) in this window (None: open)."""
    chosen = {c.id: c for c in channels if c.decodable and (topics is None or c.topic in topics)}
    return Wanted(chosen, -_FOREVER_NS if start_ns is None else start_ns, _FOREVER_NS if end_ns is None else end_ns)


def places_of(places: Sequence[Place], want: Wanted) -> list[Place]:
    """The chunks that may hold wanted messages."""
    if not want.channels:
        return []
    return [
        place
        for place in places
        if place.end_ns >= want.start_ns
        and place.start_ns <= want.end_ns
        and (place.channels is None or not want.channels.keys().isdisjoint(place.channels))
    ]
