"""One robot among strangers: what it hears from several senders, in any order, and what it says to that."""

from __future__ import annotations

import random
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

from fuzz_mutations import Damage
from fuzz_recordings import Run

if TYPE_CHECKING:
    from mapgraft.exchange import Form
    from mapgraft.graph.claims import Claim, Claims, Source, State
    from mapgraft.network.host import Wish
    from mapgraft.network.node import Node
    from mapgraft.network.replica import Whole
    from mapgraft.network.wire import Aspect

PEERS = ("b", "c", "d", "e")
HEAR, GREET, SETTLE, GROW = range(4)
STEP_NS = 400_000_000
PATIENCE_NS = 500_000_000
_LENGTH = 2


class Act(NamedTuple):
    """What happens next: a message of a peer is heard (without its mark and hash), it is met, time passes, or the
    robot's own map grows."""

    kind: int
    peer: int = 0
    body: bytes = b""


def told_acts(acts: Iterable[Act]) -> bytes:
    """Acts as the harness reads them: kind and peer in one byte, and what is heard behind its length."""
    data = b""
    for kind, peer, body in acts:
        data += bytes([kind | peer << 2])
        if kind == HEAR:
            data += len(body).to_bytes(_LENGTH, "little") + body
    return data


def acts_in(data: bytes) -> Iterator[Act]:
    """The inverse of ``told_acts``; any bytes are acts."""
    at = 0
    while at < len(data):
        kind, peer = data[at] & 3, data[at] >> 2 & 3
        at += 1
        body = b""
        if kind == HEAR:
            length = int.from_bytes(data[at : at + _LENGTH], "little")
            body = data[at + _LENGTH : at + _LENGTH + length]
            at += _LENGTH + length
        yield Act(kind, peer, body)


def disturbed(data: bytes, chance: random.Random, damage: Damage) -> bytes:
    """A conversation on a bad radio and among liars: acts are lost, come twice, late, from others, or are changed."""
    acts = list(acts_in(data)) or [Act(HEAR)]
    for _ in range(chance.randint(1, 4)):
        at, way = chance.randrange(len(acts)), chance.randrange(6)
        act = acts[at]
        if way == 0 and len(acts) > 1:
            del acts[at]
        elif way == 1:
            acts.insert(chance.randint(0, len(acts)), act)
        elif way == 2:
            acts.insert(chance.randrange(len(acts)), acts.pop(at))
        elif way == 3:
            acts[at] = act._replace(peer=chance.randrange(len(PEERS)))
        elif way == 4:
            acts.insert(at, Act(chance.randrange(1, 4), chance.randrange(len(PEERS))))
        else:
            acts[at] = act._replace(body=damage(act.body)[:0xFFFF])
    return told_acts(acts)


class Listener:
    """The robot behind the node. Its map has a part that changes, one that comes and goes, and one that stays; what it
    wants of others is in the first letter of their names."""

    def __init__(self, name: str) -> None:
        from mapgraft.graph.claims import Claims, Source

        self.source = Source(name, 1)
        self._claims = Claims()
        self.version = 1
        self.lacked: set[Source] = set()

    @property
    def claims(self) -> Claims:
        return self._claims

    def offer(self) -> bytes:
        from mapgraft.contracts import MapMetadata, Provenance
        from mapgraft.exchange import Offer

        return Offer(Provenance(*self.source, self.version), MapMetadata("occupancy_grid", 0.05)).encode()

    def parts(self) -> dict[bytes, bytes]:
        version = self.version
        changed, noise = version - version % 3, [at * at * 7 % 251 for at in range(120)]
        walls = bytes((value + changed) % 251 for value in noise)  # each value by as much
        if version % 3 == 1:
            walls = bytes(version + 9 if at % 29 == 3 else value for at, value in enumerate(walls))  # a few values
        elif version % 3 == 2:
            walls = bytes((at * 31 + version * 57) % 253 for at in range(60))  # nothing is as it was
        parts = {b"walls": walls, b"floor": b"stays as it is"}
        return {**parts, b"door": b"open"} if version % 2 else parts

    def cut(self, aspect: Aspect, stamp_ns: int) -> tuple[Form, Mapping[bytes, bytes]]:
        from mapgraft.contracts import MapError

        if aspect == "layer":
            return "parts", self.parts()
        if self.version % 4 == 3:
            raise MapError("nothing is left of it that small")
        return "whole", {b"": self.parts()[b"walls"][:40]}

    def wants(self, offer: bytes, size: int, stamp_ns: int) -> Wish:
        from mapgraft.exchange import Offer

        first = Offer.decode(offer).provenance.source[:1]
        return "layer" if first in "abd" else "preview" if first == "c" else "nothing"

    def consider(self, whole: Whole, aspect: Aspect, size: int, stamp_ns: int) -> Wish:
        """What is read is merged, anew with every version; that nobody else can is not known here."""
        from mapgraft.exchange import Offer
        from mapgraft.graph.claims import Source

        if _is_read(whole) and aspect == "layer":
            told = Offer.decode(whole.head.offer).provenance
            donor = Source(told.source, told.epoch)
            if donor != self.source:
                self._claims.add(claim_of(self.source, donor, whole.head.version))
        return "layer"

    def passed_on(self, whole: Whole, size: int, stamp_ns: int) -> None:
        _is_read(whole)

    def refused(self, offer: bytes, reason: str, stamp_ns: int) -> None:
        assert reason

    def heard(self, stamp_ns: int) -> None:
        """Whoever is told of in a claim is lacked, as long as it stands."""
        self.lacked = {end for claim in self._claims.active() for end in claim.edge}

    def lacks(self) -> Collection[Source]:
        return self.lacked

    def renamed(self, source: Source, stamp_ns: int) -> None:
        assert source != self.source
        self.source = source

    def belongs(self, source: Source, writer: bytes, stamp_ns: int) -> None:
        assert source != self.source and any(writer)


