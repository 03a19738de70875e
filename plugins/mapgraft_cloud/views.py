"""Computing a map from layers, whole or where something has changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Contribution, MapError
from mapgraft_cloud.blocks import BlockPool
from mapgraft_cloud.cloud_map import CloudMap, Offsets
from mapgraft_cloud.kernels import viewing
from mapgraft_cloud.kernels.block_keys import VOLUME
from mapgraft_cloud.layer import CloudLayer, as_layer
from mapgraft_cloud.parameters import SensorModel, Thresholds
from mapgraft_cloud.region import BlockKeys, find

Part = tuple[SensorModel, BlockPool, int]  # what was counted, and how often it counts
_AT_ONCE: Final = 1024  # blocks: 20 MB while they are summed


def parts_of(own: CloudLayer, contributions: Sequence[Contribution]) -> list[Part]:
    """Everything that a view sums; raises MapError when a contribution has voxels of another size."""
    layers = [(own, 1), *((as_layer(c.layer), weight_of(c)) for c in contributions)]
    for layer, _ in layers:
        if layer.voxel_m != own.voxel_m:
            raise MapError(
                f"a layer of {layer.voxel_m} m voxels does not fit a map of {own.voxel_m} m voxels: place it first"
            )
    return [(model, pool, weight) for layer, weight in layers for model, pool in layer.pools() if weight]


def weight_of(contribution: Contribution) -> int:
    """How often each of the donor's looks counts; raises MapError unless it is a whole number from 0 to 3."""
    weight = contribution.weights
    if isinstance(weight, bool) or not isinstance(weight, int) or not 0 <= weight <= 3:
        raise MapError(f"a contribution to a point cloud map is weighted by a whole number 0 … 3, found {weight!r}")
    return weight


def fresh(voxel_m: float, parts: Sequence[Part], thresholds: Thresholds) -> CloudMap:
    keys = np.unique(np.concatenate([np.empty(0, np.int64), *(pool.keys for _, pool, _ in parts)]))
    return _map(voxel_m, thresholds, keys, *_evaluated(keys, parts, thresholds))


def updated(previous: CloudMap, parts: Sequence[Part], touched: BlockKeys) -> CloudMap:
    """The map of which only touched blocks have changed since an earlier view."""
    read = previous.thresholds
    log_odds, offsets = _evaluated(touched, parts, read)
    keys = np.union1d(previous.keys, touched)
    all_odds = np.zeros((keys.size, VOLUME), np.int16)
    kept, changed = find(keys, previous.keys), find(keys, touched)
    all_odds[kept], all_odds[changed] = previous.log_odds, log_odds
    # of which block the offsets are, before and now; in one block they stay in their order
    old, new = kept[previous.occupied[0]], changed[np.nonzero(log_odds >= read.occupied)[0]]
    stays = ~np.isin(old, changed)
    order = np.argsort(np.concatenate((old[stays], new)), kind="stable")
    return _map(previous.voxel_m, read, keys, all_odds, np.concatenate((previous.offsets[stays], offsets))[order])


def _map(
    voxel_m: float,
    thresholds: Thresholds,
    keys: BlockKeys,
    log_odds: NDArray[np.int16],
    offsets: Offsets,
) -> CloudMap:
    some = log_odds.any(axis=1)  # blocks in which all evidence cancels are as if they had never been there
    if some.all():
        return CloudMap(voxel_m, thresholds, keys, log_odds, offsets)
    return CloudMap(voxel_m, thresholds, keys[some], log_odds[some], offsets)


def _evaluated(keys: BlockKeys, parts: Sequence[Part], thresholds: Thresholds) -> tuple[NDArray[np.int16], Offsets]:
    """The clamped log-odds (k, 512) of blocks, and the mean positions (n, 3) in those of their voxels that are
    occupied."""
    log_odds, offsets = np.zeros((keys.size, VOLUME), np.int16), [np.empty((0, 3), np.uint16)]
    for start in range(0, keys.size, _AT_ONCE):
        some = keys[start : start + _AT_ONCE]
        odds, positions = np.zeros((some.size, VOLUME), np.int64), np.zeros((some.size, 4, VOLUME), np.int64)
        for model, pool, weight in parts:
            numbers = np.array([model.l_hit, model.l_miss, weight], np.int64)
            arrays = pool.keys, pool.counts, pool.slots, pool.sums, pool.rows
            viewing.add_evidence(some, odds, positions, *arrays, numbers)
        clamped = np.clip(odds, -thresholds.clamp, thresholds.clamp).astype(np.int16)
        log_odds[start : start + _AT_ONCE] = clamped
        block, place = np.nonzero(clamped >= thresholds.occupied)
        hits = positions[block, 0, place]
        offsets.append((positions[block, 1:, place] // hits[:, None]).astype(np.uint16))
    return log_odds, np.concatenate(offsets)
