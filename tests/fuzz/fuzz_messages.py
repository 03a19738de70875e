"""Bytes that pass between robots: messages of every kind, claims, and layers in parts."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

from fuzz_recordings import Run

if TYPE_CHECKING:
    from mapgraft.network.replica import Replica
    from mapgraft.network.wire import Message


def parts_told(parts: Mapping[bytes, bytes]) -> bytes:
    """The parts of a layer in one piece, for the harness."""
    from mapgraft.network.packing import Writer, write_texts

    writer = Writer()
    write_texts(writer, [text for name in sorted(parts) for text in (name, parts[name])])
    return bytes(writer.data)


def told_parts(data: bytes) -> dict[bytes, bytes]:
    """The inverse of ``parts_told``, empty where it is none."""
    from mapgraft.network.packing import Reader, texts

    try:
        found = texts(Reader(data), 1 << 12, 1 << 16)
    except ValueError:
        return {}
    return dict(zip(found[::2], found[1::2], strict=False))


def message() -> Run:
    """The first byte chooses: a message, one without its hash (``w``), two that follow each other without theirs
    (``t``), a claim (``s``), or a layer in parts and whose these are (``j``)."""
    from mapgraft.contracts import MapError
    from mapgraft.graph.claims import Claim
    from mapgraft.network.replica import Replica
    from mapgraft.network.wire import MAGIC, decode, encode, sealed
    from mapgraft_cloud.map_type import PointCloud
    from mapgraft_grid.map_type import OccupancyGrid
    from mapgraft_lines.map_type import LineSegments

    kinds = {b"g": OccupancyGrid(), b"c": PointCloud(), b"l": LineSegments()}

    def hear(replica: Replica, data: bytes) -> None:
        found = decode(data)
        assert decode(encode(found)) == found
        taken(replica, found)

    def run(data: bytes) -> None:
        kind, body = data[:1], data[1:]
        with suppress(MapError):
            if kind == b"m":
                hear(Replica(), body)
            elif kind in (b"w", b"t"):
                replica = Replica()
                first = int.from_bytes(body[:2], "little") if kind == b"t" else len(body)
                for said in (body[2 : 2 + first], body[2 + first :]) if kind == b"t" else (body,):
                    with suppress(MapError):
                        hear(replica, sealed(MAGIC + said))
            elif kind == b"s":
                assert Claim.decode(body).encode() == body
            elif kind == b"j" and body[:1] in kinds:
                map_type = kinds[body[:1]]
                found = map_type.join(told_parts(body[1:]))
                again = map_type.join(map_type.parts(found))
                assert map_type.encode(again) == map_type.encode(found)

    return run


def taken(replica: Replica, message: Message) -> None:
    """What a robot does with a message that it can read, as far as that is a matter of the bytes alone."""
    from mapgraft.exchange import Offer
    from mapgraft.graph.claims import Claim
    from mapgraft.network.wire import Hello, Parts, Told, Want, encode

    if isinstance(message, Hello):
        Offer.decode(message.offer)
    if isinstance(message, Hello | Told):
        for claim in message.claims:
            Claim.decode(claim)
    if isinstance(message, Want):
        replica.answer(message)
    if isinstance(message, Parts) and message.head is not None:
        replica.take(message.copy, message.head, message.pieces)
        encode(replica.wish(message.copy))
        if (whole := replica.whole(message.copy)) is not None:
            whole.parts()
            for answer in replica.answer(Want(message.copy, 0)):
                encode(answer)
