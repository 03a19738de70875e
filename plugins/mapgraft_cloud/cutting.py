"""Layers in parts, for others who have most of them: one with what is said once, and one for each few blocks."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_cloud.blocks import AXES, HITS, MISSES, BlockPool, Blocks
from mapgraft_cloud.cloud_map import CloudMap
from mapgraft_cloud.codec import blocks_with, header_of, layer_with, positions_of, require_ordered
from mapgraft_cloud.kernels.block_keys import KEY_BITS, VOLUME
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.parameters import SensorModel
from mapgraft_cloud.region import BlockKeys

_HEAD: Final = b"h"
_NAME: Final = struct.Struct(">Bq")  # of which pool, and the cube
_COUNT: Final = struct.Struct("<HB")  # how many blocks, and bytes per count
_CUBE: Final = 1  # a cube is 2 × 2 × 2 blocks: 1.6 m of 0.1 m voxels
_MASK: Final = sum(((1 << KEY_BITS) - 1) >> _CUBE << (_CUBE + KEY_BITS * axis) for axis in range(3))


def cut(layer: CloudLayer) -> dict[bytes, bytes]:
    """A layer as parts, little-endian: ``h`` the header as ``encode`` writes it, with no blocks; and with the pool's
    number (the own is 0) and the cube's key for a name, the blocks of one cube.

    A cube tells how many blocks it has and how many bytes each count, the blocks' keys, byte planes of all hits and
    all misses, lowest first, and the position sums as ``encode`` has them.
    """
    pools = [pool for pool in layer.pools() if pool[1] is layer.own or pool[1].filled().size]
    parts = {_HEAD: header_of(layer, [(model, 0) for model, _ in pools])}
    for number, (_, pool) in enumerate(pools):
        for cube, keys in _cubes(pool.filled()):
            parts[_NAME.pack(number, cube)] = _told(pool.some(keys))
    return parts


def join(parts: Mapping[bytes, bytes]) -> CloudLayer:
    """The layer of these parts; raises MapError when they are not exactly what ``cut`` makes of one."""
    try:
        layer, models = layer_with(json.loads(parts[_HEAD]))
        pools = [BlockPool() for _ in models]
        for name in sorted(parts.keys() - {_HEAD}):
            number, cube = _NAME.unpack(name)
            blocks = _blocks(parts[name])
            if (blocks.keys & _MASK != cube).any():
                raise ValueError("blocks of another place")
            pools[number].add(blocks)
        layer.own, layer.absorbed = pools[0], dict(zip(models[1:], pools[1:], strict=True))
    except (ValueError, KeyError, TypeError, IndexError, struct.error, OverflowError, RecursionError) as fault:
        raise MapError(f"the parts of a point cloud map do not hold together ({fault}): send it again") from fault
    if cut(layer) != dict(parts):
        raise MapError("the parts of a point cloud map are not cut as written: send it again")
    return layer


def preview(layer: CloudLayer, seen: CloudMap) -> CloudLayer:
    """A layer with one look at each voxel that is made out in the view ``seen``, as sure as that view can be."""
    read = seen.thresholds
    made = CloudLayer(layer.voxel_m, SensorModel(read.clamp, -read.clamp))
    counts = np.zeros((seen.keys.size, 2, VOLUME), np.uint32)
    counts[:, HITS], counts[:, MISSES] = seen.log_odds >= read.occupied, seen.log_odds <= read.free
    some = counts.any(axis=(1, 2))
    made.own.add(blocks_with(seen.keys[some], counts[some], seen.offsets.T.astype(np.uint32)))
    made.observations, made.dropped, made.mapper = layer.observations, layer.dropped, layer.mapper
    made.sensors, made.floors = layer.sensors, layer.floors
    return made


def _cubes(keys: BlockKeys) -> Iterator[tuple[int, BlockKeys]]:
    """The blocks of each cube, ascending."""
    cubes = keys & _MASK
    order = np.argsort(cubes, kind="stable")
    found, first = np.unique(cubes[order], return_index=True)
    yield from zip(found.tolist(), np.split(keys[order], first[1:]), strict=False)


def _told(blocks: Blocks) -> bytes:
    used = (int(blocks.most).bit_length() + 7) // 8
    planes = blocks.counts.transpose(1, 0, 2).astype("<u4").view(np.uint8).reshape(2, -1, 4)[:, :, :used]
    head = _COUNT.pack(blocks.keys.size, used) + blocks.keys.astype("<i8").tobytes()
    return head + planes.transpose(2, 0, 1).tobytes() + positions_of(blocks).astype("<u4").tobytes()


def _blocks(data: bytes) -> Blocks:
    """The blocks of one cube; raises ValueError or struct.error when there are none in the bytes."""
    count, used = _COUNT.unpack_from(data)
    if not (count and 1 <= used <= 4):
        raise ValueError(f"{count} blocks of {used} bytes per count")
    keys = np.frombuffer(data, "<i8", count, _COUNT.size).astype(np.int64)
    require_ordered(keys)
    at = _COUNT.size + keys.nbytes
    both = np.zeros((2, count * VOLUME, 4), np.uint8)
    told = np.frombuffer(data, np.uint8, 2 * used * count * VOLUME, at)
    both[:, :, :used] = told.reshape(used, 2, count * VOLUME).transpose(1, 2, 0)
    counts = both.view("<u4").astype(np.uint32).reshape(2, count, VOLUME).transpose(1, 0, 2)
    positions: NDArray[np.uint32] = np.frombuffer(data, "<u4", -1, at + told.size).astype(np.uint32)
    return blocks_with(keys, np.ascontiguousarray(counts), positions.reshape(AXES, -1))
