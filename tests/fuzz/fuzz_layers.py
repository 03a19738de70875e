"""Bytes that pass between robots: layers of every map type, packed and unpacked, messages and offers."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

from fuzz_recordings import Run

if TYPE_CHECKING:
    from mapgraft.network.wire import Message

KINDS = {b"g": b"MGGRID\x01\x00", b"c": b"MGCLOUD\x01\x00", b"l": b"MGLINES\x01\x00", b"f": b""}
"""The letter of a map type, and what stands before the packed bytes of its layers."""

_ZEROS = re.compile(rb"\0{12,}")
_MARK = re.compile(rb"~~(..)", re.DOTALL)


def shrunk(data: bytes) -> bytes:
    """The inside of a layer, mostly zeros, so short that single numbers are likely to be changed."""
    return _ZEROS.sub(lambda run: b"~~" + min(len(run[0]), 0xFFFF).to_bytes(2, "little"), data)


def grown(data: bytes) -> bytes:
    """What ``shrunk`` has made short."""
    return _MARK.sub(lambda mark: bytes(int.from_bytes(mark[1], "little")), data)[: 1 << 17]


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


def taken(message: Message) -> None:
    """What a robot does with a message that it can read, as far as that is a matter of the bytes alone."""
    from mapgraft.exchange import Offer
    from mapgraft.graph.claims import Claim
    from mapgraft.network.replica import Replica
    from mapgraft.network.wire import Hello, Parts, Told

    if isinstance(message, Hello):
        Offer.decode(message.offer)
    if isinstance(message, Hello | Told):
        for claim in message.claims:
            Claim.decode(claim)
    if isinstance(message, Parts) and message.head is not None:
        replica = Replica()
        replica.take(message.copy, message.head, message.pieces)
        if (whole := replica.whole(message.copy)) is not None:
            whole.parts()


def layer() -> Run:
    """The first byte chooses: an offer, a claim, a message (``w``: but for its hash), a layer in parts, one as it is
    encoded, or (capitals) the inside of that."""
    import zstandard

    from mapgraft.contracts import PartedType, Transform
    from mapgraft.errors import MapgraftError
    from mapgraft.exchange import Offer
    from mapgraft.graph.claims import Claim
    from mapgraft.network.wire import MAGIC, sealed
    from mapgraft.network.wire import decode as hear
    from mapgraft.network.wire import encode as say
    from mapgraft_cloud import codec as clouds
    from mapgraft_cloud.map_type import PointCloud
    from mapgraft_floorplan import codec as plans
    from mapgraft_floorplan.map_type import FloorPlanType
    from mapgraft_grid import codec as grids
    from mapgraft_grid.map_type import OccupancyGrid
    from mapgraft_lines import codec as lines
    from mapgraft_lines.map_type import LineSegments

    T = Transform.planar(1.0, 2.0, 0.5)
    pack = zstandard.ZstdCompressor(level=3, write_checksum=True).compress
    readers = {
        b"g": (grids, OccupancyGrid()),
        b"c": (clouds, PointCloud()),
        b"l": (lines, LineSegments()),
        b"f": (plans, FloorPlanType()),
    }

    def read(kind: bytes, data: bytes) -> None:
        codec, map_type = readers[kind]
        found = codec.decode(data)
        again = codec.encode(found)
        assert codec.encode(codec.decode(again)) == again
        with suppress(MapgraftError):  # what knows nothing cannot be viewed
            map_type.metadata(found)
            assert map_type.view(found).known() >= 0
            map_type.place(found, T)

    def joined(kind: bytes, parts: dict[bytes, bytes]) -> None:
        codec, map_type = readers[kind]
        if isinstance(map_type, PartedType):
            found = map_type.join(parts)
            assert codec.encode(map_type.join(map_type.parts(found))) == codec.encode(found)

    def run(data: bytes) -> None:
        kind, body = data[:1], data[1:]
        with suppress(MapgraftError):
            if kind == b"o":
                offer = Offer.decode(body)
                assert Offer.decode(offer.encode()).encode() == offer.encode()
            elif kind == b"s":
                assert Claim.decode(body).encode() == body
            elif kind in (b"m", b"w"):
                message = hear(body if kind == b"m" else sealed(MAGIC + body))
                assert hear(say(message)) == message
                taken(message)
            elif kind == b"j" and body[:1] in readers:
                joined(body[:1], told_parts(body[1:]))
            elif kind in readers:
                read(kind, body)
            elif (lower := kind.lower()) in readers:
                read(lower, KINDS[lower] + pack(grown(body)) if KINDS[lower] else grown(body))

    return run
