"""From a cloud to counts: one hit per voxel and sweep, one miss per voxel that a beam went through, a hit winning."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Cloud, MapError, Observation
from mapgraft_cloud.blocks import AXES, BlockPool, empty_bits
from mapgraft_cloud.floors import Floor, Floors, floor_at, floor_beneath, lowest_slab
from mapgraft_cloud.kernels import tracing
from mapgraft_cloud.kernels.block_keys import VOXEL_LIMIT
from mapgraft_cloud.kernels.placing import STEPS
from mapgraft_cloud.layer import FROM_CLOUDS, READY_MADE, CloudLayer
from mapgraft_cloud.parameters import Reach
from mapgraft_cloud.region import BitLayers, BlockKeys, VoxelRegion, Voxels, find, keys_of, places_of

_FIRST_BLOCKS = 1 << 12
_LARGEST_OFFSET = STEPS - 1


def add_sweep(
    layer: CloudLayer, observation: Observation, cloud: Cloud, reach: Reach, floor_m: float | None = None
) -> VoxelRegion:
    """Count one sweep, with what lies between it and where it was seen from.

    ``floor_m`` is the height of the floor where somebody knows it. Raises MapError when the layer holds a ready map, or
    points lie beyond ±2²⁰ voxels; the layer is then as before.
    """
    if layer.mapper == READY_MADE:
        raise MapError(f"the map of {observation.robot} is a ready-made one: it cannot be mapped from sweeps as well")
    seen = _in_map(layer, observation, cloud, reach)
    found = _found(seen, reach.short_voxels)
    layer.own.require_room(found[0], 1)
    region = _count(layer, *found)
    floor = _floor_below(layer, observation, seen.hits, floor_m)
    if floor is not None:
        layer.floors.add(floor)
    _sign(layer, observation, cloud.dropped + seen.near, FROM_CLOUDS)
    return region


def replace_content(
    layer: CloudLayer, observation: Observation, cloud: Cloud, reach: Reach, floor_m: float | None = None
) -> VoxelRegion:
    """Take a ready-made map in the place of the one before; what was baked in from donors stays.

    Raises MapError as ``add_sweep``.
    """
    if layer.mapper == FROM_CLOUDS:
        raise MapError(f"the map of {observation.robot} is made from sweeps: it cannot be a ready-made one as well")
    endless = Reach(0.0, np.inf, reach.free_m, reach.short_voxels)
    seen = _in_map(layer, observation, cloud, endless if cloud.origin_m is None else reach)
    found = _found(seen, reach.short_voxels)
    before = VoxelRegion.from_bits(layer.voxel_m, layer.own.keys, layer.own.held(layer.own.keys))
    layer.own, layer.floors = BlockPool(), Floors()
    region = _count(layer, *found)
    height = lowest_slab(found[2].voxels, layer.voxel_m) if floor_m is None else round(floor_m / layer.voxel_m)
    if height is not None:
        layer.floors.add(floor_at(observation.T_map_sensor, height, layer.voxel_m))
    layer.sensors, layer.dropped = frozenset(), 0
    _sign(layer, observation, cloud.dropped + seen.near, READY_MADE)
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


class _Seen(NamedTuple):
    """One sweep in the map frame, in voxels: points (n, 3) that count as hits, where they were seen from (None: nobody
    knows), where beams to farther points end (m, 3), and how many points lie too near."""

    hits: NDArray[np.float64]
    origin: NDArray[np.float64] | None
    far: NDArray[np.float64]
    near: int


def _in_map(layer: CloudLayer, observation: Observation, cloud: Cloud, reach: Reach) -> _Seen:
    points = observation.T_map_sensor.apply(cloud.points_m) / layer.voxel_m
    if not np.isfinite(points).all() or (np.abs(points) >= VOXEL_LIMIT).any():
        raise MapError(
            f"a point cloud map reaches ±2^20 voxels of {layer.voxel_m} m, found points beyond it in a cloud of "
            f"{observation.robot}: check poses and units, or give larger voxels (resolution_m)"
        )
    if cloud.origin_m is None:
        return _Seen(points, None, np.empty((0, 3)), 0)
    origin = observation.T_map_sensor.apply(np.array([cloud.origin_m])) / layer.voxel_m
    away = np.linalg.norm(points - origin, axis=1) * layer.voxel_m
    near, far = away < reach.near_m, away > reach.hit_m
    ends = origin + (points[far] - origin) * (min(reach.free_m, reach.hit_m) / away[far])[:, None]
    return _Seen(points[~(near | far)], origin[0], ends, int(np.count_nonzero(near)))


def _floor_below(
    layer: CloudLayer, observation: Observation, points: NDArray[np.float64], floor_m: float | None
) -> Floor | None:
    if floor_m is not None:
        return floor_at(observation.T_map_sensor, round(floor_m / layer.voxel_m), layer.voxel_m)
    return floor_beneath(points, observation.T_map_sensor, observation.T_map_base, layer.voxel_m)


def _found(seen: _Seen, short: int) -> tuple[BlockKeys, BitLayers, Hits]:
    """The blocks, ascending, the voxels in them that were seen through, and the ones that were hit."""
    hits = Hits.of(seen.hits)
    hit_keys = np.unique(keys_of(hits.voxels))
    if seen.origin is None:
        return hit_keys, empty_bits(hit_keys.size), hits
    free_keys, free = _seen_through(seen.origin, hits, seen.far, short)
    keys = np.union1d(hit_keys, free_keys)
    bits = empty_bits(keys.size)
    bits[np.searchsorted(keys, free_keys)] = free
    return keys, bits, hits


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


def _count(layer: CloudLayer, keys: BlockKeys, free: BitLayers, hits: Hits) -> VoxelRegion:
    hit = empty_bits(keys.size)
    blocks, places = find(keys, keys_of(hits.voxels)), places_of(hits.voxels)
    np.bitwise_or.at(hit, (blocks, places // 64), np.uint64(1) << (places % 64).astype(np.uint64))
    slots = layer.own.claim(keys)
    tracing.count(slots, free, hit, layer.own.counts)
    layer.own.claim_sums(slots[np.unique(blocks)])
    rows = layer.own.rows[slots[blocks]]
    for axis in range(AXES):  # every voxel once, so that nothing is written twice
        layer.own.sums[rows, axis, places] += hits.offsets[:, axis].astype(np.uint32)
    return VoxelRegion.from_bits(layer.voxel_m, keys, free | hit)


def _sign(layer: CloudLayer, observation: Observation, dropped: int, mapper: str) -> None:
    layer.mapper = mapper
    layer.observations += 1
    layer.dropped += dropped
    layer.sensors |= {observation.sensor}
