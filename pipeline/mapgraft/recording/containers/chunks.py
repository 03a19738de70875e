"""Chunked files in order of log time, with a bounded number of chunks in memory.

MCAP files and ROS 1 bags are both rows of chunks. Chunks may overlap in time, because recorders write with several
threads or keep a chunk per topic; so there is a heap of chunks, not of messages, and a chunk that has to wait for too
many others is dropped and read again when its turn comes.
"""

from __future__ import annotations

import heapq
from bisect import bisect_left, bisect_right
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from operator import attrgetter
from typing import Generic, NamedTuple, Protocol, Self, TypeVar

from mapgraft.contracts.sources import ReadFaults
from mapgraft.recording.containers.inflate import Content

RESIDENT_BYTES = 32 << 20
"""How much decompressed data may wait at a time, beside the one chunk that is being read."""

READERS = 2
READ_AHEAD = 4
"""How many threads decompress how many chunks ahead; they let the interpreter go on meanwhile."""

MESSAGES_LOST = "messages_lost"
"""The cause of faults whose count is one of messages."""

_MESSAGE_BYTES = 300  # about what a message and its view cost in memory
_log_ns = attrgetter("log_ns")


class Place(NamedTuple):
    """Where a chunk lies in its file, and what is known of it before it is read.

    ``offset`` and ``end`` enclose the chunk's record. ``channels`` maps the ids of the channels it holds messages of to
    where the index of these messages lies (0: unknown); None where only reading the chunk could tell.
    """

    offset: int
    end: int
    start_ns: int
    end_ns: int
    channels: Mapping[int, int] | None


class Timed(Protocol):
    @property
    def log_ns(self) -> int: ...


T = TypeVar("T", bound=Timed)
Fetch = Callable[[Place, int | None], Content]  # at most so many bytes; runs in other threads: no shared state
Parse = Callable[[Place, Content], list[T]]  # in log-time order; the same list each time


def in_log_order(places: Sequence[Place], fetch: Fetch, parse: Parse[T], late: Callable[[Place], None]) -> Iterator[T]:
    """What the chunks hold by log time, then by the chunk's offset, then by its order in the chunk.

    ``late`` is called for a chunk that holds messages from before its stated start which come too late.
    """
    waiting = deque(sorted(places, key=lambda place: (place.start_ns, place.offset)))
    heap: list[tuple[int, int]] = []
    last_ns: int | None = None
    with _Reader(fetch, parse, waiting) as reader:
        while waiting or heap:
            while waiting and (not heap or waiting[0].start_ns <= heap[0][0]):
                cursor = reader.open(waiting.popleft())
                if cursor is not None:
                    heapq.heappush(heap, (cursor.head_ns, cursor.place.offset))
            if not heap:
                continue
            head_ns, offset = heapq.heappop(heap)
            cursor, messages = reader.resume(offset)
            if last_ns is not None and head_ns < last_ns:
                late(cursor.place)
            stop = _run_end(messages, cursor, heap, waiting)
            yield from messages if stop - cursor.position == len(messages) else messages[cursor.position : stop]
            last_ns = messages[stop - 1].log_ns if last_ns is None else max(last_ns, messages[stop - 1].log_ns)
            if stop < len(messages):
                cursor.position, cursor.head_ns = stop, messages[stop].log_ns
                heapq.heappush(heap, (cursor.head_ns, offset))
            else:
                reader.close(offset)
            del messages


def _run_end(messages: list[T], cursor: _Cursor[T], heap: list[tuple[int, int]], waiting: deque[Place]) -> int:
    """Up to where the messages of this chunk come before everything else."""
    stop = len(messages)
    if heap:
        rival_ns, rival_offset = heap[0]
        side = bisect_right if cursor.place.offset < rival_offset else bisect_left
        stop = side(messages, rival_ns, cursor.position, stop, key=_log_ns)
    if waiting:
        stop = bisect_left(messages, waiting[0].start_ns, cursor.position, stop, key=_log_ns)
    return stop


class _Cursor(Generic[T]):
    """An opened chunk: how far it has been read, and its messages while they are in memory."""

    __slots__ = ("cost", "head_ns", "messages", "place", "position")

    def __init__(self, place: Place, messages: list[T], cost: int) -> None:
        self.place = place
        self.position = 0
        self.head_ns = messages[0].log_ns
        self.messages: list[T] | None = messages
        self.cost = cost


