"""Placing a layer in another frame and voxel size, by integers only, so that it comes out the same everywhere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import EmptyMapError, MapError, Transform
from mapgraft_cloud.blocks import AT_ONCE, AXES, HITS, MISSES, BlockPool, Blocks
from mapgraft_cloud.floors import Floor
from mapgraft_cloud.kernels import placing
from mapgraft_cloud.kernels.block_keys import BLOCK, VOLUME, VOXEL_LIMIT
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.parameters import SensorModel
from mapgraft_cloud.region import BlockKeys, corners_of, find, keys_of, places_of

RESAMPLER: Final = "surest_mean_point_nearest_miss/1"
_MOST_RATIO: Final = 64  # between two sizes of voxels, scale included
_MOST_BLOCKS: Final = 1 << 20  # of a placed layer: 4 GB of counts, and 6 KB more for each that holds a wall
_AT_ONCE: Final = 1 << 12  # blocks whose neighbours are listed at once
_HALF: Final = 1 << (placing.PLACES - 1)


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

    A voxel with hits goes, with all that it counted, to where its mean point comes to lie; of several that come to one,
    the most surely occupied one counts. Voxels that nothing came to get the misses of the voxel at their centre. Raises
    EmptyMapError when the layer holds nothing, MapError when it cannot be placed.
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
    placed.own = _moved(layer.own, layer.sensor_model, move)
    placed.absorbed = {model: _moved(pool, model, move) for model, pool in layer.absorbed.items()}
    if not placed.keys().size:
        raise EmptyMapError("the donor's point cloud map is empty: there is nothing to place")
    for (x, y, height), sweeps in layer.floors.sweeps.items():
        placed.floors.add(_moved_floor((x, y, height), move), sweeps)
    placed.observations, placed.dropped = layer.observations, layer.dropped
    placed.sensors, placed.mapper = layer.sensors, layer.mapper
    return placed


def _moved_floor(floor: Floor, move: _Move) -> Floor:
    """The floor below the block in whose middle the middle of its block comes to lie."""
    middle = np.array([floor[0] * BLOCK + BLOCK // 2, floor[1] * BLOCK + BLOCK // 2, floor[2]]) * placing.STEPS
    x, y, height = (((move.forward @ middle + _HALF) >> placing.PLACES) + move.shift).tolist()
    side = BLOCK * placing.STEPS
    return x // side, y // side, (height + placing.STEPS // 2) // placing.STEPS


def _moved(pool: BlockPool, model: SensorModel, move: _Move) -> BlockPool:
    source = pool.filled()
    out = BlockPool()
    if not source.size:
        return out
    blocks, places, counts = _points(pool, source, model, move)
    targets = np.union1d(_candidates(source, move), blocks)
    if targets.size > _MOST_BLOCKS:
        raise MapError(f"the placed map would have {targets.size} blocks of voxels: give the receiver larger voxels")
    for first in range(0, targets.size, AT_ONCE):
        keys = targets[first : first + AT_ONCE]
        rows = slice(*np.searchsorted(blocks, (keys[0], keys[-1] + 1)).tolist())
        at = find(keys, blocks[rows]), places[rows]
        table = np.zeros((keys.size, 2, VOLUME), np.uint32)
        table[at[0], HITS, at[1]], table[at[0], MISSES, at[1]] = counts[rows, 0], counts[rows, 1]
        placing.gathered(keys, table, pool.keys, pool.slots, pool.counts, move.backward, move.shift)
        some = table.any(axis=(1, 2))
        solid = np.flatnonzero(table[some, HITS].any(axis=1))
        sums = np.zeros((keys.size, AXES, VOLUME), np.uint32)
        for axis in range(AXES):
            sums[at[0], axis, at[1]] = counts[rows, 2 + axis]
        out.add(Blocks(keys[some], table[some], solid, sums[some][solid]))
    return out


def _points(
    pool: BlockPool, source: BlockKeys, model: SensorModel, move: _Move
) -> tuple[BlockKeys, NDArray[np.int64], NDArray[np.int64]]:
    """What the voxels with hits become: blocks (n,), places (n,) in them, counts and position sums (n, 5), in order."""
    voxels, moved = [np.empty((0, 3), np.int32)], [np.empty((0, 2 + AXES), np.int64)]
    for first in range(0, source.size, AT_ONCE):
        keys = source[first : first + AT_ONCE]
        slots = pool.slots[find(pool.keys, keys)]
        hits = int(np.count_nonzero(pool.counts[slots, HITS]))
        there, counted = np.empty((hits, 3), np.int32), np.empty((hits, 2 + AXES), np.int64)
        arrays = pool.counts, pool.sums, pool.rows
        placing.scattered(keys, slots, *arrays, move.forward, move.shift, there, counted)
        _require_reach(there)
        voxels.append(there)
        moved.append(counted)
    whole = np.concatenate(voxels).astype(np.int64)
    blocks, places = keys_of(whole), places_of(whole)
    order = np.lexsort((places, blocks))
    blocks, places, counts = blocks[order], places[order], np.concatenate(moved)[order]
    left = placing.together(blocks, places, counts, np.array([model.l_hit, model.l_miss], np.int64))
    return blocks[:left], places[:left], counts[:left]


def _require_reach(voxels: NDArray[np.integer]) -> None:
    if voxels.size and int(np.abs(voxels).max()) >= VOXEL_LIMIT:
        raise MapError("a point cloud map reaches ±2^20 voxels, and the transform leads beyond: check it")


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
        voxels = near[inside] * BLOCK
        _require_reach(voxels)
        found.append(np.unique(keys_of(voxels)))
    return np.unique(np.concatenate(found))


def _whole(values: NDArray[np.floating]) -> NDArray[np.int64]:
    return np.round(values).astype(np.int64)
