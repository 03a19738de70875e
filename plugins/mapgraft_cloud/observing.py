"""From a cloud to counts: one hit per voxel and sweep, one miss per voxel that a beam went through, a hit winning."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Cloud, MapError, Observation
from mapgraft_cloud.blocks import SUM_X, BlockPool, empty_bits
from mapgraft_cloud.kernels import tracing
from mapgraft_cloud.kernels.block_keys import VOXEL_LIMIT
from mapgraft_cloud.kernels.placing import STEPS
from mapgraft_cloud.layer import FROM_CLOUDS, READY_MADE, CloudLayer
from mapgraft_cloud.parameters import Reach
from mapgraft_cloud.region import BitLayers, BlockKeys, VoxelRegion, Voxels, find, keys_of, places_of

_FIRST_BLOCKS = 1 << 12
_LARGEST_OFFSET = STEPS - 1


def add_sweep(layer: CloudLayer, observation: Observation, cloud: Cloud, reach: Reach) -> VoxelRegion:
    """Count one sweep, with what lies between it and where it was seen from.

    Raises MapError when the layer holds a ready map, or points lie beyond ±2²⁰ voxels; the layer is then as before.
    """
    if layer.mapper == READY_MADE:
        raise MapError(f"the map of {observation.robot} is a ready-made one: it cannot be mapped from sweeps as well")
    points, origin, far = _in_map(layer, observation, cloud, reach)
    hits = Hits.of(points)
    layer.pool.reserve(1)
    free = None if origin is None else _seen_through(origin, hits, far, reach.short_voxels)
    region = _count(layer, hits, free)
    _sign(layer, observation, cloud, FROM_CLOUDS)
    return region


def replace_content(layer: CloudLayer, observation: Observation, cloud: Cloud, reach: Reach) -> VoxelRegion:
    """Take a ready-made map in the place of what was there; raises MapError as ``add_sweep``."""
    if layer.mapper == FROM_CLOUDS:
        raise MapError(f"the map of {observation.robot} is made from sweeps: it cannot be a ready-made one as well")
    endless = Reach(np.inf, reach.free_m, reach.short_voxels)
    points, origin, far = _in_map(layer, observation, cloud, endless if cloud.origin_m is None else reach)
    hits = Hits.of(points)
    before = layer.region()
    layer.pools = {layer.sensor_model: BlockPool()}
    layer.pool.reserve(1)
    free = None if origin is None else _seen_through(origin, hits, far, reach.short_voxels)
    region = _count(layer, hits, free)
    layer.sensors, layer.dropped = frozenset(), 0
    _sign(layer, observation, cloud, READY_MADE)
    return region.union(before)


class Hits:
    """The voxels in which points of one sweep lie: ``voxels`` (n, 3) and the mean ``offsets`` (n, 3) in 1/1024."""

    __slots__ = ("offsets", "voxels")

    def __init__(self, voxels: Voxels, offsets: NDArray[np.int64]) -> None:
        self.voxels, self.offsets = voxels, offsets

    @classmethod
    def of(cls, points: NDArray[np.float64]) -> Hits:
        """From points (n, 3) in voxels."""
        if not len(points):
            return cls(np.empty((0, 3), np.int64), np.empty((0, 3), np.int64))
        whole = np.floor(points).astype(np.int64)
        keys, places = keys_of(whole), places_of(whole)
        order = np.lexsort((places, keys))
        keys, places = keys[order], places[order]
        first = np.flatnonzero(np.concatenate(([True], (keys[1:] != keys[:-1]) | (places[1:] != places[:-1]))))
        counts = np.diff(np.append(first, len(points)))[:, None]
        offsets = np.minimum(((points - whole) * STEPS).astype(np.int64), _LARGEST_OFFSET)[order]
        return cls(whole[order][first], (np.add.reduceat(offsets, first) + counts // 2) // counts)


def _in_map(
    layer: CloudLayer, observation: Observation, cloud: Cloud, reach: Reach
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, NDArray[np.float64]]:
    """Points that count as hits, where they were seen from, and where beams to farther ones end; all in voxels."""
    points = observation.T_map_sensor.apply(cloud.points_m) / layer.voxel_m
    if not np.isfinite(points).all() or (np.abs(points) >= VOXEL_LIMIT).any():
        raise MapError(
            f"a point cloud map reaches ±2^20 voxels of {layer.voxel_m} m, found points beyond it in a cloud of "
            f"{observation.robot}: check poses and units, or give larger voxels (resolution_m)"
        )
    if cloud.origin_m is None:
        return points, None, np.empty((0, 3))
    origin = observation.T_map_sensor.apply(np.array([cloud.origin_m])) / layer.voxel_m
    away = np.linalg.norm(points - origin, axis=1) * layer.voxel_m
    far = away > reach.hit_m
    ends = origin + (points[far] - origin) * (min(reach.free_m, reach.hit_m) / away[far])[:, None]
    return points[~far], origin[0], ends


def _seen_through(
    origin: NDArray[np.float64], hits: Hits, far: NDArray[np.float64], short: int
) -> tuple[BlockKeys, BitLayers]:
    """The blocks, ascending, and in them the voxels between the origin and every voxel that was hit or lies far off."""
    ends = np.concatenate((hits.voxels + (hits.offsets + 0.5) / STEPS, _one_per_voxel(far)))
    table, keys = np.full(4 * _FIRST_BLOCKS, -1, np.int32), np.empty(_FIRST_BLOCKS, np.int64)
    bits, used = empty_bits(_FIRST_BLOCKS), np.zeros(1, np.int64)
    done = tracing.see_through(origin, ends, 0, short, table, keys, bits, used)
    while done < len(ends):
        table, keys = np.full(2 * table.size, -1, np.int32), np.concatenate((keys, np.empty_like(keys)))
        bits = np.concatenate((bits, np.zeros_like(bits)))
        tracing.rehash(table, keys, int(used[0]))
        done = tracing.see_through(origin, ends, done, short, table, keys, bits, used)
    order = np.argsort(keys[: used[0]], kind="stable")
    return keys[order], bits[order]


def _one_per_voxel(ends: NDArray[np.float64]) -> NDArray[np.float64]:
    hits = Hits.of(ends)
    return hits.voxels + (hits.offsets + 0.5) / STEPS


def _count(layer: CloudLayer, hits: Hits, free: tuple[BlockKeys, BitLayers] | None) -> VoxelRegion:
    hit_keys = np.unique(keys_of(hits.voxels))
    keys = hit_keys if free is None else np.union1d(hit_keys, free[0])
    free_bits, hit_bits = empty_bits(keys.size), empty_bits(keys.size)
    if free is not None:
        free_bits[np.searchsorted(keys, free[0])] = free[1]
    blocks, places = find(keys, keys_of(hits.voxels)), places_of(hits.voxels)
    np.bitwise_or.at(hit_bits, (blocks, places // 64), np.uint64(1) << (places % 64).astype(np.uint64))
    slots = layer.pool.claim(keys)
    tracing.count(slots, free_bits, hit_bits, layer.pool.counts)
    for axis in range(3):  # every voxel once, so that nothing is written twice
        layer.pool.counts[slots[blocks], SUM_X + axis, places] += hits.offsets[:, axis].astype(np.uint32)
    return VoxelRegion.from_bits(layer.voxel_m, keys, free_bits | hit_bits)


def _sign(layer: CloudLayer, observation: Observation, cloud: Cloud, mapper: str) -> None:
    layer.mapper = mapper
    layer.observations += 1
    layer.dropped += cloud.dropped
    layer.sensors |= {observation.sensor}
