"""The evidence of one source in voxels."""

from __future__ import annotations

import numpy as np

from mapgraft.contracts import Layer, MapError
from mapgraft_cloud.blocks import BlockPool
from mapgraft_cloud.parameters import NAME, SensorModel
from mapgraft_cloud.region import BlockKeys, VoxelRegion

FROM_CLOUDS = "clouds"
READY_MADE = "ready map"


class CloudLayer:
    """Hits, misses and positions of one source in its own frame, with its sensor model; voxel (i, j, k) begins at
    ``voxel_m`` · (i, j, k).

    Only ``PointCloud`` writes it. ``pools`` holds what was counted under each sensor model: the own one, and those of
    donors that were baked in. ``observations`` counts what was integrated, ``dropped`` the points that were left out,
    ``sensors`` names what saw it, ``mapper`` is ``clouds``, ``ready map`` or empty before the first observation.
    """

    __slots__ = ("__weakref__", "dropped", "mapper", "observations", "pools", "sensor_model", "sensors", "voxel_m")

    def __init__(self, voxel_m: float, sensor_model: SensorModel) -> None:
        self.voxel_m = voxel_m
        self.sensor_model = sensor_model
        self.pools: dict[SensorModel, BlockPool] = {sensor_model: BlockPool()}
        self.observations = 0
        self.dropped = 0
        self.sensors: frozenset[str] = frozenset()
        self.mapper = ""

    @property
    def map_type(self) -> str:
        return NAME

    @property
    def pool(self) -> BlockPool:
        """What was counted under the layer's own sensor model."""
        return self.pools[self.sensor_model]

    @property
    def nbytes(self) -> int:
        """The memory of its evidence."""
        return sum(pool.nbytes for pool in self.pools.values())

    def keys(self) -> BlockKeys:
        """The blocks of all pools, ascending."""
        found = [pool.keys for pool in self.pools.values()]
        return found[0] if len(found) == 1 else np.unique(np.concatenate(found))

    def region(self) -> VoxelRegion:
        """The voxels that hold evidence."""
        keys = self.keys()
        held = np.zeros((keys.size, 512), np.bool_)
        for pool in self.pools.values():
            held |= pool.held(keys)
        return VoxelRegion.from_mask(self.voxel_m, keys, held)


def as_layer(layer: Layer) -> CloudLayer:
    """The layer as one of this type; raises MapError when it is of another."""
    if not isinstance(layer, CloudLayer):
        raise MapError(f"a point cloud map cannot use a layer of type {layer.map_type}: convert it first")
    return layer
