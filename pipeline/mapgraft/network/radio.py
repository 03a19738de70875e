"""The simulated medium: messages as discrete events in data time, with all that happens to them on a real one."""

from __future__ import annotations

import heapq
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

NS_PER_S: Final = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Partition:
    """From ``start_ns`` until before ``end_ns`` (None: to the end) only robots of one group hear each other.

    Times count from the mission's beginning.
    Who is in no group hears nobody.
    """

    start_ns: int
    end_ns: int | None
    groups: tuple[frozenset[str], ...]

    def separates(self, one: str, other: str, now_ns: int) -> bool:
        if now_ns < self.start_ns or (self.end_ns is not None and now_ns >= self.end_ns):
            return False
        return not any(one in group and other in group for group in self.groups)


@dataclass(frozen=True, slots=True)
class Conditions:
    """What the medium does to messages; by default nothing: it is perfect, instant and of any width.

    A message arrives ``latency_ns`` after it was sent, and up to ``jitter_ns`` later, so that messages overtake each
    other. ``bandwidth_bytes_s`` is what one robot's radio sends; what waits for it waits in line. ``loss``,
    ``duplication`` and ``reordering`` are probabilities per message: it never arrives, it arrives twice, it is held up
    for ``held_up_ns`` more. Equal ``seed`` and equal messages have equal fates.
    """

    latency_ns: int = 0
    jitter_ns: int = 0
    bandwidth_bytes_s: float | None = None
    loss: float = 0.0
    duplication: float = 0.0
    reordering: float = 0.0
    held_up_ns: int = NS_PER_S
    partitions: tuple[Partition, ...] = ()
    seed: int = 0

    @property
    def is_perfect(self) -> bool:
        """Whether every message arrives once, and at once."""
        fates = (self.latency_ns, self.jitter_ns, self.loss, self.duplication, self.reordering)
        return not any(fates) and self.bandwidth_bytes_s is None and not self.partitions


class Delivery(NamedTuple):
    """A message that has arrived."""

    arrival_ns: int
    number: int
    sender: str
    receiver: str
    data: bytes


@dataclass(slots=True)
class Fates:
    """What became of messages, counted."""

    sent: int = 0
    delivered: int = 0
    lost: int = 0
    out_of_contact: int = 0
    duplicated: int = 0