class _Reader(Generic[T]):
    """Opens chunks, reads ahead, and keeps what waits within ``RESIDENT_BYTES``."""

    def __init__(self, fetch: Fetch, parse: Parse[T], waiting: deque[Place]) -> None:
        self._fetch = fetch
        self._parse = parse
        self._waiting = waiting
        self._open: dict[int, _Cursor[T]] = {}
        self._resident: OrderedDict[int, int] = OrderedDict()  # offset → cost, least recently used first
        self._cost = 0
        self._ahead: dict[int, Future[Content]] = {}
        self._pool: ThreadPoolExecutor | None = None

    def open(self, place: Place) -> _Cursor[T] | None:
        """Read a chunk for the first time; None when nothing of it is wanted."""
        future = self._ahead.pop(place.offset, None)
        if self._pool is not None:
            self._read_ahead(self._pool)
        content = None if future is None else future.result()
        if content is None or content.damage:  # also what is too large to be read before its turn
            content = self._fetch(place, None)
        small = len(content.data) * READ_AHEAD <= RESIDENT_BYTES
        if content.costly and small and self._pool is None and len(self._waiting) > READ_AHEAD:
            self._pool = ThreadPoolExecutor(READERS, "mapgraft-read")
        messages = self._parse(place, content)
        if not messages:
            return None
        cursor = _Cursor(place, messages, len(content.data) + _MESSAGE_BYTES * len(messages))
        self._open[place.offset] = cursor
        self._keep(cursor)
        return cursor

    def _read_ahead(self, pool: ThreadPoolExecutor) -> None:
        for place in islice(self._waiting, READ_AHEAD):
            if place.offset not in self._ahead:
                self._ahead[place.offset] = pool.submit(self._fetch, place, RESIDENT_BYTES // READ_AHEAD)

    def resume(self, offset: int) -> tuple[_Cursor[T], list[T]]:
        """A chunk opened before, with its messages, read again if they had to go."""
        cursor = self._open[offset]
        if cursor.messages is None:
            cursor.messages = self._parse(cursor.place, self._fetch(cursor.place, None))
        self._keep(cursor)
        return cursor, cursor.messages

    def _keep(self, cursor: _Cursor[T]) -> None:
        offset = cursor.place.offset
        if offset not in self._resident:
            self._resident[offset] = cursor.cost
            self._cost += cursor.cost
        self._resident.move_to_end(offset)
        while self._cost > RESIDENT_BYTES and len(self._resident) > 1:
            oldest, cost = self._resident.popitem(last=False)
            self._cost -= cost
            self._open[oldest].messages = None

    def close(self, offset: int) -> None:
        self._cost -= self._resident.pop(offset)
        self._open.pop(offset).messages = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)


def note_damage(faults: ReadFaults, offset: int, content: Content) -> None:
    """Count a damaged chunk, which could not be read, or not wholly."""
    if content.data:
        sentence = f"the chunk at byte {offset} {content.damage}: only its beginning is read"
        faults.add("chunk_partial", sentence, place=offset)
    else:
        faults.add("chunk_damaged", f"the chunk at byte {offset} {content.damage}: it is left out", place=offset)


def note_lost(faults: ReadFaults, offset: int, topic: str, count: int) -> None:
    """Count messages of a topic that are known to lie in the damaged part of a chunk."""
    if count > 0:
        sentence = f"a message is lost with the chunk at byte {offset}"
        faults.add(MESSAGES_LOST, sentence, topic=topic, place=offset, count=count)


def note_late(faults: ReadFaults, place: Place) -> None:
    """Count a chunk whose stated start is later than its first message."""
    sentence = f"the chunk at byte {place.offset} holds messages from before its stated start: they come late"
    faults.add("late_messages", sentence, place=place.offset)


def note_strangers(faults: ReadFaults, offset: int, count: int) -> None:
    """Count messages of channels that the file does not describe."""
    if count:
        sentence = f"messages in the chunk at byte {offset} are of a channel that the file does not describe"
        faults.add("unknown_channel", sentence, place=offset, count=count)
