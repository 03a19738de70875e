"""Layers as bytes: canonical, compressed, and checked when they come back.

``MGCLOUD`` and a version, then one zstd frame: a line of JSON (size of the voxels, sensor model, observations, dropped
points, sensors, mapper, floors, and of each pool its sensor model and how many blocks hold evidence, the own pool
first), then of each pool the keys of its blocks as differences, and of every 256 blocks the hits, the misses, and the
position sums of the voxels with hits along x, y and z; little-endian. Blocks ascend and none is empty, so that equal
layers have equal bytes.
"""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft_cloud.blocks import AXES, HITS, BlockPool, Blocks
from mapgraft_cloud.kernels.block_keys import VOLUME, VOXEL_LIMIT
from mapgraft_cloud.kernels.placing import STEPS
from mapgraft_cloud.layer import FROM_CLOUDS, READY_MADE, CloudLayer
from mapgraft_cloud.parameters import COARSEST_M, FINEST_M, MOST_LOOKS, SensorModel
from mapgraft_cloud.region import corners_of
from mapgraft_standard.frames import Frame

_FRAME: Final = Frame("point cloud map", b"MGCLOUD", 1, 1 << 33)
_TOGETHER: Final = 256  # blocks whose numbers stand together
_MAPPERS: Final = ("", FROM_CLOUDS, READY_MADE)


def encode(layer: CloudLayer) -> bytes:
    """Canonical bytes of a layer: equal evidence gives equal bytes, however it came together."""
    told = [(model, pool, pool.filled()) for model, pool in layer.pools()]
    pools = [told[0], *(one for one in told[1:] if one[2].size)]
    header = {
        "voxel_m": layer.voxel_m,
        "observations": layer.observations,
        "dropped": layer.dropped,
        "sensors": sorted(layer.sensors),
        "mapper": layer.mapper,
        "floors": layer.floors.rows(),
        "pools": [[model.l_hit, model.l_miss, int(keys.size)] for model, _, keys in pools],
    }
    packer = _FRAME.packer().compressobj()
    packed = [packer.compress(json.dumps(header, sort_keys=True, ensure_ascii=True).encode() + b"\n")]
    for _, pool, keys in pools:
        packed.append(packer.compress(np.diff(keys, prepend=np.int64(0)).astype("<i8").tobytes()))
        for blocks in pool.blocks(_TOGETHER):
            packed.append(packer.compress(np.ascontiguousarray(blocks.counts.transpose(1, 0, 2), "<u4").tobytes()))
            block, place = np.nonzero(blocks.counts[blocks.solid, HITS])
            packed.append(packer.compress(np.ascontiguousarray(blocks.sums[block, :, place].T, "<u4").tobytes()))
    packed.append(packer.flush())
    return _FRAME.head + b"".join(packed)


def decode(data: bytes) -> CloudLayer:
    """The layer of these bytes; raises MapError when they are not exactly what ``encode`` makes."""
    body = _FRAME.unpacked(data)
    end = body.find(b"\n") + 1
    try:
        layer = _layer(json.loads(body[:end]), _Numbers(body, end))
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as fault:
        raise _FRAME.damaged(fault) from fault
    if encode(layer) != data:
        raise _FRAME.damaged("its parts are not as written")
    return layer


class _Numbers:
    """The body of a layer, read from its beginning to its end."""

    __slots__ = ("_body", "_place")

    def __init__(self, body: bytearray, place: int) -> None:
        self._body, self._place = body, place

    def take(self, kind: str, count: int) -> NDArray[np.integer]:
        """So many of the next numbers; ValueError where there are fewer."""
        found: NDArray[np.integer] = np.frombuffer(self._body, kind, count, self._place) if count else np.empty(0, kind)
        self._place += found.nbytes
        return found

    def require(self, nbytes: int) -> None:
        if len(self._body) - self._place < nbytes:
            raise ValueError(f"{len(self._body) - self._place} bytes of blocks where {nbytes} are announced")

    def end(self) -> None:
        if self._place != len(self._body):
            raise ValueError(f"{len(self._body)} bytes of blocks where {self._place} are announced")


def _layer(header: Any, body: _Numbers) -> CloudLayer:
    voxel_m = float(header["voxel_m"])
    if not FINEST_M <= voxel_m <= COARSEST_M:
        raise ValueError(f"voxels of {voxel_m} m")
    if header["mapper"] not in _MAPPERS or min(int(header["observations"]), int(header["dropped"])) < 0:
        raise ValueError(f"the mapper {header['mapper']!r} after {header['observations']} observations")
    if not header["pools"]:
        raise ValueError("no pools")
    models = [SensorModel(int(l_hit), int(l_miss)) for l_hit, l_miss, _ in header["pools"]]
    pools = [_pool(int(blocks), body) for _, _, blocks in header["pools"]]
    body.end()
    layer = CloudLayer(voxel_m, models[0])
    layer.own, layer.absorbed = pools[0], dict(zip(models[1:], pools[1:], strict=True))
    for x, y, height, sweeps in header["floors"]:
        if sweeps < 1 or max(map(abs, (x, y, height))) >= VOXEL_LIMIT:
            raise ValueError(f"a floor at {x}, {y}, {height} in {sweeps} sweeps")
        layer.floors.add((int(x), int(y), int(height)), int(sweeps))
    layer.observations, layer.dropped = int(header["observations"]), int(header["dropped"])
    layer.sensors, layer.mapper = frozenset(map(str, header["sensors"])), str(header["mapper"])
    return layer


def _pool(blocks: int, body: _Numbers) -> BlockPool:
    """A pool whose numbers can be what they are said to be; ValueError otherwise."""
    if blocks < 0:
        raise ValueError(f"{blocks} blocks")
    keys = np.cumsum(body.take("<i8", blocks).astype(np.int64))
    if blocks and (keys[0] < 0 or (np.diff(keys) <= 0).any() or np.abs(corners_of(keys)).max() > VOXEL_LIMIT):
        raise ValueError("its blocks are out of order")
    body.require(blocks * 2 * VOLUME * 4)
    pool = BlockPool(blocks)
    for first in range(0, blocks, _TOGETHER):
        some = keys[first : first + _TOGETHER]
        counts = body.take("<u4", 2 * some.size * VOLUME).reshape(2, some.size, VOLUME).transpose(1, 0, 2)
        hits = counts[:, HITS]
        solid = np.flatnonzero(hits.any(axis=1))
        block, place = np.nonzero(hits[solid])
        told = body.take("<u4", AXES * block.size).reshape(AXES, block.size)
        if (counts > MOST_LOOKS).any() or (told > (STEPS - 1) * hits[solid][block, place].astype(np.int64)).any():
            raise ValueError("counts or positions that cannot be")
        sums = np.zeros((solid.size, AXES, VOLUME), np.uint32)
        sums[block, :, place] = told.T
        pool.add(Blocks(some, np.ascontiguousarray(counts, np.uint32), solid, sums))
    return pool
