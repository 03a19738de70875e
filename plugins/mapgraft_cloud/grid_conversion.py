"""Between point clouds and occupancy grids: a height band seen from above, and walls as one slice of voxels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, EmptyMapError, Layer, MapError, MapType, Transform
from mapgraft_cloud.blocks import AT_ONCE, AXES, HITS, BlockPool, Blocks
from mapgraft_cloud.cloud_map import GROUND_BITS
from mapgraft_cloud.kernels import columns
from mapgraft_cloud.kernels.block_keys import BLOCK, VOLUME
from mapgraft_cloud.kernels.placing import STEPS
from mapgraft_cloud.layer import FROM_CLOUDS, CloudLayer, as_layer
from mapgraft_cloud.map_type import PointCloud
from mapgraft_cloud.parameters import MOST_LOOKS, SensorModel, Thresholds
from mapgraft_cloud.region import BlockKeys, corners_of, find, keys_of, places_of
from mapgraft_grid import placing
from mapgraft_grid.cells import CellCounts, Cells, GridLayer, Lattice, cells_at, cells_of, centres_m, layer_of_cells
from mapgraft_grid.cells import SensorModel as GridModel
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.structure import known_at


class GridConversion:
    """A point cloud's height band as an occupancy grid.

    Of each column of voxels between ``low_m`` and ``high_m`` above the floor the grid gets the counts of the occupied
    voxel with most evidence; where none is and none may be, of the free one that was most often seen through. What is
    occupied or free the source's thresholds say. The floor is that where the robot was nearest to the column (see
    ``Floors``): what is found elsewhere changes nothing here. A ready-made cloud has one floor: the lowest slab of 0.2
    m in which a tenth of all columns with hits have one. Where nobody knows any it is the map's own height 0.
    Cells of another size than the voxels take counts as placing a grid does. Only what a sensor saw through
    is free: a ready-made cloud gives occupied cells alone.
    """

    def __init__(self, *, low_m: float = 0.3, high_m: float = 1.8) -> None:
        if not (math.isfinite(low_m) and math.isfinite(high_m) and low_m < high_m):
            raise ConfigError(f"a height band must go from a lower to a higher value, found {low_m} to {high_m} m")
        self._low_m, self._high_m = low_m, high_m

    def convert(self, layer: Layer, source: MapType, target: MapType) -> GridLayer:
        """A grid layer with the target's resolution; raises MapError when one of the three is of another type."""
        own, kind, grid = as_layer(layer), _cloud(source), _grid(target)
        cells, counts = self._columns(own, kind.thresholds)
        lattice = Lattice(own.voxel_m)
        model = GridModel(own.sensor_model.l_hit, own.sensor_model.l_miss)
        fine = layer_of_cells(
            grid,
            cells,
            counts,
            lattice=lattice,
            sensor_model=model,
            observations=own.observations,
            sensors=own.sensors,
        )
        try:
            return grid.place(fine, Transform.identity())
        except EmptyMapError:
            return layer_of_cells(grid, cells[:0], counts[:0], observations=own.observations, sensors=own.sensors)

    def _columns(self, own: CloudLayer, read: Thresholds) -> tuple[Cells, CellCounts]:
        """The columns of which the band says something, and their hits and misses (n, 2)."""
        keys = own.keys()
        low, high = (math.floor(height / own.voxel_m + 0.5) for height in (self._low_m, self._high_m))
        grounds, ground = np.unique(keys & GROUND_BITS, return_inverse=True)
        ground, bottoms = ground.ravel(), corners_of(keys)[:, 2]
        lowest = _floors_below(own, grounds) + low
        meets = (bottoms + BLOCK > lowest[ground]) & (bottoms < lowest[ground] + high - low)
        keys, ground, bottoms = keys[meets], ground[meets], bottoms[meets]
        out = np.zeros((grounds.size, 3, BLOCK * BLOCK), np.int64)
        model = np.array([own.sensor_model.l_hit, own.sensor_model.l_miss, read.occupied, read.free], np.int64)
        for first in range(0, keys.size, AT_ONCE):
            part = slice(first, first + AT_ONCE)
            counts = counted(own, keys[part])
            columns.gather(ground[part], bottoms[part], counts, lowest, high - low, model, out)
        says = out[:, columns.RANK]
        block, place = np.nonzero((says == columns.STANDS) | (says == columns.FREE))
        cells = corners_of(grounds[block])[:, :2] + np.stack((place % BLOCK, place // BLOCK), axis=1)
        return cells, out[block, : columns.RANK, place]


def counted(layer: CloudLayer, keys: BlockKeys) -> NDArray[np.int64]:
    """Hits and misses (k, 2, 512) of blocks; those of donors that were baked in as often as the layer's own sensor
    model says the same, rounded."""
    own = np.array([layer.sensor_model.l_hit, layer.sensor_model.l_miss], np.int64)
    out = np.zeros((keys.size, 2, VOLUME), np.int64)
    for model, pool in layer.pools():
        places = find(pool.keys, keys)
        counts = pool.counts[pool.slots[places[places >= 0]]].astype(np.int64)
        said = np.array([model.l_hit, model.l_miss], np.int64)
        if (said != own).any():
            counts = (2 * counts * said[:, None] + own[:, None]) // (2 * own[:, None])
        out[places >= 0] += counts
    return out


def _floors_below(own: CloudLayer, grounds: BlockKeys) -> NDArray[np.int64]:
    """The first voxel (g,) above the floor of columns of blocks."""
    if own.floors.sweeps and grounds.size:
        return own.floors.below(corners_of(grounds)[:, :2] // BLOCK)
    return np.zeros(grounds.size, np.int64)


class SliceConversion:
    """An occupancy grid as one slice of voxels, ``height_m`` above the grid's own height 0.

    A planar sensor says nothing about what is above and below it, and its grid does not tell how high it sat: so its
    walls and its free space enter at one height, hits as hits and misses as misses, of the cells that are occupied or
    free by the source's thresholds. Cells that are smaller than the voxels are taken together as placing a grid does.
    """

    def __init__(self, *, height_m: float = 0.5) -> None:
        if not math.isfinite(height_m):
            raise ConfigError(f"the height of a slice must be finite, found {height_m}")
        self._height_m = height_m

    def convert(self, layer: Layer, source: MapType, target: MapType) -> CloudLayer:
        """A cloud layer with the target's voxels; raises MapError when one of the three is of another type."""
        if not isinstance(layer, GridLayer):
            raise MapError(f"an occupancy grid is converted here, found a layer of type {layer.map_type}")
        if not isinstance(target, PointCloud):
            raise MapError(f"a slice of voxels is made for a point cloud, found {target.name}: name another `via`")
        model = SensorModel(layer.sensor_model.l_hit, layer.sensor_model.l_miss)
        out = CloudLayer(target.resolution_m, model)
        out.observations, out.sensors, out.mapper = layer.observations, layer.sensors, FROM_CLOUDS
        kind, lattice = _grid(source), Lattice(target.resolution_m)
        try:
            told = _made_out(kind, layer)
            cells, counts = cells_of(placing.place(told, Transform.identity(), 1.0, lattice, kind.thresholds))
        except EmptyMapError:
            return out
        z = math.floor(self._height_m / target.resolution_m)
        _fill(out.own, np.column_stack((cells, np.full(len(cells), z, np.int64))), counts)
        path = layer.path()[:, :2]
        for x, y in ((cells_at(path, lattice) if len(path) else cells[:1]) // BLOCK).tolist():
            out.floors.add((x, y, 0))
        return out


def _made_out(kind: OccupancyGrid, layer: GridLayer) -> GridLayer:
    """The layer without the cells that are neither occupied nor free to its robot."""
    cells, counts = cells_of(layer)
    known = known_at(kind.view(layer), centres_m(cells, layer.lattice)) if len(cells) else np.zeros(0, np.bool_)
    kept = cells[known], counts[known]
    return layer_of_cells(kind, *kept, lattice=layer.lattice, sensor_model=layer.sensor_model)


def _fill(pool: BlockPool, voxels: NDArray[np.int64], counts: CellCounts) -> None:
    """Give an empty pool the counts (n, 2) of voxels (n, 3) that differ, their points in the middle."""
    keys = np.unique(keys_of(voxels))
    blocks, places = find(keys, keys_of(voxels)), places_of(voxels)
    table = np.zeros((keys.size, 2, VOLUME), np.uint32)
    table[blocks, :, places] = np.minimum(counts, MOST_LOOKS)
    solid = np.flatnonzero(table[:, HITS].any(axis=1))
    middle = table[solid, HITS] * np.uint32(STEPS // 2)
    pool.add(Blocks(keys, table, solid, np.repeat(middle[:, None], AXES, axis=1)))


def _cloud(source: MapType) -> PointCloud:
    if not isinstance(source, PointCloud):
        raise MapError(f"a point cloud is read as its own map type says, found {source.name}: give that type")
    return source


def _grid(kind: MapType) -> OccupancyGrid:
    if not isinstance(kind, OccupancyGrid):
        raise MapError(f"point clouds convert to occupancy_grid, found {kind.name}: name another `via`")
    return kind
