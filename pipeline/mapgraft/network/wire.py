"""Messages between robots as bytes: each says what kind it is, is checked whole, and is bounded in every length.

``MGN`` and a version, a byte for the kind, the content, and eight bytes of a hash over all before them. What is no
message, of another version, or damaged raises MapError.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from mapgraft.contracts import MapError
from mapgraft.exchange import MOST_OFFER, Form
from mapgraft.graph.claims import Source
from mapgraft.network.meetings import Met, read_met, write_met
from mapgraft.network.packing import Reader, Writer, pack_offer, texts, unpack_offer, write_texts

MAGIC: Final = b"MGN\x01"
MOST_BYTES: Final = 1 << 16  # of one message
MOST_CLAIM: Final = 1 << 12
MOST_LISTED: Final = 1 << 15
PIECE: Final = 1 << 14  # bytes of a part, unpacked; a longer part travels in several
MOST_NAME: Final = 72  # bytes of a part's name with its place
WRITER: Final = 8
DIGEST: Final = 16
BASE: Final = 4  # bytes of the digest that tell a base; what comes of a wrong one is noticed when all is there
_CHECK: Final = 8

Aspect = Literal["layer", "preview"]
Change = Literal["gone", "whole", "difference", "against", "kept"]
ASPECTS: Final[tuple[Aspect, ...]] = ("layer", "preview")
_FORMS: Final[tuple[Form, ...]] = ("parts", "whole")
_CHANGES: Final[tuple[Change, ...]] = ("gone", "whole", "difference", "against", "kept")
_BARE: Final = ("gone", "kept")  # changes that are told without bytes


class Copy(NamedTuple):
    """What is asked for and sent: the layer of a source, or its preview."""

    source: Source
    aspect: Aspect


@dataclass(frozen=True, slots=True)
class Head:
    """What the one writer of a source says of one version of its layer or preview.

    ``offer`` (see ``mapgraft.exchange.Offer``) tells the version and what there is to say about the map; ``version``
    must be that. ``writer`` is who says so: two robots of one name are told apart by it. ``form`` says whether the map
    type made the parts, or they are the pieces of one encoding. ``digest`` is that of all parts (``digest_of``).
    """

    writer: bytes
    offer: bytes
    version: int
    form: Form
    digest: bytes


@dataclass(frozen=True, slots=True)
class Piece:
    """One part that has changed, or is gone: since which version it is so, how it is told, and by what bytes.

    ``base`` is the beginning of the digest of what the receiver is thought to have of it (``difference``, ``against``).
    ``kept`` only says that the part is still there, as the receiver has it.
    """

    name: bytes
    version: int
    change: Change
    base: bytes = b""
    packed: bytes = b""


@dataclass(frozen=True, slots=True)
class Hello:
    """Said on contact: what the sender offers, and digests of the claims that it wrote and of those of third robots.

    ``claims`` are those of its own that are new to the other, as far as the sender knows.
    """

    writer: bytes
    offer: bytes
    own: bytes
    others: bytes
    claims: tuple[bytes, ...] = ()


@dataclass(frozen=True, slots=True)
class Summary:
    """Digests of all claims by their receivers. Who has others sends those, and asks back where this is no ``reply``.

    ``scope`` is empty for all receivers; else only these are meant.
    """

    digests: Mapping[Source, bytes]
    scope: tuple[Source, ...] = ()
    reply: bool = False


@dataclass(frozen=True, slots=True)
class Told:
    """Claims."""

    claims: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class Want:
    """Asks for what has changed of a layer or preview since a version that the sender has whole (0: all of it).

    ``writer`` is whose version that is; of another writer's everything is asked for, if that one has the smaller id.
    ``got`` are parts that have already come of a newer version; ``plain`` asks for them as they are, and for the names
    of all others that are there, because what the sender had was not what the other thought.
    """

    copy: Copy
    since: int
    writer: bytes = bytes(WRITER)
    plain: bool = False
    got: Mapping[bytes, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Parts:
    """Part ``number`` of ``count`` messages that bring a receiver from ``since`` to what ``head`` says.

    Without a head there is nothing newer, or, for a ``reason``, nothing at all.
    """

    copy: Copy
    since: int
    head: Head | None = None
    number: int = 0
    count: int = 1
    pieces: tuple[Piece, ...] = ()
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Namesake:
    """Tells a robot that another one, ``writer``, is the source that it says it is."""

    source: Source
    writer: bytes


Message = Hello | Summary | Told | Want | Parts | Namesake | Met
KINDS: Final[Mapping[type, str]] = {
    Hello: "hello",
    Summary: "summary",
    Told: "claims",
    Want: "want",
    Parts: "parts",
    Namesake: "namesake",
    Met: "meetings",
}


def kind_of(message: Message) -> str:
    """How the bytes of a message are counted: previews apart from layers."""
    if isinstance(message, Parts):
        return message.copy.aspect
    return KINDS[type(message)]


def encode(message: Message) -> bytes:
    """Canonical bytes; raises MapError when they would be more than anybody reads."""
    writer = Writer(MAGIC)
    writer.number(list(KINDS).index(type(message)))
    match message:
        case Hello():
            _write_hello(writer, message)
        case Summary():
            _write_summary(writer, message)
        case Told():
            write_texts(writer, message.claims)
        case Want():
            _write_want(writer, message)
        case Parts():
            _write_parts(writer, message)
        case Namesake():
            writer.source(message.source).raw(message.writer)
        case Met():
            write_met(writer, message)
    data = bytes(writer.data)
    if len(data) + _CHECK > MOST_BYTES:
        raise MapError(f"a message of {len(data)} bytes is too long to be sent: {MOST_BYTES} are read")
    return sealed(data)


def sealed(data: bytes) -> bytes:
    """A message's bytes with the hash behind them."""
    return data + _hash(data, _CHECK)


