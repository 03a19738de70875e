"""Messages between robots, claims, and layers in parts, sound and not."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from fuzz_layer_seeds import DEEP, T, small_layers
from fuzz_messages import parts_told

from mapgraft.contracts import MapMetadata, Provenance
from mapgraft.exchange import Offer
from mapgraft.graph.claims import Claim, Source
from mapgraft.network.held import Held
from mapgraft.network.meetings import Met
from mapgraft.network.packing import pack, pack_offer
from mapgraft.network.wire import MAGIC, Copy, Hello, Namesake, Parts, Summary, Told, Want, encode
from mapgraft.rendezvous import Record, Seen
from mapgraft_cloud.map_type import PointCloud
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.map_type import LineSegments


def message_seeds() -> list[bytes]:
    """The first byte chooses what the rest is, see ``fuzz_messages.message``."""
    return [*_parts(), *_said()]


def _parts() -> Iterator[bytes]:
    """Layers in parts; one missing, empty, of another layer, or changed."""
    for kind, map_type in {b"g": OccupancyGrid(resolution_m=0.1), b"c": PointCloud(), b"l": LineSegments()}.items():
        cut = [map_type.parts(map_type.decode(data)) for data in small_layers()[kind]]
        for parts in cut:
            yield b"j" + kind + parts_told(parts)
            for name, part in parts.items():
                yield b"j" + kind + parts_told({other: parts[other] for other in parts if other != name})
                for changed in (b"", part[:-1], part + b"\0", bytes(len(part)), DEEP):
                    yield b"j" + kind + parts_told({**parts, name: changed})
        yield b"j" + kind + parts_told({**cut[0], **cut[-1]})
        yield b"j" + kind + parts_told({**cut[-1], b"": b"x", bytes(64): b"y"})


def _said() -> Iterator[bytes]:
    """Messages of every kind, and what is in them; sound ones, and some that have another length, kind or hash."""
    a, b = Source("a", 1), Source("b", 2)
    claims = [
        Claim(a, b, 1, "provisional", 0, T, support=3.0, stamp_ns=5, by="sequential"),
        Claim(a, b, 1, "reverted", 1, T, 1.5, np.eye(6), support=-3.0, stamp_ns=9, by="x", reason="y"),
    ]
    told = tuple(claim.encode() for claim in claims)
    untrue = [
        replace(claims[0], donor=a),
        replace(claims[0], scale=1e9),
        replace(claims[1], covariance=-np.eye(6)),
        replace(claims[1], covariance=np.full((6, 6), np.inf)),
    ]
    offer = Offer(Provenance("a", 1, 3), MapMetadata("occupancy_grid", 0.05)).encode()
    held, copy, still = Held(), Copy(a, "layer"), (1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    for version, data in enumerate(small_layers()[b"g"][:3], start=1):
        held.publish(b"writer-1", offer, version, "whole", {b"": data})
    assert held.whole is not None
    messages = [
        encode(message)
        for message in (
            Hello(b"writer-1", offer, bytes(16), bytes(16), told),
            Summary({a: bytes(16)}, (a,), True),
            Met(a, (Record(5, still), Record(7, still, Seen(1.0, 2.0, 0.5, 0.2, 0.1))), bytes(8), reply=True),
            Told(told),
            Want(copy, 2, b"writer-1", False, {b"part": 2}),
            Parts(copy, 0, held.whole, 0, 1, tuple(held.pieces(0, {}, False))),
            Parts(copy, 1, held.whole, 0, 1, tuple(held.pieces(1, {}, False))),
            Parts(copy, 3, held.whole, 0, 1, tuple(held.pieces(3, {}, True))),
            Parts(copy, 1, reason="there is none"),
            Namesake(a, b"writer-1"),
        )
    ]
    for data in messages:
        yield b"m" + data
        yield b"m" + data[:-1] + b"x"
        inner = data[len(MAGIC) : -8]
        yield b"w" + inner.replace(pack_offer(offer), pack(bytes(1 << 15)))
        for changed in (inner, inner[:-1], inner + b"\0", bytes([(inner[0] + 1) % 6]) + inner[1:], inner[:9] + inner):
            yield b"w" + changed
        for at in range(1, min(len(inner), 40)):
            yield b"w" + inner[:at] + b"\xff\xff\xff\x7f" + inner[at + 1 :]
    yield from (b"s" + data for data in (*told, *(claim.encode() for claim in untrue)))
    yield b"s" + told[0].replace(struct.pack("<d", 3.0), struct.pack("<d", math.nan))
    yield from (b"s" + told[1][:at] + b"\xff" + told[1][at + 1 :] for at in range(0, len(told[1]), 5))
