"""Layers as canonical bytes: equal layers give equal bytes."""

from __future__ import annotations

import json
import struct
import zlib
from typing import Final

import numpy as np

from mapgraft.contracts import MapError
from mapgraft_cloud.blocks import CHANNELS, BlockPool
from mapgraft_cloud.kernels.block_keys import VOLUME
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.parameters import COARSEST_M, FINEST_M, SensorModel

_MAGIC: Final = b"mapgraft point_cloud 1\n"
_LEVEL: Final = 3
_LARGEST: Final = 1 << 34  # bytes unpacked


def encode(layer: CloudLayer) -> bytes:
    """The layer's parameters as JSON, then per sensor model the blocks that hold evidence, delta-coded and deflated."""
    tables = {model: pool.table() for model, pool in sorted(layer.pools.items())}
    head = {
        "voxel_m": layer.voxel_m,
        "model": [layer.sensor_model.l_hit, layer.sensor_model.l_miss],
        "observations": layer.observations,
        "dropped": layer.dropped,
        "sensors": sorted(layer.sensors),
        "mapper": layer.mapper,
        "pools": [
            [model.l_hit, model.l_miss, int(keys.size)]
            for model, (keys, _) in tables.items()
            if keys.size or model == layer.sensor_model
        ],
    }
    text = json.dumps(head, sort_keys=True, separators=(",", ":")).encode()
    body = b"".join(
        np.diff(keys, prepend=0).astype("<i8").tobytes() + counts.transpose(1, 0, 2).astype("<u4").tobytes()
        for keys, counts in tables.values()
    )
    return _MAGIC + struct.pack("<I", len(text)) + text + zlib.compress(body, _LEVEL)


def decode(data: bytes) -> CloudLayer:
    """The inverse of ``encode``; raises MapError when the bytes are no layer."""
    try:
        return _decoded(bytes(data))
    except (ValueError, KeyError, TypeError, IndexError, struct.error, zlib.error, OverflowError, MemoryError) as error:
        raise MapError(f"these bytes are no layer of a point cloud map: {error}") from error


def _decoded(data: bytes) -> CloudLayer:
    if not data.startswith(_MAGIC):
        raise ValueError(f"they begin with {data[:24]!r}")
    start = len(_MAGIC) + 4
    (length,) = struct.unpack_from("<I", data, len(_MAGIC))
    head = json.loads(data[start : start + length])
    voxel_m = float(head["voxel_m"])
    if not FINEST_M <= voxel_m <= COARSEST_M:
        raise ValueError(f"voxels of {voxel_m} m")
    unpack = zlib.decompressobj()
    body = unpack.decompress(data[start + length :], _LARGEST)
    if not unpack.eof or unpack.unused_data:
        raise ValueError("they are cut short or go on after the end")
    layer = CloudLayer(voxel_m, SensorModel(*(int(value) for value in head["model"])))
    layer.pools, place = {}, 0
    for l_hit, l_miss, blocks in head["pools"]:
        pool, place = _pool(body, place, int(blocks))
        layer.pools[SensorModel(int(l_hit), int(l_miss))] = pool
    if place != len(body) or layer.sensor_model not in layer.pools:
        raise ValueError(f"{len(body)} bytes of blocks where {place} are announced")
    layer.observations, layer.dropped = int(head["observations"]), int(head["dropped"])
    layer.sensors, layer.mapper = frozenset(map(str, head["sensors"])), str(head["mapper"])
    return layer


def _pool(body: bytes, place: int, blocks: int) -> tuple[BlockPool, int]:
    steps = np.frombuffer(body, "<i8", blocks, place)
    place += steps.nbytes
    flat = np.frombuffer(body, "<u4", CHANNELS * blocks * VOLUME, place)
    place += flat.nbytes
    keys = np.cumsum(steps).astype(np.int64)
    if blocks and (keys[0] < 0 or (np.diff(keys) <= 0).any()):
        raise ValueError("their blocks do not ascend")
    counts = flat.reshape(CHANNELS, blocks, VOLUME).transpose(1, 0, 2)
    return BlockPool.of(keys, counts), place