def decode(data: bytes) -> Message:
    """The message in the bytes; raises MapError when they are none, or damaged."""
    try:
        if len(data) > MOST_BYTES or data[: len(MAGIC)] != MAGIC:
            raise ValueError(f"it begins with {data[: len(MAGIC)]!r}")
        body = data[:-_CHECK]
        if _hash(body, _CHECK) != data[-_CHECK:]:
            raise ValueError("its hash is another")
        reader = Reader(body, len(MAGIC))
        message = _READ[reader.number(len(_READ) - 1)](reader)
        reader.end()
        return message
    except (ValueError, IndexError) as error:
        raise MapError(f"a message of {len(data)} bytes cannot be read: {error}") from None


def digest_of(data: bytes) -> bytes:
    """The digest by which parts are told apart."""
    return _hash(data, DIGEST)


def _hash(data: bytes, size: int) -> bytes:
    return hashlib.blake2b(data, digest_size=size).digest()


def _write_offer(writer: Writer, offer: bytes) -> None:
    packed = pack_offer(offer)
    if (size := max(len(offer), len(packed))) > MOST_OFFER:
        raise MapError(f"an offer of {size} bytes is too long to be sent: {MOST_OFFER} are read")
    writer.text(packed)


def _read_offer(reader: Reader) -> bytes:
    return unpack_offer(reader.text(MOST_OFFER), MOST_OFFER)


def _write_hello(writer: Writer, hello: Hello) -> None:
    writer.raw(hello.writer)
    _write_offer(writer, hello.offer)
    writer.raw(hello.own).raw(hello.others)
    write_texts(writer, hello.claims)


def _read_hello(reader: Reader) -> Hello:
    writer, offer = reader.raw(WRITER), _read_offer(reader)
    digests = reader.raw(DIGEST), reader.raw(DIGEST)
    return Hello(writer, offer, *digests, tuple(texts(reader, MOST_LISTED, MOST_CLAIM)))


def _write_summary(writer: Writer, summary: Summary) -> None:
    writer.number(int(summary.reply)).number(len(summary.scope))
    for source in summary.scope:
        writer.source(source)
    writer.number(len(summary.digests))
    for source in sorted(summary.digests):
        writer.source(source).raw(summary.digests[source])