class Radio:
    """Carries messages between robots that are in contact, in the order of their arrival."""

    def __init__(self, conditions: Conditions | None = None) -> None:
        self.conditions = conditions or Conditions()
        self.fates = Fates()
        self._random = random.Random(self.conditions.seed)
        self._contacts: dict[str, dict[str, int]] = {}  # robot → until when it is in contact with whom
        self._free_ns: dict[str, int] = {}  # when a robot's radio has sent all that waits
        self._coming: list[Delivery] = []
        self._number = 0
        self._start_ns = 0

    def begin(self, start_ns: int) -> None:
        """The times of partitions count from here."""
        self._start_ns = start_ns

    def connect(self, one: str, other: str, until_ns: int) -> None:
        """Two robots are in contact up to and including that time, or longer if they were to be."""
        for robot, peer in ((one, other), (other, one)):
            mine = self._contacts.setdefault(robot, {})
            mine[peer] = max(until_ns, mine.get(peer, until_ns))

    def hears(self, one: str, other: str, now_ns: int) -> bool:
        """Whether what one of them sends now reaches the other."""
        until_ns = self._contacts.get(one, {}).get(other)
        if until_ns is None or now_ns > until_ns:
            return False
        return not any(
            partition.separates(one, other, now_ns - self._start_ns) for partition in self.conditions.partitions
        )

    def neighbours(self, robot: str, now_ns: int) -> Sequence[str]:
        """Who is in contact with a robot now, by name."""
        return [other for other in sorted(self._contacts.get(robot, ())) if self.hears(robot, other, now_ns)]

    def send(self, sender: str, receiver: str, data: bytes, now_ns: int) -> bool:
        """Give a message to the medium; False where the two are out of contact before it has left.

        The sender learns no more than that: whether a message was lost on its way is known only to the counts.
        """
        conditions = self.conditions
        leaves_ns = self._leaves(sender, len(data), now_ns)
        if not self.hears(sender, receiver, now_ns) or not self.hears(sender, receiver, leaves_ns):
            self.fates.out_of_contact += 1
            return False
        self._free_ns[sender] = leaves_ns
        self.fates.sent += 1
        if self._happens(conditions.loss):
            self.fates.lost += 1
            return True
        copies = 2 if self._happens(conditions.duplication) else 1
        self.fates.duplicated += copies - 1
        for _ in range(copies):
            late_ns = round(self._random.random() * conditions.jitter_ns) if conditions.jitter_ns else 0
            late_ns += conditions.held_up_ns if self._happens(conditions.reordering) else 0
            self._number += 1
            arrival_ns = leaves_ns + conditions.latency_ns + late_ns
            heapq.heappush(self._coming, Delivery(arrival_ns, self._number, sender, receiver, data))
        return True

    def due(self, until_ns: int) -> Iterator[Delivery]:
        """What arrives up to and including that time, also what is sent meanwhile; by time, then as it was sent.

        What arrives after its contact has ended, or across a partition, is lost.
        """
        while self._coming and self._coming[0].arrival_ns <= until_ns:
            delivery = heapq.heappop(self._coming)
            if not self.hears(delivery.sender, delivery.receiver, delivery.arrival_ns):
                self.fates.out_of_contact += 1
                continue
            self.fates.delivered += 1
            yield delivery

    @property
    def next_ns(self) -> int | None:
        """When the next message arrives; None where none is on its way."""
        return self._coming[0].arrival_ns if self._coming else None

    def _leaves(self, sender: str, size: int, now_ns: int) -> int:
        """When the last byte of a message has left, behind all that waits before it."""
        if self.conditions.bandwidth_bytes_s is None:
            return now_ns
        begins_ns = max(now_ns, self._free_ns.get(sender, now_ns))
        return begins_ns + round(size / self.conditions.bandwidth_bytes_s * NS_PER_S)

    def _happens(self, probability: float) -> bool:
        """A chance is drawn only where there is one, so that a perfect medium draws none."""
        return probability > 0.0 and self._random.random() < probability


class Unread(NamedTuple):
    """What came to a robot for nothing: messages that cannot be read, claims that are none or more than it keeps."""

    messages: int
    claims: int


@dataclass(slots=True)
class Traffic:
    """How many bytes were sent, by sender, receiver and kind of message, and by receiver what came for nothing."""

    bytes: dict[tuple[str, str, str], int] = field(default_factory=dict)
    unread: dict[str, Unread] = field(default_factory=dict)

    def count(self, sender: str, receiver: str, kind: str, size: int) -> None:
        """Count one message."""
        self.bytes[sender, receiver, kind] = self.bytes.get((sender, receiver, kind), 0) + size

    @property
    def sent(self) -> dict[tuple[str, str], int]:
        """By sender and receiver."""
        return _summed((sender, receiver, size) for (sender, receiver, _), size in self.bytes.items())

    @property
    def received(self) -> dict[tuple[str, str], int]:
        """By receiver and kind."""
        return _summed((receiver, kind, size) for (_, receiver, kind), size in self.bytes.items())

    def sentences(self) -> list[str]:
        """What a person should know."""
        said = (("message", "that cannot be read"), ("claim", "that cannot be read, or above what it keeps"))
        return [
            f"{robot}: {count:,} {what}{'s' * (count != 1)} came {how}"
            for robot, unread in sorted(self.unread.items())
            for (what, how), count in zip(said, unread, strict=True)
            if count
        ]


def _summed(items: Iterable[tuple[str, str, int]]) -> dict[tuple[str, str], int]:
    out: dict[tuple[str, str], int] = {}
    for one, other, size in items:
        out[one, other] = out.get((one, other), 0) + size
    return dict(sorted(out.items()))
