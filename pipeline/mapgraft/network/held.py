"""What one robot holds of one source: its parts by name and version, and the last version of which it has all."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

from mapgraft.contracts import MapError
from mapgraft.exchange import Form
from mapgraft.network.packing import SMALL, difference, pack, restored, unpack
from mapgraft.network.wire import BASE, DIGEST, MOST_BYTES, MOST_NAME, PIECE, Head, Piece, digest_of

MOST_PARTS: Final = 1 << 17  # of one source, those that are gone included
MOST_HELD_BYTES: Final = 1 << 30  # of one source, compressed
FORMER: Final = 4  # so many earlier contents of each part are kept, for others who still have them
_SEEN: Final = 64  # versions that are remembered as having been complete here
_WHOLE: Final = 1 << (8 * DIGEST)

Taken = Literal["complete", "incomplete", "nothing new", "other base", "conflict"]


class Part(NamedTuple):
    """One part since a version of its source: the digest of its bytes, and these compressed; None where it is gone."""

    version: int
    digest: bytes
    packed: bytes | None

    def raw(self) -> bytes:
        """The bytes; raises MapError where there are none."""
        if self.packed is None:
            raise MapError("a part that is gone has no bytes")
        return unpack(self.packed, PIECE)


_GONE_DIGEST: Final = digest_of(b"gone")


@dataclass(slots=True)
class Held:
    """A copy of one layer or preview, on its way from version to version.

    A join-semilattice in what comes in: of two writers the one with the smaller id holds, of two versions of a part the
    newer one. What is asked of a copy is always answered from the last version that was complete.

    A version is complete when its digest is that of all live parts, or that of those alone which were named as live in
    it: the others are gone then, and nobody need have told so. Who took a version in from nothing has never heard of
    what went before it, and could not.
    """

    head: Head | None = None  # the newest that was told
    parts: dict[bytes, Part] = field(default_factory=dict)
    whole: Head | None = None  # of the last version that was complete
    whole_parts: dict[bytes, Part] = field(default_factory=dict)
    conflict: str = ""
    _former: dict[bytes, tuple[Part, ...]] = field(default_factory=dict)
    _seen: list[int] = field(default_factory=list)
    _sum: int = 0
    _named: set[bytes] = field(default_factory=set)  # parts that are here as the newest head has them, it was told
    _named_sum: int = 0
    _bytes: int = 0
    _told: dict[tuple[bytes, bytes], Piece] = field(default_factory=dict)  # (name, base digest) → how it is told

    @property
    def version(self) -> int:
        """The last version that was complete; 0 where none was."""
        return 0 if self.whole is None else self.whole.version

    def publish(self, writer: bytes, offer: bytes, version: int, form: Form,
                raw: Mapping[bytes, bytes]) -> None:  # fmt: skip
        """Put a version of one's own in the place of the last one, as parts in pieces (see ``pieces_of``).

        Raises MapError when others have heard of that version, or a newer one, with other contents.
        """
        fresh = {name: (data, digest_of(data)) for name, data in pieces_of(raw)}
        digest = _digest({name: told for name, (_, told) in fresh.items()})
        if self.whole is not None and version <= self.whole.version:
            if version == self.whole.version and digest == self.whole.digest and writer == self.whole.writer:
                return
            raise MapError(f"version {version} was told before with other contents: a change needs a newer version")
        for name in sorted(self.parts.keys() - fresh.keys()):
            if self.parts[name].packed is not None:
                self._put(name, Part(version, _GONE_DIGEST, None))
        for name, (data, told) in fresh.items():
            known = self.parts.get(name)
            if known is None or known.packed is None or known.digest != told:
                self._put(name, Part(version, told, pack(data)))
        self.head = Head(writer, offer, version, form, digest)
        self._complete(self.head)

    def take(self, head: Head, pieces: tuple[Piece, ...]) -> Taken:
        """Take in what came; ``other base`` says that something was told against what is not here.

        Raises MapError when it cannot be what it is said to be.
        """
        if self.conflict:
            return "conflict"
        if self.head is not None and head.writer != self.head.writer:
            if head.writer > self.head.writer:
                return "nothing new"
            self._forget()
        if self.head is not None and head.version == self.head.version and head.digest != self.head.digest:
            self.conflict = f"version {head.version} was told with two contents"
            return "conflict"
        if head.version <= self.version:
            return "nothing new"
        if self.head is None or head.version > self.head.version:
            self.head = head  # before its parts: none that is here is ever newer
            self._forget_names()
        fits = True
        for piece in pieces:
            fits = self._apply(piece, head.version) and fits
            if head.version == self.head.version:
                self._name(piece)
        if self._named_sum.to_bytes(DIGEST, "little") == self.head.digest:
            self._drop_others(self.head.version)
        if self._sum.to_bytes(DIGEST, "little") == self.head.digest:
            self._complete(self.head)
            return "complete"
        return "incomplete" if fits else "other base"

    def got(self) -> dict[bytes, int]:
        """Parts that have come of a newer version than the last complete one, by name, with their versions."""
        return {name: part.version for name, part in self.parts.items() if part.version > self.version}

    def start_anew(self) -> None:
        """Forget what has come since the last complete version: it does not make a whole."""
        self.head, self.parts = self.whole, dict(self.whole_parts)
        self._forget_names()
        live = {name: part.digest for name, part in self.parts.items() if part.packed is not None}
        self._sum = int.from_bytes(_digest(live), "little")
        self._bytes = sum(len(part.packed or b"") for part in self.parts.values())

    def pieces(self, since: int, got: Mapping[bytes, int], plain: bool) -> Iterator[Piece]:
        """What one needs who has the version ``since`` whole and ``got`` beyond it, to have what is complete here.

        ``plain`` names what has not changed, too, so that all of what is live is named.
        """
        exact = not plain and since in self._seen
        for name in sorted(self.whole_parts):
            part = self.whole_parts[name]
            if part.version <= max(since, got.get(name, 0)):
                if plain and part.packed is not None:
                    yield Piece(name, part.version, "kept")
                continue
            if part.packed is None:
                if since or name in got:
                    yield Piece(name, part.version, "gone")
            else:
                yield self._piece(name, part, self._base(name, since) if exact else None)

    def _apply(self, piece: Piece, version: int) -> bool:
        """Take one part in; False where it is told against what is not here, or was kept and is not here."""
        if not piece.name or len(piece.name) > MOST_NAME or piece.version > version:
            raise MapError(f"a part of version {piece.version} in one of version {version}, or without a name")
        known = self.parts.get(piece.name)
        if known is not None and known.version >= piece.version:
            return True
        if piece.change == "kept":
            return False
        if piece.change == "gone":
            self._put(piece.name, Part(piece.version, _GONE_DIGEST, None))
            return True
        try:
            base = b""
            if piece.change in ("difference", "against"):
                found = self._having(piece.name, piece.base)
                if found is None:
                    return False
                base = found.raw()
            data = unpack(piece.packed, PIECE, base if piece.change == "against" else b"")
        except ValueError as error:
            raise MapError(f"a part cannot be read: {error}") from None
        if piece.change == "difference":
            data = restored(data, base)
        self._put(
            piece.name, Part(piece.version, digest_of(data), piece.packed if piece.change == "whole" else pack(data))
        )
        return True

    def _name(self, piece: Piece) -> None:
        """A part is live in the version of the newest head: counted once it is here as it is there."""
        part = self.parts.get(piece.name)
        if part is None or part.packed is None or part.version != piece.version or piece.name in self._named:
            return
        self._named.add(piece.name)
        self._named_sum = (self._named_sum + _term(piece.name, part.digest)) % _WHOLE

    def _drop_others(self, version: int) -> None:
        """All parts that this version has were named: what else is here is gone in it, since whichever version."""
        for name in sorted(self.parts.keys() - self._named):
            if self.parts[name].packed is not None:
                self._put(name, Part(version, _GONE_DIGEST, None))

    def _having(self, name: bytes, digest: bytes) -> Part | None:
        for parts in (self.whole_parts, self.parts):
            part = parts.get(name)
            if part is not None and part.packed is not None and part.digest[:BASE] == digest:
                return part
        return None

    def _put(self, name: bytes, part: Part) -> None:
        known = self.parts.get(name)
        if known is None and len(self.parts) >= MOST_PARTS:
            raise MapError(f"a source of more than {MOST_PARTS} parts is not kept")
        if known is not None and known.packed is not None:
            term = _term(name, known.digest)
            self._sum = (self._sum - term) % _WHOLE
            self._bytes -= len(known.packed)
            if name in self._named:
                self._named.remove(name)
                self._named_sum = (self._named_sum - term) % _WHOLE
        if part.packed is not None:
            self._sum = (self._sum + _term(name, part.digest)) % _WHOLE
            self._bytes += len(part.packed)
        self.parts[name] = part
        if self._bytes > MOST_HELD_BYTES:
            raise MapError(f"a source of more than {MOST_HELD_BYTES} bytes is not kept")

    def _complete(self, head: Head) -> None:
        for name, part in self.parts.items():
            before = self.whole_parts.get(name)
            if before is not None and before is not part:
                self._former[name] = (before, *self._former.get(name, ()))[:FORMER]
        self.whole, self.whole_parts = head, dict(self.parts)
        self._seen = [*self._seen, head.version][-_SEEN:]
        self._told.clear()
        self._forget_names()

    def _base(self, name: bytes, since: int) -> Part | None:
        """What one has of a part who has that version whole, if it is still known here."""
        found = next((part for part in self._former.get(name, ()) if part.version <= since), None)
        return None if found is None or found.packed is None else found

    def _piece(self, name: bytes, part: Part, base: Part | None) -> Piece:
        """The shortest way to tell a part to one who has ``base`` of it."""
        key = (name, b"" if base is None else base.digest)
        if key not in self._told:
            self._told[key] = _shortest(name, part, base)
        return self._told[key]

    def _forget(self) -> None:
        """Another writer counts from now on: nothing of the former one's is kept."""
        self.head = self.whole = None
        for kept in (self.parts, self.whole_parts, self._former, self._told):
            kept.clear()
        self._seen, self._sum, self._bytes = [], 0, 0
        self._forget_names()

    def _forget_names(self) -> None:
        self._named.clear()
        self._named_sum = 0


