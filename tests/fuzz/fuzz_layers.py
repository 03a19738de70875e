"""Bytes that pass between robots: layers of every map type, packed and unpacked, and offers."""

from __future__ import annotations

import re
from contextlib import suppress

from fuzz_recordings import Run

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


def layer() -> Run:
    """The first byte chooses: an offer, a layer as it is encoded, or (capitals) the inside of one."""
    import zstandard

    from mapgraft.contracts import Transform
    from mapgraft.errors import MapgraftError
    from mapgraft.exchange import Offer
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

    def run(data: bytes) -> None:
        kind, body = data[:1], data[1:]
        with suppress(MapgraftError):
            if kind == b"o":
                offer = Offer.decode(body)
                assert Offer.decode(offer.encode()).encode() == offer.encode()
            elif kind in readers:
                read(kind, body)
            elif (lower := kind.lower()) in readers:
                read(lower, KINDS[lower] + pack(grown(body)) if KINDS[lower] else grown(body))

    return run
