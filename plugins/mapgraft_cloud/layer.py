"""The evidence of one source in voxels."""

from __future__ import annotations

import numpy as np

from mapgraft.contracts import Layer, MapError
from mapgraft_cloud.blocks import BlockPool, empty_bits
from mapgraft_cloud.floors import Floors
from mapgraft_cloud.parameters import NAME, SensorModel
from mapgraft_cloud.region import BlockKeys, VoxelRegion

FROM_CLOUDS = "clouds"
READY_MADE = "ready map"


class CloudLayer:
    """Hits, misses and positions of one source in its own frame, with its sensor model; voxel (i, j, k) begins at
    ``voxel_m`` · (i, j, k).

    Only ``PointCloud`` writes it. ``own`` was observed under the layer's own sensor model; ``absorbed`` holds what was
    baked in from donors, by the sensor model under which it was counted. ``floors`` tells where the robot was above
    what floor. ``observations`` counts what was integrated, ``dropped`` the points that were left out, ``sensors``
    names what saw it, ``mapper`` is ``clouds``, ``ready map`` or empty before the first observation.
    """

    __slots__ = (
        "__weakref__",
        "absorbed",
        "dropped",
        "floors",
        "mapper",
        "observations",
        "own",
        "sensor_model",
        "sensors",
        "voxel_m",
    )

    def __init__(self, voxel_m: float, sensor_model: SensorModel) -> None:
        self.voxel_m = voxel_m
        self.sensor_model = sensor_model
        self.own = BlockPool()
        self.absorbed: dict[SensorModel, BlockPool] = {}
        self.floors = Floors()
        self.observations = 0
        self.dropped = 0
        self.sensors: frozenset[str] = frozenset()
        self.mapper = ""

    @property
    def map_type(self) -> str:
        return NAME

    def pools(self) -> list[tuple[SensorModel, BlockPool]]:
        """All that was counted, the own first."""
        return [(self.sensor_model, self.own), *sorted(self.absorbed.items(), key=lambda pair: pair[0])]

    @property
    def nbytes(self) -> int:
        """The memory of its evidence."""
        return sum(pool.nbytes for _, pool in self.pools())

    def most_looks(self) -> int:
        """The most hits or misses of any voxel."""
        return max(pool.most for _, pool in self.pools())

    def keys(self) -> BlockKeys:
        """The blocks of all pools, ascending."""
        found = [pool.keys for _, pool in self.pools()]
        return found[0] if len(found) == 1 else np.unique(np.concatenate(found))

    def region(self) -> VoxelRegion:
        """The voxels that hold evidence."""
        keys = self.keys()
        bits = empty_bits(keys.size)
        for _, pool in self.pools():
            bits |= pool.held(keys)
        return VoxelRegion.from_bits(self.voxel_m, keys, bits)


def as_layer(layer: Layer) -> CloudLayer:
    """The layer as one of this type; raises MapError when it is of another."""
    if not isinstance(layer, CloudLayer):
        raise MapError(f"a point cloud map cannot use a layer of type {layer.map_type}: convert it first")
    return layer