def raw(parts: Mapping[bytes, Part]) -> dict[bytes, bytes]:
    """Parts unpacked, and as they were before they were cut into pieces; those that are gone are left out."""
    return joined({name: part.raw() for name, part in parts.items() if part.packed is not None})


def _shortest(name: bytes, part: Part, base: Part | None) -> Piece:
    """Chosen by what packs best quickly, and then packed well."""
    now = part.raw()
    if base is not None:
        before = base.raw()
        by = difference(now, before)
        quickly = {"difference": len(pack(by)) + BASE, "against": len(pack(now, before)) + BASE}
        change = min(quickly, key=lambda one: quickly[one])
        if quickly[change] < len(part.packed or b""):
            if change == "difference":
                return Piece(name, part.version, "difference", base.digest[:BASE], pack(by, level=SMALL))
            return Piece(name, part.version, "against", base.digest[:BASE], pack(now, before, level=SMALL))
    return Piece(name, part.version, "whole", b"", pack(now, level=SMALL))


def _term(name: bytes, digest: bytes) -> int:
    data = len(name).to_bytes(2, "little") + name + digest
    return int.from_bytes(hashlib.blake2b(data, digest_size=DIGEST).digest(), "little")


def _digest(digests: Mapping[bytes, bytes]) -> bytes:
    """The digest of all parts by the digests of each; a sum, so that one that changes costs no look at the others."""
    return (sum(_term(name, digest) for name, digest in digests.items()) % _WHOLE).to_bytes(DIGEST, "little")


