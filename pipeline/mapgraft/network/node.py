"""One robot on the network: what it says on contact, what it does with what it hears, and what it asks again."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from mapgraft.contracts import MapError
from mapgraft.errors import PluginError
from mapgraft.exchange import Offer
from mapgraft.graph.claims import Source
from mapgraft.lives import base_name, life_name
from mapgraft.network.gossip import Gossip
from mapgraft.network.host import Host
from mapgraft.network.meetings import Meetings, Met
from mapgraft.network.replica import Replica
from mapgraft.network.wire import (
    Copy,
    Head,
    Hello,
    Message,
    Namesake,
    Parts,
    Summary,
    Told,
    Want,
    decode,
)
from mapgraft.network.writers import NOBODY, Writers

MOST_TRIES: Final = 10  # times that the same is asked for in one contact
MOST_PEERS: Final = 4096
MOST_SHARED: Final = 64  # sources of which a peer is told that several robots say that they are it


class Outgoing(NamedTuple):
    """A message to be sent."""

    receiver: str
    message: Message


@dataclass(slots=True)
class Peer:
    """Who was met: which source it is, who writes it, what it offered, and when that was."""

    source: Source
    writer: bytes
    offer: bytes
    version: int
    heard_ns: int


@dataclass(slots=True)
class Question:
    """Something that was asked for and has not come: from whom, when, how often, and what of it is here.

    ``offer`` is that of a direct offer, empty where a third robot's layer is asked for. ``size`` counts the bytes that
    have come.
    """

    peer: str
    asked_ns: int
    offer: bytes = b""
    tries: int = 1
    size: int = 0
    came: set[int] = field(default_factory=set)
    version: int = 0
    plain: bool = False

    def awaits(self, peer: str, since_ns: int) -> bool:
        """Whether that peer was asked for what it offers itself, and asked or heard after some time."""
        return bool(self.offer) and self.peer == peer and self.asked_ns > since_ns

    def due_ns(self, patience_ns: int) -> int:
        """When to ask again: each time twice as long after the last word, for whoever answers slowly is not deaf."""
        return self.asked_ns + (patience_ns << (self.tries - 1))


@dataclass(slots=True)
class Node:
    """One robot's part in all conversations. It holds no clock: everything is said at a time of data.

    ``patience_ns`` is how long it waits for an answer before it asks again, the first time.
    """

    source: Source
    writer: bytes
    host: Host
    patience_ns: int = 0
    replica: Replica = field(default_factory=Replica)
    writers: Writers = field(default_factory=Writers)
    peers: dict[str, Peer] = field(default_factory=dict)
    outbox: list[Outgoing] = field(default_factory=list)
    wake_ns: int | None = None
    unreadable: int = 0  # messages
    _questions: dict[Copy, Question] = field(default_factory=dict)
    _asked: dict[tuple[Copy, str], int] = field(default_factory=dict)  # since which hello of that peer
    _spread: set[Source] = field(default_factory=set)  # those shared by several robots of which all here were told
    meetings: Meetings | None = None  # where robots see each other
    gossip: Gossip = field(init=False)

    def __post_init__(self) -> None:
        self.gossip = Gossip(self.host.claims)
        self.writers.hear(self.source, self.writer)

    def greeting(self, peer: str) -> Hello:
        """What to say to a peer on contact; what comes before it is in the outbox. Raises what the map type raises."""
        known = self.peers.get(peer)
        if self.meetings is not None:
            self._say(peer, *self.meetings.greeting(self.source, peer, known.source if known else None))
        self._say(peer, *self._namesakes(self.writers.shared))
        own, others, news = self.gossip.hello(peer, self.source, known.source if known else None)
        return Hello(self.writer, self.host.offer(), own, others, news)

    def hear(self, sender: str, data: bytes, now_ns: int) -> None:
        """Take in one message; what is to be said is in the outbox then. What cannot be read is counted."""
        try:
            message = _message(data)
            match message:
                case Hello():
                    self._greeted(sender, message, len(data), now_ns)
                case Summary():
                    self._say(sender, *self.gossip.answer(message))
                case Told():
                    self._learn(message.claims, now_ns)
                case Want():
                    self._asked_for(sender, message, now_ns)
                case Parts():
                    self._came(sender, message, len(data), now_ns)
                case Met() if self.meetings is not None:
                    self._say(sender, *self.meetings.heard(self.source, sender, message, now_ns))
                case Namesake():
                    self._writes(message.source, message.writer, now_ns, of_several=True)
                    self._wake(now_ns + self.patience_ns)
        except UnreadableError:
            self.unreadable += 1

    def settle(self, now_ns: int, neighbours: Sequence[str]) -> bool:
        """When nothing more comes: tell news, ask again for what is overdue, and when there is no more to tell, draw
        the consequences of what was heard and ask others for third robots' layers.

        Consequences that are drawn before everybody has told everything would be drawn twice. Returns whether there was
        anything to say.
        """
        before = len(self.outbox)
        self.wake_ns = None
        here = [peer for peer in neighbours if peer in self.peers]
        self._tell_news(here)
        for peer in here:
            self._say(peer, *self._namesakes(self.writers.shared - self._spread))
        self._spread |= self.writers.shared
        is_quiet = len(self.outbox) == before
        self._ask_again(now_ns, here)
        if is_quiet:
            self.host.heard(now_ns)
            for source in sorted(self.host.lacks()):
                self._ask_for(source, now_ns, here)
            self._tell_news(here)
        for question in self._questions.values():
            self._wake(max(now_ns + 1, question.due_ns(self.patience_ns)))
        if len(self.outbox) > before:
            self._wake(now_ns + self.patience_ns)
        return len(self.outbox) > before

    def _tell_news(self, here: Sequence[str]) -> None:
        for peer in here:
            while self.gossip.has_news_for(peer):
                self._say(peer, Told(self.gossip.news_for(peer)))

    def _namesakes(self, shared: Collection[Source]) -> Iterator[Namesake]:
        return (Namesake(source, self.writers.of(source)) for source in sorted(shared)[:MOST_SHARED])

    def said(self) -> list[Outgoing]:
        """Empty the outbox."""
        told, self.outbox = self.outbox, []
        return told

    def _greeted(self, sender: str, hello: Hello, size: int, now_ns: int) -> None:
        offer = _offer(hello.offer)
        source = Source(offer.provenance.source, offer.provenance.epoch)
        if (source, hello.writer) == (self.source, self.writer):
            return  # its own voice
        if not self._writes(source, hello.writer, now_ns):
            self._say(sender, Namesake(source, self.writers.of(source)))
            return
        if sender not in self.peers and len(self.peers) >= MOST_PEERS:
            return
        self.peers[sender] = Peer(source, hello.writer, hello.offer, offer.provenance.version, now_ns)
        self._learn(hello.claims, now_ns)
        self._say(sender, *self.gossip.heard(sender, self.source, source, hello))
        wish = self.host.wants(hello.offer, size, now_ns)
        self._wake(now_ns + self.patience_ns)
        if wish != "nothing":
            self._get(Copy(source, wish), sender, hello.offer, now_ns)

    def _get(self, copy: Copy, sender: str, offer: bytes, now_ns: int) -> None:
        """Consider what is held already where it is as new as the offer, else ask for it."""
        if self.replica.version(copy) >= _offer(offer).provenance.version:
            self._consider(copy, Question(sender, now_ns, offer), now_ns)
            return
        question = self._questions.get(copy)
        if question is not None and question.awaits(sender, now_ns - self.patience_ns):
            question.offer = offer  # it is on its way already
            return
        self._ask(copy, sender, now_ns, offer)

    def _ask(self, copy: Copy, peer: str, now_ns: int, offer: bytes = b"") -> None:
        self._questions[copy] = Question(peer, now_ns, offer)
        self._say(peer, self.replica.wish(copy, writer=self.writers.of(copy.source)))

    def _ask_again(self, now_ns: int, here: Sequence[str]) -> None:
        for copy, question in sorted(self._questions.items()):
            if question.peer not in here or question.tries >= MOST_TRIES:
                del self._questions[copy]
            elif now_ns >= question.due_ns(self.patience_ns) and now_ns > question.asked_ns:
                self._repeat(copy, question, now_ns)

    def _repeat(self, copy: Copy, question: Question, now_ns: int) -> None:
        question.asked_ns, question.tries, question.came = now_ns, question.tries + 1, set()
        self._say(question.peer, self.replica.wish(copy, question.plain, self.writers.of(copy.source)))

    def _ask_for(self, source: Source, now_ns: int, here: Sequence[str]) -> None:
        """Ask for a third robot's layer: itself where it is here, else everybody who is, one after the other."""
        copy = Copy(source, "layer")
        if source == self.source or copy in self._questions:
            return
        itself = [peer for peer in here if self.peers[peer].source == source]
        if itself and self.peers[itself[0]].version <= self.replica.version(copy):
            return
        for peer in itself or here:
            heard_ns = self.peers[peer].heard_ns
            if self._asked.get((copy, peer)) != heard_ns:
                self._asked[copy, peer] = heard_ns
                self._ask(copy, peer, now_ns)
                return

    def _asked_for(self, sender: str, want: Want, now_ns: int) -> None:
        """Answer from what is held; what is the robot's own is cut as it is now."""
        self._writes(want.copy.source, want.writer, now_ns)
        if want.copy.source == self.source:
            try:
                self._publish(want.copy, now_ns)
            except (PluginError, MapError) as error:
                self._say(sender, Parts(want.copy, want.since, reason=str(error)))
                if want.copy.aspect == "preview" and isinstance(error, MapError):
                    return
                raise
        self._say(sender, *self.replica.answer(want))

    def _publish(self, copy: Copy, now_ns: int) -> None:
        offer = self.host.offer()
        version = _offer(offer).provenance.version
        if self.replica.version(copy) != version:
            form, parts = self.host.cut(copy.aspect, now_ns)
            self.replica.publish(copy, self.writer, offer, version, form, parts)

    def _came(self, sender: str, parts: Parts, size: int, now_ns: int) -> None:
        """Something that was asked for: taken in, and considered when it is complete. What was not is left aside."""
        copy = parts.copy
        question = self._questions.get(copy)
        if question is None or question.peer != sender or copy.source == self.source:
            return
        if parts.head is not None:
            _check(copy, parts.head)
            if not self._writes(copy.source, parts.head.writer, now_ns):
                self._nothing_new(copy, question, "", now_ns)  # it is another robot's of that name
                return
        question.size += size
        question.asked_ns = now_ns  # it is coming: patience begins anew
        if parts.head is None:
            self._nothing_new(copy, question, parts.reason, now_ns)
            return
        if parts.head.version != question.version:
            question.version, question.came = parts.head.version, set()
        question.came.add(parts.number)
        try:
            taken = self.replica.take(copy, parts.head, parts.pieces)
        except MapError as error:
            self._nothing_new(copy, question, str(error), now_ns)
            return
        if taken == "complete":
            del self._questions[copy]
            self._consider(copy, question, now_ns)
        elif taken == "conflict":
            self._nothing_new(copy, question, self.replica.conflict(copy), now_ns)
        elif len(question.came) == parts.count:
            self._mend(copy, question, now_ns, taken == "other base")

    def _mend(self, copy: Copy, question: Question, now_ns: int, plain: bool) -> None:
        """All that was asked for has come, and does not make a whole: ask once more, for it as it is."""
        if question.tries >= MOST_TRIES:
            self._nothing_new(copy, question, "its parts do not make a whole", now_ns)
            return
        question.plain = True
        if not plain:
            self.replica.start_anew(copy)
        self._repeat(copy, question, now_ns)

    def _nothing_new(self, copy: Copy, question: Question, reason: str, now_ns: int) -> None:
        """The question is answered, though not with what was asked for: without a preview the layer is looked at."""
        del self._questions[copy]
        if question.offer and reason and copy.aspect == "preview":
            self._get(Copy(copy.source, "layer"), question.peer, question.offer, now_ns)
        elif question.offer and reason:
            self.host.refused(question.offer, reason, now_ns)
        self._wake(now_ns + self.patience_ns)

    def _consider(self, copy: Copy, question: Question, now_ns: int) -> None:
        whole = self.replica.whole(copy)
        if whole is None:
            return
        self._wake(now_ns + self.patience_ns)
        if not question.offer:
            self.host.passed_on(whole, question.size, now_ns)
            return
        wish = self.host.consider(whole, copy.aspect, question.size, now_ns)
        if wish == "layer" and copy.aspect == "preview":
            self._get(Copy(copy.source, "layer"), question.peer, question.offer, now_ns)

    def _learn(self, claims: Sequence[bytes], now_ns: int) -> None:
        changed = self.gossip.learn(claims)
        if any(claim.receiver == self.source and claim.is_active for claim in changed):  # which only this robot writes
            self.writers.hear(self.source, self.writer, of_several=True)
        if changed:
            self._wake(now_ns + self.patience_ns)

    def _writes(self, source: Source, writer: bytes, now_ns: int, of_several: bool = False) -> bool:
        """Take note of who writes as a source; False where that source is another robot.

        Where another one was taken for it until now, what came from that one is none of its; where this robot was, it
        is another source from now on.
        """
        before = self.writers.of(source)
        if not self.writers.hear(source, writer, of_several):
            return False
        if before not in (NOBODY, self.writers.of(source)):
            if source == self.source:
                self._rename(now_ns)
            self.replica.belongs_to(source, writer)
            self.peers = {name: peer for name, peer in self.peers.items() if peer.source != source}
            self._asked = {asked: ns for asked, ns in self._asked.items() if asked[0].source != source}
            self.host.belongs(source, writer, now_ns)
            self._wake(now_ns + self.patience_ns)
        return True

    def _rename(self, now_ns: int) -> None:
        """Another robot is this source by right: be the next one of the name that nobody has heard of."""
        name = base_name(self.source.name)
        epoch = 1 + max(one.epoch for one in self._known() if base_name(one.name) == name)
        self.source = Source(life_name(name, epoch), epoch)
        self.writers.hear(self.source, self.writer)
        self.host.renamed(self.source, now_ns)

    def _known(self) -> set[Source]:
        """All sources that this robot has heard of, its own among them."""
        met = {peer.source for peer in self.peers.values()} | {copy.source for copy in self.replica.copies}
        return met | {end for claim in self.host.claims for end in claim.edge} | {self.source} | self.writers.sources

    def _wake(self, at_ns: int) -> None:
        self.wake_ns = at_ns if self.wake_ns is None else min(at_ns, self.wake_ns)

    def _say(self, receiver: str, *messages: Message) -> None:
        self.outbox += [Outgoing(receiver, message) for message in messages]


class UnreadableError(MapError):
    """A message, or the offer in it, cannot be read."""


def _message(data: bytes) -> Message:
    """The message in the bytes; raises UnreadableError."""
    try:
        return decode(data)
    except MapError as error:
        raise UnreadableError(str(error)) from None


def _offer(data: bytes) -> Offer:
    """The offer in the bytes; raises UnreadableError."""
    try:
        return Offer.decode(data)
    except MapError as error:
        raise UnreadableError(str(error)) from None


def _check(copy: Copy, head: Head) -> None:
    """Raises UnreadableError where a head's offer is none, or tells of another source or version than that it heads."""
    told = _offer(head.offer).provenance
    if (told.source, told.epoch, told.version) != (*copy.source, head.version):
        raise UnreadableError(f"version {head.version} of {copy.source} comes with an offer of {told}")