def _read_summary(reader: Reader) -> Summary:
    reply = bool(reader.number(1))
    scope = tuple(reader.source() for _ in range(reader.number(MOST_LISTED)))
    digests = {reader.source(): reader.raw(DIGEST) for _ in range(reader.number(MOST_LISTED))}
    return Summary(digests, scope, reply)


def _write_copy(writer: Writer, copy: Copy) -> None:
    writer.source(copy.source).number(ASPECTS.index(copy.aspect))


def _read_copy(reader: Reader) -> Copy:
    return Copy(reader.source(), ASPECTS[reader.number(len(ASPECTS) - 1)])


def _write_want(writer: Writer, want: Want) -> None:
    _write_copy(writer, want.copy)
    writer.number(want.since).raw(want.writer).number(int(want.plain)).number(len(want.got))
    for name in sorted(want.got):
        writer.text(name).number(want.got[name])


def _read_want(reader: Reader) -> Want:
    copy, since, whose, plain = _read_copy(reader), reader.number(), reader.raw(WRITER), bool(reader.number(1))
    got = {reader.text(MOST_NAME): reader.number() for _ in range(reader.number(MOST_LISTED))}
    return Want(copy, since, whose, plain, got)


def _write_parts(writer: Writer, parts: Parts) -> None:
    _write_copy(writer, parts.copy)
    writer.number(parts.since).number(parts.number).number(parts.count).text(parts.reason.encode()[:MOST_CLAIM])
    writer.number(int(parts.head is not None))
    if parts.head is None:
        return
    head = parts.head
    writer.raw(head.writer)
    _write_offer(writer, head.offer)
    writer.number(head.version).number(_FORMS.index(head.form)).raw(head.digest).number(len(parts.pieces))
    before = b""
    for piece in parts.pieces:
        common = _common(before, piece.name)
        writer.number(common).text(piece.name[common:]).number(piece.version).number(_CHANGES.index(piece.change))
        if piece.change in ("difference", "against"):
            writer.raw(piece.base)
        if piece.change not in _BARE:
            writer.text(piece.packed)
        before = piece.name


def _common(one: bytes, other: bytes) -> int:
    """How many first bytes two names have in common."""
    both = min(len(one), len(other))
    return next((at for at in range(both) if one[at] != other[at]), both)


def _read_parts(reader: Reader) -> Parts:
    copy, since, number, count = _read_copy(reader), reader.number(), reader.number(), reader.number()
    reason = reader.text(MOST_CLAIM).decode(errors="replace")
    if number >= count:
        raise ValueError(f"it is message {number} of {count}")
    if not reader.number(1):
        return Parts(copy, since, None, number, count, (), reason)
    writer, offer, version = reader.raw(WRITER), _read_offer(reader), reader.number()
    head = Head(writer, offer, version, _FORMS[reader.number(len(_FORMS) - 1)], reader.raw(DIGEST))
    pieces: list[Piece] = []
    for _ in range(reader.number(MOST_LISTED)):
        pieces.append(_read_piece(reader, pieces[-1].name if pieces else b""))
    return Parts(copy, since, head, number, count, tuple(pieces), reason)


def _read_piece(reader: Reader, before: bytes) -> Piece:
    """One piece; of its name only what differs from the one before is told."""
    common = reader.number(len(before))
    name, version = before[:common] + reader.text(MOST_NAME - common), reader.number()
    change = _CHANGES[reader.number(len(_CHANGES) - 1)]
    base = reader.raw(BASE) if change in ("difference", "against") else b""
    return Piece(name, version, change, base, b"" if change in _BARE else reader.text(MOST_BYTES))


_READ: Final[Sequence[Callable[[Reader], Message]]] = (
    _read_hello,
    _read_summary,
    lambda reader: Told(tuple(texts(reader, MOST_LISTED, MOST_CLAIM))),
    _read_want,
    _read_parts,
    lambda reader: Namesake(reader.source(), reader.raw(WRITER)),
    read_met,
)
