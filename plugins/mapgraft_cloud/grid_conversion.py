"""Between point clouds and occupancy grids: a height band seen from above, and walls as one slice of voxels."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, EmptyMapError, Layer, MapError, MapType, Transform
from mapgraft_cloud.blocks import HITS, MISSES, SUM_X, BlockPool
from mapgraft_cloud.cloud_map import GROUND_BITS
from mapgraft_cloud.kernels import columns
from mapgraft_cloud.kernels.block_keys import BLOCK, VOLUME
from mapgraft_cloud.kernels.placing import STEPS
from mapgraft_cloud.layer import FROM_CLOUDS, CloudLayer, as_layer
from mapgraft_cloud.map_type import PointCloud
from mapgraft_cloud.parameters import SensorModel
from mapgraft_cloud.region import corners_of, find, keys_of, places_of
from mapgraft_grid.kernels.tile_keys import KEY_BIAS, KEY_BITS, TILE
from mapgraft_grid.layer import FROM_SCANS, GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.parameters import Lattice, TraceLimits
from mapgraft_grid.parameters import SensorModel as GridModel

_FLOOR_SHARE: Final = 0.1  # of the columns with a hit: the lowest slab that has so many is the floor
_SLAB_M: Final = 0.2

Cells = NDArray[np.int64]  # (n, 2) ix, iy


class GridConversion:
    """A point cloud's height band as an occupancy grid.

    Of each column of voxels between ``low_m`` and ``high_m`` above the floor the grid gets the counts of the voxel that
    is most surely occupied, and where none is, of the one that was most often seen through. The floor is the lowest
    slab of 0.2 m that a tenth of all columns with hits have a hit in, else the map's own height 0. Cells of another
    size than the voxels take counts as placing a grid does. Only what a sensor saw through is free: a ready-made cloud
    gives occupied cells alone.
    """

    def __init__(self, *, low_m: float = 0.3, high_m: float = 1.8) -> None:
        if not (math.isfinite(low_m) and math.isfinite(high_m) and low_m < high_m):
            raise ConfigError(f"a height band must go from a lower to a higher value, found {low_m} to {high_m} m")
        self._low_m, self._high_m = low_m, high_m

    def convert(self, layer: Layer, source: MapType, target: MapType) -> GridLayer:
        """A grid layer with the target's resolution; raises MapError when the target is no occupancy grid."""
        own, grid = as_layer(layer), _grid(target)
        fine = GridLayer(
            Lattice(own.voxel_m), GridModel(own.sensor_model.l_hit, own.sensor_model.l_miss), TraceLimits()
        )
        cells, counts = self._columns(own)
        _set_counts(fine, cells, counts)
        fine.observations, fine.sensors, fine.mapper = own.observations, own.sensors, FROM_SCANS
        try:
            return grid.place(fine, Transform.identity())
        except EmptyMapError:
            empty = grid.new_layer()
            empty.observations, empty.sensors, empty.mapper = own.observations, own.sensors, FROM_SCANS
            return empty

    def _columns(self, own: CloudLayer) -> tuple[Cells, NDArray[np.int64]]:
        """The columns with evidence in the band, and their hits and misses (n, 2)."""
        keys = own.keys()
        hits, misses = np.zeros((keys.size, VOLUME), np.int64), np.zeros((keys.size, VOLUME), np.int64)
        for pool in own.pools.values():
            places = find(keys, pool.keys)
            hits[places] += pool.counts[pool.slots, HITS]
            misses[places] += pool.counts[pool.slots, MISSES]
        bottoms = corners_of(keys)[:, 2]
        floor_m = floor_of(own.voxel_m, bottoms, hits, keys)
        band = [math.floor((floor_m + height) / own.voxel_m + 0.5) for height in (self._low_m, self._high_m)]
        grounds, ground = np.unique(keys & GROUND_BITS, return_inverse=True)
        out = np.zeros((grounds.size, 2, BLOCK * BLOCK), np.int64)
        model = np.array([own.sensor_model.l_hit, own.sensor_model.l_miss], np.int64)
        columns.gather(ground.ravel(), bottoms, hits, misses, np.array(band, np.int64), model, out)
        block, place = np.nonzero(out.any(axis=1))
        corners = corners_of(grounds[block])[:, :2]
        cells = corners + np.stack((place % BLOCK, place // BLOCK), axis=1)
        return cells, out[block, :, place]


def floor_of(voxel_m: float, bottoms: NDArray[np.int64], hits: NDArray[np.int64], keys: NDArray[np.int64]) -> float:
    """The height of the floor's upper side in metres, from the hits (k, 512) of blocks; 0 where there is no floor."""
    block, place = np.nonzero(hits)
    if not block.size:
        return 0.0
    z = bottoms[block] + place // (BLOCK * BLOCK)
    column = (keys[block] & GROUND_BITS) * (BLOCK * BLOCK) + place % (BLOCK * BLOCK)
    all_columns = np.unique(column).size
    thick = max(1, round(_SLAB_M / voxel_m))
    for low in range(int(z.min()), int(z.max()) + 1):
        inside = (z >= low) & (z < low + thick)
        if np.unique(column[inside]).size >= _FLOOR_SHARE * all_columns:
            levels = np.bincount(z[inside] - low)
            return float((low + int(np.argmax(levels)) + 1) * voxel_m)
    return 0.0


class SliceConversion:
    """An occupancy grid as one slice of voxels, ``height_m`` above the grid's own height 0.

    A planar sensor says nothing about what is above and below it, and its grid does not tell how high it sat: so its
    walls and its free space enter at one height, hits as hits and misses as misses. Cells that are smaller than the
    voxels are taken together as placing a grid does.
    """

    def __init__(self, *, height_m: float = 0.5) -> None:
        if not math.isfinite(height_m):
            raise ConfigError(f"the height of a slice must be finite, found {height_m}")
        self._height_m = height_m

    def convert(self, layer: Layer, source: MapType, target: MapType) -> CloudLayer:
        """A cloud layer with the target's voxels; raises MapError where one of the two is of another type."""
        if not isinstance(layer, GridLayer):
            raise MapError(f"an occupancy grid is converted here, found a layer of type {layer.map_type}")
        if not isinstance(target, PointCloud):
            raise MapError(f"a slice of voxels is made for a point cloud, found {target.name}: name another `via`")
        model = SensorModel(layer.sensor_model.l_hit, layer.sensor_model.l_miss)
        out = CloudLayer(target.resolution_m, model)
        out.observations, out.sensors, out.mapper = layer.observations, layer.sensors, FROM_CLOUDS
        try:
            placed = OccupancyGrid(resolution_m=target.resolution_m).place(layer, Transform.identity())
        except EmptyMapError:
            return out
        cells, counts = _counts_of(placed)
        z = np.full((len(cells), 1), math.floor(self._height_m / target.resolution_m), np.int64)
        out.pools = {model: _pool(np.hstack((cells, z)), counts)}
        return out


def _grid(target: MapType) -> OccupancyGrid:
    if not isinstance(target, OccupancyGrid):
        raise MapError(f"point clouds convert to occupancy_grid, found {target.name}: name another `via`")
    return target


def _set_counts(grid: GridLayer, cells: Cells, counts: NDArray[np.int64]) -> None:
    """Give a new grid layer the hits and misses (n, 2) of cells that differ."""
    if not len(cells):
        return
    tiles, slots = np.unique(cells[:, ::-1] // TILE, axis=0, return_inverse=True)  # by row, then by column
    keys = ((tiles[:, 0] + KEY_BIAS) << KEY_BITS) | (tiles[:, 1] + KEY_BIAS)
    table = np.zeros((2, len(tiles), TILE, TILE), np.uint32)
    for channel in range(2):
        table[channel, slots.ravel(), cells[:, 1] % TILE, cells[:, 0] % TILE] = counts[:, channel]
    grid.pool.set_counts(keys, table[0], table[1])


def _counts_of(grid: GridLayer) -> tuple[Cells, NDArray[np.int64]]:
    """The cells of a grid layer with evidence, and their hits and misses (n, 2)."""
    keys = np.sort(grid.pool.index.keys)
    hits, misses = grid.pool.counts(keys)
    tile, row, column = np.nonzero(hits.astype(np.bool_) | misses.astype(np.bool_))
    x = ((keys[tile] & ((1 << KEY_BITS) - 1)) - KEY_BIAS) * TILE + column
    y = ((keys[tile] >> KEY_BITS) - KEY_BIAS) * TILE + row
    counts = np.stack((hits[tile, row, column], misses[tile, row, column]), axis=1).astype(np.int64)
    return np.stack((x, y), axis=1), counts


def _pool(voxels: NDArray[np.int64], counts: NDArray[np.int64]) -> BlockPool:
    """Counts of voxels, their points in the middle."""
    keys = np.unique(keys_of(voxels))
    table = np.zeros((keys.size, 5, VOLUME), np.int64)
    blocks, places = find(keys, keys_of(voxels)), places_of(voxels)
    table[blocks, HITS, places], table[blocks, MISSES, places] = counts[:, 0], counts[:, 1]
    for axis in range(3):
        table[blocks, SUM_X + axis, places] = counts[:, 0] * (STEPS // 2)
    return BlockPool.of(keys, table)


def _cells_in(key: int, rows: NDArray[np.uint64]) -> Cells:
    bits = np.unpackbits(rows[:, None].view(np.uint8), axis=1, bitorder="little")
    y, x = np.nonzero(bits)
    corner = ((key & ((1 << KEY_BITS) - 1)) - KEY_BIAS, (key >> KEY_BITS) - KEY_BIAS)
    return np.stack((x + corner[0] * TILE, y + corner[1] * TILE), axis=1)