def _is_read(whole: Whole) -> bool:
    """The engine reads what has come in; that a piece is missing is told."""
    from mapgraft.contracts import MapError

    try:
        whole.parts()
    except MapError:
        return False
    return True


def claim_of(receiver: Source, donor: Source, revision: int, state: State = "provisional") -> Claim:
    """What a robot says of a merge that it has made."""
    from mapgraft.contracts import Transform
    from mapgraft.graph.claims import Claim

    T = Transform.planar(1.0, 2.0, 0.5)
    return Claim(receiver, donor, 1, state, min(revision, 1 << 20), T, 1.0, None, support=2.0, by="x")


def node_of(name: str) -> tuple[Listener, Node]:
    """A robot that has seen its peers twice, and its part in all conversations."""
    from mapgraft.network.meetings import Meetings
    from mapgraft.network.node import Node
    from mapgraft.rendezvous import Rendezvous, Seen

    host, book = Listener(name), Rendezvous([0, STEP_NS], [_HERE, _HERE])
    for peer in PEERS[1:]:
        book.sighted(peer, STEP_NS // 2, Seen(1.0, 2.0, 0.5, 0.1, 0.1))
    writer = f"writer-{name}".encode()
    return host, Node(host.source, writer, host, PATIENCE_NS, meetings=Meetings(book, lambda source, now_ns: None))


_HERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def play(acts: Iterable[Act], host: Listener, node: Node) -> None:
    """All of it, one act after the other. What is said can be read, and says what was meant."""
    from mapgraft.network.wire import MAGIC, decode, encode, kind_of, sealed

    now_ns, met = 0, set[str]()
    for act in acts:
        peer = PEERS[act.peer]
        if act.kind == HEAR:
            node.hear(peer, sealed(MAGIC + act.body), now_ns)
        elif act.kind == GREET:
            met.add(peer)
            encode(node.greeting(peer))
        elif act.kind == SETTLE:
            now_ns += STEP_NS
            node.settle(now_ns, sorted(met))
        else:
            host.version += 1
        for _, message in node.said():
            data = encode(message)
            assert encode(decode(data)) == data and kind_of(message)


def conversation() -> Run:
    """What a robot is after any conversation: itself, with its own map as it was, and nothing kept beyond bounds."""
    from mapgraft.network import held, replica
    from mapgraft.network.wire import Copy

    def run(data: bytes) -> None:
        host, node = node_of("a")
        play(acts_in(data), host, node)
        assert host.source == node.source
        own = node.replica.whole(Copy(node.source, "layer"))
        assert own is None or own.parts() == Listener.parts(_of_version(host, own.head.version))
        assert len(node.replica.copies) <= replica.MOST_COPIES
        for copy in node.replica.copies.values():
            assert len(copy.parts) <= held.MOST_PARTS
            kept = sum(len(part.packed or b"") for part in copy.parts.values())
            assert kept <= held.MOST_HELD_BYTES + held.PIECE  # the one that is too much is refused once it is known

    return run


def _of_version(host: Listener, version: int) -> Listener:
    """The same robot as it was."""
    former = Listener(host.source.name)
    former.version = version
    return former
