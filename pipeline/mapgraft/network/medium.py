"""The robots' nodes and the radio between them: contacts, and everything that follows from them, in data time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final

from mapgraft.contracts import MapError
from mapgraft.errors import PluginError, ReversalError
from mapgraft.network.node import Node
from mapgraft.network.radio import NS_PER_S, Radio, Traffic, Unread
from mapgraft.network.wire import Message, encode, kind_of

MOST_ROUNDS: Final = 64  # of telling within one meeting on a perfect radio; what is left is told at the next one
Failed = Callable[[str, PluginError | MapError | ReversalError, int], None]


@dataclass(slots=True)
class Medium:
    """Lets robots meet. A contact lasts ``window_ns``; where the radio is perfect, all that follows happens at once.

    ``is_out`` says of a robot whether it takes no part any more; ``failed`` is told when what it was asked made it
    fail.
    """

    nodes: Mapping[str, Node]
    is_out: Callable[[str], bool]
    failed: Failed
    radio: Radio = field(default_factory=Radio)
    window_ns: int = 30 * NS_PER_S
    traffic: Traffic = field(default_factory=Traffic)

    def hold(self, pairs: Sequence[tuple[str, str]], now_ns: int) -> None:
        """Every donor greets its receivers, (receiver, donor) by (receiver, donor); what it offers is as of now.

        Where the radio is perfect, each greeting has all its consequences before the next one is heard.
        """
        at_once = self.radio.conditions.is_perfect
        until_ns = now_ns if at_once else now_ns + self.window_ns
        hellos: list[tuple[str, str, Message]] = []
        for receiver, donor in pairs:
            if self.is_out(donor) or self.is_out(receiver):
                continue
            self.radio.connect(receiver, donor, until_ns)
            with self._asking(donor, now_ns):
                hellos.append((donor, receiver, self.nodes[donor].greeting(receiver)))
                self._flush(donor, now_ns)
        if at_once:
            self._deliver(now_ns)
        for donor, receiver, hello in hellos:
            if not (self.is_out(donor) or self.is_out(receiver)):
                self._send(donor, receiver, hello, now_ns)
                if at_once:
                    self._deliver(now_ns)
        if at_once:
            self._settle(dict.fromkeys(name for pair in pairs for name in pair), now_ns)

    def until(self, now_ns: int) -> None:
        """Everything that is due up to now, in its order."""
        while (at_ns := self.next_ns()) is not None and at_ns <= now_ns:
            self._deliver(at_ns)
            for name in sorted(self.nodes):
                wake_ns = self.nodes[name].wake_ns
                if wake_ns is not None and wake_ns <= at_ns:
                    self._wake(name, at_ns)

    def next_ns(self) -> int | None:
        """When something is to happen next; None where it happens at once, in the meeting."""
        if self.radio.conditions.is_perfect:
            return None
        wakes = [node.wake_ns for name, node in self.nodes.items() if not self.is_out(name)]
        due = [at_ns for at_ns in (*wakes, self.radio.next_ns) if at_ns is not None]
        return min(due, default=None)

    def _deliver(self, until_ns: int) -> None:
        for delivery in self.radio.due(until_ns):
            name = delivery.receiver
            if not self.is_out(name):
                with self._asking(name, delivery.arrival_ns):
                    self.nodes[name].hear(delivery.sender, delivery.data, delivery.arrival_ns)
                self._count_unread(name)
                self._flush(name, delivery.arrival_ns)

    def _count_unread(self, name: str) -> None:
        node = self.nodes[name]
        if node.unreadable or node.gossip.refused:
            self.traffic.unread[name] = Unread(node.unreadable, node.gossip.refused)

    def _settle(self, names: Sequence[str] | Mapping[str, None], now_ns: int) -> None:
        """Until nobody who has met has anything to say."""
        for _ in range(MOST_ROUNDS):
            said = [self._wake(name, now_ns) for name in names if not self.is_out(name)]
            self._deliver(now_ns)
            if not any(said):
                return

    def _wake(self, name: str, now_ns: int) -> bool:
        said, node = False, self.nodes[name]
        if self.is_out(name):
            node.wake_ns = None
            return False
        with self._asking(name, now_ns):
            said = node.settle(now_ns, self.radio.neighbours(name, now_ns))
        self._flush(name, now_ns)
        return said

    def _flush(self, name: str, now_ns: int) -> None:
        for receiver, message in self.nodes[name].said():
            self._send(name, receiver, message, now_ns)

    def _send(self, sender: str, receiver: str, message: Message, now_ns: int) -> None:
        data = encode(message)
        if self.radio.send(sender, receiver, data, now_ns):
            self.traffic.count(sender, receiver, kind_of(message), len(data))

    @contextmanager
    def _asking(self, name: str, now_ns: int) -> Iterator[None]:
        """What comes through is the fault of the robot's own map type: its part in the run ends, the others go on."""
        try:
            yield
        except (PluginError, MapError, ReversalError) as error:
            self.failed(name, error, now_ns)
