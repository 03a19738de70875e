"""Conversations as robots have them: written down by one of them, while it and the others talk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from fuzz_conversations import GREET, GROW, HEAR, PEERS, SETTLE, STEP_NS, Act, Listener, claim_of, node_of, told_acts

from mapgraft.graph.claims import Claim, Source, State
from mapgraft.network.held import Held
from mapgraft.network.meetings import Met
from mapgraft.network.node import Node
from mapgraft.network.wire import MAGIC, Copy, Hello, Message, Namesake, Parts, Summary, Told, Want, encode
from mapgraft.rendezvous import Record, Seen

_CHECK = 8  # bytes of the hash behind a message
ME = "a"


def conversation_seeds() -> list[bytes]:
    """What robot ``a`` hears, and what it does meanwhile; see ``fuzz_conversations.told_acts``."""
    return [told_acts(stage.acts) for stage in (*_honest(), *_losing(), *_lying())]


@dataclass
class Stage:
    """Robots that hear each other at once; what ``a`` hears and does is written down."""

    names: str
    acts: list[Act] = field(default_factory=list)
    now_ns: int = 0
    lost: frozenset[int] = frozenset()  # numbers of messages that do not come
    sent: int = 0
    nodes: dict[str, Node] = field(default_factory=dict)
    hosts: dict[str, Listener] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.names:
            self.hosts[name], self.nodes[name] = node_of(name)

    def meet(self, one: str, other: str) -> Stage:
        for name, peer in ((one, other), (other, one)):
            if name == ME:
                self.acts.append(Act(GREET, PEERS.index(peer)))
            hello = self.nodes[name].greeting(peer)
            self.deliver(name)
            self.hear(name, peer, hello)
        return self.flush()

    def settle(self, name: str = ME, times: int = 1) -> Stage:
        for _ in range(times):
            if name == ME:
                self.acts.append(Act(SETTLE))
                self.now_ns += STEP_NS
            self.nodes[name].settle(self.now_ns, [peer for peer in self.names if peer != name])
            self.flush()
        return self

    def grow(self, name: str, times: int = 1) -> Stage:
        self.acts += [Act(GROW)] * times if name == ME else []
        self.hosts[name].version += times
        return self

    def claim(self, name: str, claim: Claim) -> Stage:
        """A peer has merged, or heard of it; not for ``a``, which has no hands."""
        self.hosts[name].claims.add(claim)
        return self

    def hear(self, sender: str, receiver: str, message: Message) -> Stage:
        self.sent += 1
        if self.sent in self.lost:
            return self
        data = encode(message)
        if receiver == ME:
            self.acts.append(Act(HEAR, PEERS.index(sender), data[len(MAGIC) : -_CHECK]))
        self.nodes[receiver].hear(sender, data, self.now_ns)
        return self

    def deliver(self, sender: str) -> bool:
        said = self.nodes[sender].said()
        for receiver, message in said:
            self.hear(sender, receiver, message)
        return bool(said)

    def flush(self) -> Stage:
        """Everybody says what there is to say, and answers to that."""
        while sum(self.deliver(name) for name in self.names):
            pass
        return self


def _claim(receiver: str, donor: str, revision: int = 0, state: State = "provisional") -> Claim:
    return claim_of(Source(receiver, 1), Source(donor, 1), revision, state)


def _honest() -> list[Stage]:
    """Layers, previews and claims, of two robots and through third ones."""
    grown = Stage("ab").meet("a", "b").grow("b").meet("a", "b").grow("b").meet("a", "b").settle()
    asked = Stage("ab").meet("b", "a")
    for _ in range(5):
        asked.grow("a").meet("b", "a")
    many = Stage("abde")
    for peer in "bdebd":
        many.meet("a", peer).settle().grow("a").grow(peer)
    preview = Stage("ac").meet("a", "c").grow("c", 2).meet("c", "a").settle(times=2)
    without = Stage("ae").grow("e").meet("a", "e").hear("e", "a", Want(Copy(Source("a", 1), "preview"), 0)).settle()
    through = Stage("abd").meet("b", "d").claim("b", _claim("b", "d")).meet("a", "b").settle().settle("b").settle()
    through.grow("d").meet("b", "d").meet("a", "b").settle(times=2)
    direct = Stage("abd").claim("b", _claim("b", "a")).claim("d", _claim("d", "b")).meet("a", "b").settle()
    direct.meet("a", "d").settle().grow("d").meet("b", "d").settle("b").meet("a", "d").settle(times=2)
    direct.claim("d", _claim("d", "b", 1, "reverted")).meet("a", "d").settle(times=3)
    return [grown, asked, many, preview, without, through, direct]


def _losing() -> list[Stage]:
    """The same on a bad radio: each time another message does not come."""
    stages = []
    for number in range(1, 14):
        stage = Stage("ab", lost=frozenset({number, number + 5}))
        stage.meet("a", "b").settle(times=2).grow("b").meet("a", "b").settle(times=4).grow("a").grow("b", 2)
        stages.append(stage.meet("b", "a").settle(times=2).settle("b").settle())
    deaf = Stage("ab").meet("a", "b").grow("b")
    deaf.lost = frozenset(range(deaf.sent + 3, deaf.sent + 60))
    return [*stages, deaf.meet("a", "b").settle(times=12)]


def _lying() -> list[Stage]:
    """Two of one name, versions with two contents, parts of which nobody has the base, and what nobody asked for."""
    me, b = Source("a", 1), Source("b", 1)
    copy, records = Copy(b, "layer"), (Record(0, _STILL), Record(STEP_NS, _STILL, Seen(1.0, 2.0, 0.5, 0.2, 0.1)))
    offer, mine = _offer_of("b", 1), _offer_of("a", 1)
    hello = Hello(b"writer-b", offer, bytes(16), bytes(16), (_claim("b", "d").encode(), b"no claim"))
    newer = replace(hello, offer=_offer_of("b", 9))
    first, second, third = (_parts(copy, version) for version in (1, 2, 3))
    asked = Want(Copy(me, "layer"), 0)
    said: list[Sequence[Message]] = [
        (Namesake(me, b"zwriters"), Namesake(me, b"a-writer"), asked, Hello(b"z-writer", mine, *NOTHING)),
        (Hello(b"a-writer", mine, *NOTHING), Want(Copy(me, "layer"), 0)),
        (Hello(b"z-writer", mine, *NOTHING), Hello(b"writer-a", mine, *NOTHING), Want(Copy(me, "preview"), 0)),
        (asked, asked, replace(asked, since=2, writer=b"writer-a"), replace(asked, writer=b"a-writer", since=1)),
        (hello, replace(hello, writer=b"a-writer"), hello, newer, replace(newer, writer=b"zwriters")),
        (hello, first, replace(newer, writer=b"a-writer"), replace(newer, writer=b"zwriters")),
        (hello, hello, newer, first, replace(asked, copy=copy), replace(asked, copy=copy, got={b"door": 1})),
        (Summary({me: bytes(16), b: bytes(16)}, (b,)), Summary({b: bytes(16)}, (), True), Summary({}, ())),
        (Met(b, records, bytes(8), True), Met(b, records[:1], bytes(8)), Met(b, records, bytes(8), True)),
        (Told(tuple(_claim(*edge).encode() for edge in ("bd", "db", "de", "eb"))), Told((b"no claim",))),
        (hello, first, Told((_claim("b", "a").encode(), _claim("b", "d").encode())), Want(copy, 0)),
        (hello, Parts(copy, 0, reason="there is none")),
        (replace(hello, offer=_offer_of("c", 1)), Parts(Copy(Source("c", 1), "preview"), 0, reason="there is none")),
        (hello, first, newer, first, newer, second, newer, third, Want(copy, 1, b"writer-b", plain=True)),
        (hello, second, newer, _parts(copy, 2, other=True), newer, third),
        (hello, _part_of(second), _parts(copy, 2, other=True), newer, third),
        (hello, _part_of(third), _part_of(third), _part_of(third), _part_of(third)),
        (hello, *(_part_of(third, number) for number in range(3))),
        (hello, replace(_part_of(second), count=2), replace(_part_of(third), count=2), second),
        (hello, _parts(copy, 3, since=2), third),
        (hello, _parts(copy, 3, since=2, plain=True), _parts(copy, 3, since=2, plain=True), third),
        (hello, first, newer, _parts(copy, 4, since=3), _parts(copy, 4)),
        (hello, second, newer, replace(third, pieces=()), third),
        (hello, first, newer, _written_by(third, b"a-writer"), newer, third),
        (hello, _written_by(_part_of(third), b"zwriters"), second),
        (hello, replace(first, pieces=(replace(first.pieces[0], version=9),))),
        (hello, replace(first, pieces=(replace(first.pieces[0], name=b"door\0\1"), *first.pieces))),
        (hello, _parts(copy, 2, name=b"x" * 70)),
        (hello, _parts(copy, 2, count=14), third),
        (hello, _parts(copy, 2, size=4000), third),
    ]
    stages = []
    for messages in said:
        stage = Stage("ab", [Act(GREET, 0), Act(GROW)])
        for message in messages:
            stage.acts.append(Act(HEAR, 0, encode(message)[len(MAGIC) : -_CHECK]))
        stage.acts += [Act(SETTLE), Act(GREET, 0), *[Act(SETTLE)] * 8]
        stages.append(stage)
    return stages


NOTHING = (bytes(16), bytes(16), ())


def _offer_of(name: str, version: int) -> bytes:
    host = Listener(name)
    host.version = version
    return host.offer()


_STILL = (1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def _parts(copy: Copy, version: int, *, since: int = 0, other: bool = False, plain: bool = False,
           name: bytes = b"", count: int = 0, size: int = 0) -> Parts:  # fmt: skip
    """The message that brings somebody to a version, as ``b`` would say it, or with parts that ``b`` never had."""
    host, held = Listener("b"), Held()
    for host.version in range(1, version + 1):
        parts = host.parts()
        if other:
            parts[b"floor"] = b"is another"
        if name:
            parts[name] = b"a name of the longest"
        parts |= {b"door %d" % number: b"shut" for number in range(count)}
        if size:
            parts[b"noise"] = np.random.default_rng(1).bytes(size)
        held.publish(b"writer-b", host.offer(), host.version, "parts", parts)
    assert held.whole is not None
    return Parts(copy, since, held.whole, 0, 1, tuple(held.pieces(since, {}, plain)))


def _part_of(parts: Parts, left_out: int = 0) -> Parts:
    """One piece is missing."""
    return replace(parts, pieces=tuple(piece for at, piece in enumerate(parts.pieces) if at != left_out))


def _written_by(parts: Parts, writer: bytes) -> Parts:
    assert parts.head is not None
    return replace(parts, head=replace(parts.head, writer=writer))
