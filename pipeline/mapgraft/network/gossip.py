"""Claims on the network: who is told which, and how two robots find out that they have not heard the same."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import takewhile
from typing import Final

from mapgraft.contracts import MapError
from mapgraft.graph.claims import Claim, Claims, Edge, Source
from mapgraft.network.wire import DIGEST, Hello, Message, Summary, Told, digest_of

_WHOLE: Final = 1 << (8 * DIGEST)
_NOTHING: Final = bytes(DIGEST)
_AT_ONCE: Final = 1 << 14  # bytes of claims in one message
MOST_EDGES: Final = 20_000  # that others may tell of


class Gossip:
    """What one robot tells others of claims.

    Those that it wrote itself it tells every peer once, as soon as they meet. Digests say whether all else is the same
    on both sides; only where it is not, digests per receiver are exchanged, and then the claims of those that differ.
    Digests are sums of hashes, so that what two robots wrote themselves, which each tells anyway, can be left out, and
    that a claim that changes costs one hash, however many others there are.
    """

    __slots__ = (
        "_claims",
        "_fresh",
        "_learnt",
        "_sums",
        "_terms",
        "_told",
        "_told_others",
        "_total",
        "_version",
        "refused",
    )

    def __init__(self, claims: Claims) -> None:
        self._claims = claims
        self._version = 0  # up to which version the claims are summed up
        self._terms: dict[Source, dict[Edge, int]] = {}  # receiver → the hash of each of its claims, as it is summed up
        self._sums: dict[Source, int] = {}
        self._total = 0
        self._learnt: dict[Edge, bytes] = {}  # what came from others, by the bytes of the claim
        # own claims, and at which version they were noticed, the latest last
        self._fresh: dict[Edge, tuple[bytes, int]] = {}
        self._told: dict[str, int] = {}  # peer → up to which version it was told what is written here
        # peer → as which source it was greeted last, and what it was told of third robots' claims
        self._told_others: dict[str, tuple[Source | None, bytes]] = {}
        self.refused = 0  # claims that could not be read, or were too many

    def hello(self, peer: str, me: Source, other: Source | None) -> tuple[bytes, bytes, tuple[bytes, ...]]:
        """For a hello: the digests of what this robot wrote and of what third ones did, and what is new to the peer."""
        self._look()
        others = self._others(me, other)
        self._told_others[peer] = (other, others)
        return _bytes(self._sums.get(me, 0)), others, self.news_for(peer)

    def news_for(self, peer: str) -> tuple[bytes, ...]:
        """Own claims that the peer was not told, as many as one message holds; they count as told from now on."""
        self._look()
        told = self._told.get(peer, 0)
        news: list[bytes] = []
        latest = ((version, edge) for edge, (_, version) in reversed(self._fresh.items()))
        waiting = sorted(takewhile(lambda one: one[0] > told, latest))
        size = 0
        for version, edge in waiting:
            data = self._fresh[edge][0]
            if news and size + len(data) > _AT_ONCE and version > self._told.get(peer, 0):
                break
            news.append(data)
            size += len(data)
            self._told[peer] = version
        return tuple(news)

    def has_news_for(self, peer: str) -> bool:
        self._look()
        _, latest = next(reversed(self._fresh.values()), (b"", 0))
        return latest > self._told.get(peer, 0)

    def learn(self, told: Iterable[bytes]) -> list[Claim]:
        """Take in what others tell; returns the claims that are news.

        What is no claim is counted and left aside, as is what would make more than anybody has use for: what strangers
        make up leaves room for what this robot has to say.
        """
        changed = []
        for data in told:
            try:
                claim = Claim.decode(data)
            except MapError:
                self.refused += 1
                continue
            if len(self._claims) >= MOST_EDGES and self._claims.of(*claim.edge) is None:
                self.refused += 1
            elif self._claims.add(claim):
                self._learnt[claim.edge] = data
                changed.append(claim)
        return changed

    def heard(self, peer: str, me: Source, source: Source, hello: Hello) -> Iterator[Message]:
        """What there is to say after a hello from a peer, whose claims in it were learnt.

        What it says of third robots is compared with what it was told itself, so that what either has learnt since is
        not taken for a difference.
        """
        self._look()
        greeted, others = self._told_others.get(peer, (None, b""))
        if hello.others != (others if greeted == source else self._others(me, source)):
            yield Summary({receiver: _bytes(total) for receiver, total in self._sums.items()})
        elif hello.own != _bytes(self._sums.get(source, 0)):
            yield Summary({source: _bytes(self._sums.get(source, 0))}, (source,))

    def answer(self, summary: Summary) -> Iterator[Message]:
        """The claims that the other does not have as they are here, and a question for those that it has otherwise."""
        self._look()
        mine = {source: _bytes(total) for source, total in self._sums.items()}
        asked = set(summary.scope) or (mine.keys() | summary.digests.keys())
        differing = {one for one in asked if mine.get(one, _NOTHING) != summary.digests.get(one, _NOTHING)}
        yield from _told(self._of_receivers(differing))
        back = sorted(differing & summary.digests.keys())
        if back and not summary.reply:
            yield Summary({one: mine.get(one, _NOTHING) for one in back}, tuple(back), reply=True)

    def _of_receivers(self, receivers: Iterable[Source]) -> Iterator[bytes]:
        """The claims of these receivers, in the order of their edges."""
        for edge in (edge for one in sorted(receivers) for edge in sorted(self._terms.get(one, ()))):
            if (claim := self._claims.of(*edge)) is not None:
                yield claim.data

    def _others(self, me: Source, other: Source | None) -> bytes:
        """The digest of what was written by neither of two robots."""
        mine, theirs = self._sums.get(me, 0), 0 if other is None else self._sums.get(other, 0)
        return _bytes(self._total - mine - theirs)

    def _look(self) -> None:
        """Take into the sums what has changed; what nobody told was written here."""
        if self._version == self._claims.version:
            return
        before, self._version = self._version, self._claims.version
        for claim in self._claims.since(before):
            edge, term = claim.edge, int.from_bytes(digest_of(claim.data), "little")
            known = self._terms.setdefault(claim.receiver, {})
            more = term - known.get(edge, 0)
            known[edge] = term
            self._sums[claim.receiver] = (self._sums.get(claim.receiver, 0) + more) % _WHOLE
            self._total = (self._total + more) % _WHOLE
            self._fresh.pop(edge, None)
            if self._learnt.get(edge) != claim.data:
                self._fresh[edge] = (claim.data, self._version)


def _bytes(total: int) -> bytes:
    return (total % _WHOLE).to_bytes(DIGEST, "little")


def _told(claims: Iterable[bytes]) -> Iterator[Told]:
    """Claims in messages of bounded size."""
    waiting: list[bytes] = []
    size = 0
    for data in claims:
        if waiting and size + len(data) > _AT_ONCE:
            yield Told(tuple(waiting))
            waiting, size = [], 0
        waiting.append(data)
        size += len(data)
    if waiting:
        yield Told(tuple(waiting))
