"""Small layers of every map type, as they are encoded and unpacked, and offers, sound and not."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from functools import cache

import numpy as np
from fuzz_layers import KINDS, shrunk

from mapgraft.contracts import (
    Cloud,
    Donation,
    GridMessage,
    Layer,
    MapMetadata,
    Match,
    Observation,
    Provenance,
    Scan,
    Transform,
)
from mapgraft.exchange import Offer
from mapgraft_cloud.map_type import PointCloud
from mapgraft_cloud.voxels import Voxels
from mapgraft_floorplan.map_type import FloorPlanType
from mapgraft_floorplan.plan import PLAN, Plan
from mapgraft_grid.log_odds import LogOdds
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_lines.map_type import SEGMENTS, LineSegments, SegmentMap
from mapgraft_lines.union import LineUnion

T = Transform.planar(1.0, 2.0, 0.3)
DEEP = b"[" * 1500


def _observed(map_type, kind: str = "", payload: object = None, times: int = 1) -> Layer:
    layer = map_type.new_layer()
    for n in range(times if payload is not None else 0):
        map_type.integrate(layer, Observation("a", n, n, "laser", kind, payload, T, T))
    return layer


def _baked(map_type, fuser, kind: str, payload: object) -> Layer:
    """A layer that has taken in the evidence of another one."""
    layer, donor = _observed(map_type, kind, payload), _observed(map_type, kind, payload)
    match = Match(Transform.planar(3.0, 0.0, 0.0), 1.0, 1.0)
    contribution = fuser.fuse(map_type, map_type.view(layer), Donation(donor, Provenance("b", 0, 1)), match)
    map_type.absorb(layer, contribution)
    return layer


@cache
def small_layers() -> dict[bytes, list[bytes]]:
    angles = np.linspace(-0.5, 0.5, 3)
    scan = Scan(np.stack((np.cos(angles), np.sin(angles)), 1), np.full(3, 0.7, np.float32), np.ones(3, np.bool_))
    ready = GridMessage(np.array([[0, 100], [-1, 50]], np.int8), 0.1, Transform.identity())
    walls = np.array([[[0.0, 0.0], [3.0, 0.0]], [[3.0, 0.0], [3.0, 2.0]]])
    drawn = SegmentMap(walls, np.full(2, 0.02), np.zeros(2, np.bool_), np.full(2, 3), np.array([[0.5, 0.5]]))
    points = np.array([[0.4, 0.1, 0.2]], np.float32)
    grid, cloud, line, plan = OccupancyGrid(resolution_m=0.1), PointCloud(), LineSegments(), FloorPlanType()
    found = {
        b"g": [
            (grid, "", None, 1),
            (grid, "scan", scan, 1),
            (grid, "grid_message", ready, 1),
            (grid, "scan", scan, 99),
        ],
        b"c": [(cloud, "", None, 1), (cloud, "cloud", Cloud(points), 1)],
        b"l": [(line, "", None, 1), (line, "scan", scan, 2), (line, SEGMENTS, drawn, 1)],
        b"f": [(plan, "", None, 1), (plan, PLAN, Plan(walls.reshape(-1, 4), False), 1)],
    }
    layers = {kind: [case[0].encode(_observed(*case)) for case in cases] for kind, cases in found.items()}
    layers[b"g"].append(grid.encode(_baked(grid, LogOdds(), "scan", scan)))
    layers[b"c"].append(cloud.encode(_baked(cloud, Voxels(), "cloud", Cloud(points))))
    layers[b"l"].append(line.encode(_baked(line, LineUnion(), "scan", scan)))
    return layers


def _unpacked(kind: bytes, data: bytes) -> bytes:
    import zstandard

    head = KINDS[kind]
    return zstandard.ZstdDecompressor().decompressobj().decompress(data[len(head) :]) if head else data


def layer_seeds() -> list[bytes]:
    """The first byte chooses what the rest is, see ``fuzz_layers.layer``."""
    return [*_sent(), *_unfit_headers(), *_unfit_numbers(), *_offers()]


def _sent() -> Iterator[bytes]:
    for kind, all_data in small_layers().items():
        for data in all_data:
            if len(data) < 3000:
                yield kind + data
            if len(inner := _unpacked(kind, data)) < 60_000:
                yield kind.upper() + shrunk(inner)
        data = all_data[0]
        head = KINDS[kind]
        yield kind + data[:-3]
        yield kind + data + b"x"
        yield kind + b"MGNOTHING" + data
        yield kind + head[:-2] + b"\7\0" + data[len(head) :]
        yield kind + data[: len(head) + 3] + b"\xff\xff" + data[len(head) + 5 :]


def _unfit_headers() -> Iterator[bytes]:
    """Lines of JSON that no layer begins with."""
    for kind in (b"c", b"l", b"f"):
        line, _, body = _unpacked(kind, small_layers()[kind][1]).partition(b"\n")
        header = json.loads(line)
        for name, value in header.items():
            for other in (None, -1, "x", [], {}, 1.5, float("inf"), [[1]], 10**30, [[1, 2, 3, 1]], [[1, 2, 3, 0]]):
                changed = json.dumps({**header, name: other}, sort_keys=True).encode()
                yield kind.upper() + changed + b"\n" + shrunk(body[:5000])
            yield kind.upper() + line.replace(json.dumps(value).encode(), b"[" + json.dumps(value).encode() + b"]")
        yield kind.upper() + line
        yield kind.upper() + DEEP + b"\n"


def _unfit_numbers() -> Iterator[bytes]:
    """Bodies that say what cannot be, every number set to an edge in turn."""
    edges = (0, 1, -1, 3, 1 << 14, -(1 << 31), (1 << 31) - 1)
    for kind in (b"g", b"c", b"l", b"f"):
        for data in small_layers()[kind][1:]:
            inner = shrunk(_unpacked(kind, data))
            begin = inner.find(b"\n") + 1 if kind != b"g" else 0
            places = range(begin, len(inner) - 8, 4)
            for n, at in enumerate(places):
                if n < 40 or n % 7 == 0:
                    edge = edges[n % len(edges)]
                    yield kind.upper() + inner[:at] + struct.pack("<i", edge) + inner[at + 4 :]


def _offers() -> Iterator[bytes]:
    for bounds in (None, (0.0, 0.0, 1.0, 1.0)):
        metadata = MapMetadata("occupancy_grid", 0.05, bounds_m=bounds, can_send=("rays",), extra={"x": 1, "y": "z"})
        sound = json.loads(Offer(Provenance("a", 1, 2), metadata).encode())
        yield b"o" + json.dumps(sound).encode()
    for name in sound["metadata"]:
        for value in (None, "x", [1], {}, float("nan")):
            yield b"o" + json.dumps({**sound, "metadata": {**sound["metadata"], name: value}}).encode()
    for other in ({"extra": {"x": [1]}}, {"can_send": [1]}, {"bounds_m": [1, 2, 3, "x"]}, {"more": 1}):
        yield b"o" + json.dumps({**sound, "metadata": {**sound["metadata"], **other}}).encode()
    for value in ("x", [], None, ["a", float("inf"), 1], ["a", 1]):
        yield b"o" + json.dumps({**sound, "provenance": value}).encode()
        yield b"o" + json.dumps({**sound, "metadata": value}).encode()
    yield b"o" + DEEP
