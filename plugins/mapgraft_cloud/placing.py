"""Placing a layer in another frame and voxel size, by integers only, so that it comes out the same everywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import EmptyMapError, MapError, Transform
from mapgraft_cloud.blocks import CHANNELS, HITS, SUM_X, BlockPool
from mapgraft_cloud.kernels import placing
from mapgraft_cloud.kernels.block_keys import BLOCK, VOLUME, VOXEL_LIMIT
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.region import BlockKeys, corners_of, find, keys_of, places_of

RESAMPLER: Final = "mean_point_nearest_miss/1"
_MOST_RATIO: Final = 64  # between two sizes of voxels, scale included
_MOST_BLOCKS: Final = 1 << 20  # of a placed layer: 10 GB of counts
_AT_ONCE: Final = 1 << 14  # blocks whose neighbours are listed at once


@dataclass(frozen=True, slots=True)
class _Move:
    """p_target = forward · p_source + shift, in 1/1024 voxel of either side, with 24 binary places."""

    forward: NDArray[np.int64]
    backward: NDArray[np.int64]
    shift: NDArray[np.int64]
    ratio: float

    @classmethod
    def of(cls, T: Transform, scale: float, source_m: float, target_m: float) -> _Move:
        ratio = scale * source_m / target_m
        rotation, one = T.matrix[:3, :3], 1 << placing.PLACES
        return cls(
            _whole(rotation * (ratio * one)),
            _whole(rotation.T * (one / ratio)),
            _whole(T.matrix[:3, 3] / target_m * placing.STEPS),
            ratio,
        )


def place(layer: CloudLayer, T_receiver_donor: Transform, scale: float, voxel_m: float) -> CloudLayer:
    """The layer's evidence in voxels of another size, after scaling by ``scale`` and moving by the snapped transform.

    A voxel with hits goes, with all that it counted, to where its mean point comes to lie; voxels that nothing came to
    get the misses of the voxel at their centre. Raises EmptyMapError when the layer holds nothing, MapError when it
    cannot be placed.
    """
    if not (math.isfinite(scale) and scale > 0):
        raise MapError(f"the scale of a point cloud map must be positive, found {scale}")
    T = T_receiver_donor.snapped()
    move = _Move.of(T, scale, layer.voxel_m, voxel_m)
    if not 1 / _MOST_RATIO <= move.ratio <= _MOST_RATIO:
        raise MapError(
            f"voxels of {layer.voxel_m} m, stretched by {scale:g}, cannot be placed in voxels of {voxel_m} m: "
            f"their sides may differ {_MOST_RATIO} times"
        )
    placed = CloudLayer(voxel_m, layer.sensor_model)
    placed.pools = {model: _moved(pool, move) for model, pool in layer.pools.items()}
    if not any(pool.keys.size for pool in placed.pools.values()):
        raise EmptyMapError("the donor's point cloud map is empty: there is nothing to place")
    placed.observations, placed.dropped = layer.observations, layer.dropped
    placed.sensors, placed.mapper = layer.sensors, layer.mapper
    return placed


def _moved(pool: BlockPool, move: _Move) -> BlockPool:
    keys, table = pool.table()
    counts = table.astype(np.int64)
    if not keys.size:
        return BlockPool()
    hits = int(np.count_nonzero(counts[:, HITS]))
    voxels, moved = np.empty((hits, 3), np.int64), np.empty((hits, CHANNELS), np.int64)
    placing.scattered(keys, counts, move.forward, move.shift, voxels, moved)
    targets = np.union1d(_candidates(keys, move), _checked(voxels))
    if targets.size > _MOST_BLOCKS:
        raise MapError(f"the placed map would have {targets.size} blocks of voxels: give the receiver larger voxels")
    out = np.zeros((targets.size, CHANNELS, VOLUME), np.int64)
    blocks, places = find(targets, keys_of(voxels)), places_of(voxels)
    for channel in range(CHANNELS):
        np.add.at(out[:, channel], (blocks, places), moved[:, channel])
    placing.gathered(targets, out, keys, counts, move.backward, move.shift)
    some = out[:, :SUM_X].any(axis=(1, 2))
    return BlockPool.of(targets[some], out[some])


def _checked(voxels: NDArray[np.int64]) -> BlockKeys:
    if voxels.size and int(np.abs(voxels).max()) >= VOXEL_LIMIT:
        raise MapError("a point cloud map reaches ±2^20 voxels, and the transform leads beyond: check it")
    return np.unique(keys_of(voxels))


def _candidates(keys: BlockKeys, move: _Move) -> BlockKeys:
    """The target blocks that can hold the centre of a voxel whose own place lies in one of the source's blocks."""
    found = []
    half = BLOCK * placing.STEPS // 2
    reach = math.ceil(math.sqrt(3) * half * move.ratio) + placing.STEPS  # half a diagonal, and rounding
    for start in range(0, keys.size, _AT_ONCE):
        centres = corners_of(keys[start : start + _AT_ONCE]) * placing.STEPS + half
        middle = ((centres @ move.forward.T) >> placing.PLACES) + move.shift
        low, high = (middle - reach) // (2 * half), (middle + reach) // (2 * half)
        steps = np.arange(int((high - low).max(initial=0)) + 1)
        spread = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
        near = low[:, None] + spread
        inside = (near <= high[:, None]).all(axis=2)
        found.append(np.unique(keys_of(_within(near[inside] * BLOCK))))
    return np.unique(np.concatenate(found))


def _within(voxels: NDArray[np.int64]) -> NDArray[np.int64]:
    _checked(voxels)
    return voxels


def _whole(values: NDArray[np.floating]) -> NDArray[np.int64]:
    return np.round(values).astype(np.int64)
