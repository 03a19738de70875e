"""Bytes that pass between robots: messages of every kind, claims, and layers in parts."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

from fuzz_layers import grown, shrunk
from fuzz_recordings import Run


def parts_told(parts: Mapping[bytes, bytes]) -> bytes:
    """The parts of a layer in one piece, mostly zeros made short, for the harness."""
    from mapgraft.network.packing import Writer, write_texts

    writer = Writer()
    write_texts(writer, [text for name in sorted(parts) for text in (name, shrunk(parts[name]))])
    return bytes(writer.data)


def told_parts(data: bytes) -> dict[bytes, bytes]:
    """The inverse of ``parts_told``, empty where it is none."""
    from mapgraft.network.packing import Reader, texts

    try:
        found = texts(Reader(data), 1 << 12, 1 << 16)
    except ValueError:
        return {}
    return {name: grown(part) for name, part in zip(found[::2], found[1::2], strict=False)}


def message() -> Run:
    """The first byte chooses: a message, one without its hash (``w``), a claim (``s``), or a layer in parts and whose
    these are (``j``)."""
    from mapgraft.contracts import MapError
    from mapgraft.graph.claims import Claim, Claims
    from mapgraft.network.wire import MAGIC, decode, encode, kind_of, sealed
    from mapgraft_cloud.map_type import PointCloud
    from mapgraft_grid.map_type import OccupancyGrid
    from mapgraft_lines.map_type import LineSegments

    kinds = {b"g": OccupancyGrid(), b"c": PointCloud(), b"l": LineSegments()}

    def run(data: bytes) -> None:
        kind, body = data[:1], data[1:]
        with suppress(MapError):
            if kind in (b"m", b"w"):
                found = decode(body if kind == b"m" else sealed(MAGIC + body))
                told = encode(found)
                assert encode(decode(told)) == told and kind_of(found)  # a direction that nobody knows is NaN
            elif kind == b"s":
                claim = Claim.decode(body)
                claims = Claims([claim, claim])
                assert claim.encode() == body and [*claims] == [claim] and claims.digest() == claims.digest()
            elif kind == b"j" and body[:1] in kinds:
                map_type = kinds[body[:1]]
                found = map_type.join(told_parts(body[1:]))
                again = map_type.join(map_type.parts(found))
                assert map_type.encode(again) == map_type.encode(found)

    return run
