"""What nodes tell each other of where their robots saw each other, before anything is made of their maps."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from mapgraft.graph.claims import Source
from mapgraft.network.packing import Reader, Writer
from mapgraft.rendezvous import FARTHEST, MOST, Record, Rendezvous, Seen, believable

ACK: Final = 8
NOTHING: Final = bytes(ACK)
_POSE: Final = struct.Struct("<q7d?")
_SEEN: Final = struct.Struct("<5d")


@dataclass(frozen=True, slots=True)
class Met:
    """The sender's side of all meetings with the receiver, and a digest of the last that it has from the receiver.

    What is no ``reply`` is said by who does not know whether it is known, and wants an answer.
    """

    source: Source
    records: tuple[Record, ...]
    ack: bytes = NOTHING
    reply: bool = False


def write_met(writer: Writer, met: Met) -> None:
    writer.source(met.source).raw(met.ack).number(int(met.reply)).number(len(met.records))
    for record in met.records:
        writer.raw(_POSE.pack(record.stamp_ns, *record.T_map_base, record.seen is not None))
        if record.seen is not None:
            writer.raw(_SEEN.pack(*record.seen))


def read_met(reader: Reader) -> Met:
    """Raises ValueError for what nobody can have been told."""
    source, ack, reply, records = reader.source(), reader.raw(ACK), bool(reader.number(1)), []
    for _ in range(reader.number(2 * MOST)):
        stamp_ns, *told = _POSE.unpack(reader.raw(_POSE.size))
        pose, has_seen = told[:7], told[7]
        square = sum(q * q for q in pose[3:])
        if not (all(abs(metres) <= FARTHEST for metres in pose[:3]) and abs(square - 1.0) < 1e-6):  # NaN, too
            raise ValueError("a pose in it is none")
        seen = Seen(*_SEEN.unpack(reader.raw(_SEEN.size))) if has_seen else None
        if seen is not None and not believable(seen):
            raise ValueError("a sighting in it is none")
        x, y, z, i, j, k, w = pose
        records.append(Record(stamp_ns, (x, y, z, i, j, k, w), seen))
    return Met(source, tuple(records), ack, reply)


def digest_of(records: Sequence[Record]) -> bytes:
    """Tells apart what was told; zeros for nothing."""
    if not records:
        return NOTHING
    writer = Writer()
    write_met(writer, Met(Source("", 0), tuple(records)))
    return hashlib.blake2b(bytes(writer.data), digest_size=ACK).digest()


@dataclass(slots=True)
class Meetings:
    """One node's part in it. Each side tells until the other has said that it knows; ``news`` hears what is new."""

    book: Rendezvous
    news: Callable[[Source, int], None]
    _known_by: dict[str, bytes] = field(default_factory=dict)  # peer → what it said it has of this robot
    _known_of: dict[str, bytes] = field(default_factory=dict)  # peer → what this robot has of it

    def greeting(self, me: Source, peer: str, other: Source | None) -> list[Met]:
        """What to tell a peer on contact: nothing where it knows."""
        records = self.book.records(other or peer)
        if digest_of(records) == self._known_by.get(peer, NOTHING):
            return []
        return [Met(me, records, self._known_of.get(peer, NOTHING))]

    def heard(self, me: Source, peer: str, met: Met, now_ns: int) -> list[Met]:
        """Take in what a peer told; returns the answer, if it needs one."""
        self._known_by[peer] = met.ack
        theirs, before = digest_of(met.records), self._known_of.get(peer, NOTHING)
        self._known_of[peer] = theirs
        is_news = self.book.heard(met.source, met.records)
        records = self.book.records(met.source)
        if is_news:
            self.news(met.source, now_ns)
        if met.reply and digest_of(records) == met.ack and theirs == before:
            return []
        return [Met(me, records, theirs, reply=True)]