def pieces_of(parts: Mapping[bytes, bytes]) -> Iterator[tuple[bytes, bytes]]:
    """Parts cut so that each fits a message; raises MapError where a name is too long or a part too large."""
    for name in sorted(parts):
        data = parts[name]
        count = max(1, -(-len(data) // PIECE))
        if len(name) > MOST_NAME - 2 or count > 0xFFFF:
            raise MapError(f"a part of {len(data)} bytes with a name of {len(name)} bytes cannot be sent")
        for place in range(count):
            yield name + place.to_bytes(2, "big"), data[place * PIECE : (place + 1) * PIECE]


def joined(pieces: Mapping[bytes, bytes]) -> dict[bytes, bytes]:
    """The inverse of ``pieces_of``; raises MapError where one is missing."""
    found: dict[bytes, list[bytes]] = {}
    for name in sorted(pieces):
        before = found.setdefault(name[:-2], [])
        if int.from_bytes(name[-2:], "big") != len(before):
            raise MapError("a part of which a piece is missing cannot be joined")
        before.append(pieces[name])
    return {name: b"".join(some) for name, some in found.items()}


def messages_of(pieces: Iterator[Piece]) -> list[tuple[Piece, ...]]:
    """Pieces in as few messages as hold about ``PIECE`` bytes each; one, without any, where there is none."""
    found: list[list[Piece]] = [[]]
    size = 0
    for piece in pieces:
        length = len(piece.packed) + len(piece.name) + DIGEST + 16
        if found[-1] and size + length > min(PIECE, MOST_BYTES // 2):
            found.append([])
            size = 0
        found[-1].append(piece)
        size += length
    return [tuple(some) for some in found]
