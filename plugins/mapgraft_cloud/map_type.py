"""The map type ``point_cloud``: everything the engine asks of it, in one place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from mapgraft.contracts import (
    CLOUD,
    CLOUD_MAP,
    Cloud,
    ConfigError,
    Contribution,
    EmptyMapError,
    Layer,
    Map,
    MapError,
    MapMetadata,
    Observation,
    OutputMessage,
    Points,
    Region,
    Reset,
    Transform,
)
from mapgraft_cloud import baking, codec, cutting, observing, output, placing, views
from mapgraft_cloud.above import seen_from_above
from mapgraft_cloud.cloud_map import CloudMap, as_map
from mapgraft_cloud.layer import CloudLayer, as_layer
from mapgraft_cloud.parameters import (
    COARSEST_M,
    FINEST_M,
    LOG_ODDS_PER_NAT,
    NAME,
    Reach,
    SensorModel,
    Thresholds,
)
from mapgraft_cloud.region import VoxelRegion, as_region

_MOST_NATS: Final = 10.0  # of one look
_MOST_CLAMP: Final = 31.0  # nats: what fits int16
_LONGEST_M: Final = 10_000.0


class PointCloud:
    """Point-cloud maps that count hits and misses per voxel, one update per voxel and sweep, a hit winning over a miss.

    ``resolution_m`` is the side of a voxel. ``l_hit`` and ``l_miss`` (nats) are the evidence of one hit and one miss
    (OctoMap's values), ``clamp`` (nats) bounds what a reader sees; nothing is clamped when writing. A voxel is occupied
    above the probability ``occupied`` and free below ``free``: one look suffices for either. A point
    between ``min_range_m`` and ``max_range_m`` away hits; what lies between it and the sensor was seen through, up to
    ``short_voxels`` voxels before it; before a point farther off the first ``free_range_m`` are free; a nearer one is
    the robot itself or no return, and left out. A cloud whose origin nobody knows gives hits only. ``floor_m`` is the
    height of the floor in the robot's map frame, from which height bands are measured; None: as high as the robot's
    base, where it was. ``export`` is the form of the map's file: ``pcd`` or ``ply`` (binary), ``pcd_ascii`` or
    ``ply_ascii``.

    Raises ConfigError on an impossible value. Source: A. Hornung et al., OctoMap (Autonomous Robots 34, 2013).
    """

    def __init__(
        self,
        *,
        resolution_m: float = 0.1,
        l_hit: float = 0.85,
        l_miss: float = -0.41,
        clamp: float = 5.0,
        occupied: float = 0.65,
        free: float = 0.4,
        max_range_m: float = 60.0,
        free_range_m: float = 20.0,
        min_range_m: float = 0.3,
        short_voxels: int = 1,
        floor_m: float | None = None,
        export: str = "pcd",
    ) -> None:
        self._voxel_m = _within("resolution_m", resolution_m, FINEST_M, COARSEST_M)
        self._model = SensorModel(
            round(_within("l_hit", l_hit, 1 / LOG_ODDS_PER_NAT, _MOST_NATS) * LOG_ODDS_PER_NAT),
            round(_within("l_miss", l_miss, -_MOST_NATS, -1 / LOG_ODDS_PER_NAT) * LOG_ODDS_PER_NAT),
        )
        self.thresholds = _thresholds(occupied, free, clamp)
        far_m = _within("max_range_m", max_range_m, resolution_m, _LONGEST_M)
        self._reach = Reach(
            _within("min_range_m", min_range_m, 0.0, far_m),
            far_m,
            _within("free_range_m", free_range_m, 0.0, _LONGEST_M),
            int(_within("short_voxels", short_voxels, 0, 100)),
        )
        self._floor_m = None if floor_m is None else _within("floor_m", floor_m, -_LONGEST_M, _LONGEST_M)
        if export not in output.FORMS:
            raise ConfigError(f"export of a point cloud map is one of {', '.join(output.FORMS)}, found {export!r}")
        self._export = export

    @property
    def name(self) -> str:
        return NAME

    @property
    def resolution_m(self) -> float:
        """The side of the voxels in which other layers are placed."""
        return self._voxel_m

    def new_layer(self) -> CloudLayer:
        return CloudLayer(self._voxel_m, self._model)

    def integrate(self, layer: Layer, observation: Observation) -> VoxelRegion:
        """Count a sweep, or take a ready-made map in the place of what was there; never both in one layer.

        Raises MapError on anything else, and on points beyond ±2²⁰ voxels; the layer is then as before.
        """
        own, payload = as_layer(layer), observation.payload
        if isinstance(payload, Cloud):
            take = observing.replace_content if observation.kind == CLOUD_MAP else observing.add_sweep
            return take(own, observation, payload, self._reach, self._floor_m)
        raise MapError(
            f"a point cloud map is made from a {CLOUD} or a {CLOUD_MAP}, found a {observation.kind} of "
            f"{observation.robot}: choose another map type for this robot"
        )

    def view(
        self,
        own: Layer | None,
        contributions: Sequence[Contribution] = (),
        previous: Map | None = None,
        touched: Region | None = None,
    ) -> CloudMap:
        """Own evidence plus, for each contribution, the donor's times its weight; then clamped.

        Raises MapError when a contribution has voxels of another size.
        """
        layer = self.new_layer() if own is None else as_layer(own)
        parts = views.parts_of(layer, contributions)
        if (
            isinstance(previous, CloudMap)
            and isinstance(touched, VoxelRegion)
            and previous.voxel_m == layer.voxel_m
            and (touched.voxel_m == layer.voxel_m or not touched.keys.size)
            and previous.thresholds == self.thresholds
        ):
            return views.updated(previous, parts, touched.keys)
        return views.fresh(layer.voxel_m, parts, self.thresholds)

    def place(self, layer: Layer, T_receiver_donor: Transform, scale: float = 1.0) -> CloudLayer:
        """The layer's counts in this instance's voxels, in integers throughout; EmptyMapError when there are none."""
        return placing.place(as_layer(layer), T_receiver_donor, scale, self._voxel_m)

    def absorb(self, layer: Layer, contribution: Contribution) -> VoxelRegion:
        return baking.absorb(as_layer(layer), contribution)

    def reset(self, layer: Layer, foreign: Region, keep: Region) -> Reset:
        return baking.reset(as_layer(layer), as_region(foreign), as_region(keep))

    def region(self, layer: Layer) -> VoxelRegion:
        return as_layer(layer).region()

    def known_region(self, map_: Map) -> VoxelRegion:
        return as_map(map_).known_region()

    def encode(self, layer: Layer) -> bytes:
        return codec.encode(as_layer(layer))

    def decode(self, data: bytes) -> CloudLayer:
        return codec.decode(data)

    def parts(self, layer: Layer) -> Mapping[bytes, bytes]:
        """By cube of 2 × 2 × 2 blocks; and once what there is to say of all."""
        return cutting.cut(as_layer(layer))

    def join(self, parts: Mapping[bytes, bytes]) -> CloudLayer:
        return cutting.join(parts)

    def preview(self, layer: Layer) -> CloudLayer:
        """What this instance sees in the layer: one look at every voxel that is made out, with its mean point."""
        return cutting.preview(as_layer(layer), self.view(layer))

    def metadata(self, layer: Layer) -> MapMetadata:
        """``extra`` tells ``voxels_occupied``, ``free_space`` (whether anything is known to be free) and the heights
        ``z_min_m`` and ``z_max_m`` of what is occupied."""
        own = as_layer(layer)
        seen = self.view(own)
        points = seen.points_m
        extra: dict[str, float | str | bool] = {"free_space": seen.has_free_space, "voxels_occupied": len(points)}
        bounds_m = None
        if len(points):
            low, high = points.min(axis=0), points.max(axis=0)
            bounds_m = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
            extra |= {"z_max_m": float(high[2]), "z_min_m": float(low[2])}
        return MapMetadata(
            type=NAME,
            resolution_m=own.voxel_m,
            bounds_m=bounds_m,
            known_area_m2=seen.ground_area_m2(),
            observations=own.observations,
            sensor=", ".join(sorted(own.sensors)),
            mapper=own.mapper,
            can_send=("counts",),
            extra=extra,
        )

    def structure(self, map_: Map, within: Map | None = None) -> Points:
        """The mean points (n, 3) of occupied voxels; ``within`` may have voxels of another size."""
        points = as_map(map_).points_m
        return points if within is None else points[as_map(within).makes_out(points)]

    def messages(self, map_: Map) -> Iterable[OutputMessage]:
        """The occupied voxels as ``sensor_msgs/msg/PointCloud2`` and the map from above; none for a map without any."""
        seen = as_map(map_)
        return (output.point_cloud(seen), seen_from_above(seen)) if len(seen.points_m) else ()

    def files(self, map_: Map, stem: str) -> Mapping[str, bytes]:
        """``stem.pcd`` or ``stem.ply`` of the occupied voxels; raises EmptyMapError when nothing is occupied."""
        seen = as_map(map_)
        if not len(seen.points_m):
            raise EmptyMapError("a point cloud map without an occupied voxel cannot be written: integrate clouds first")
        return output.files(seen, stem, self._export)


def _thresholds(occupied: float, free: float, clamp: float) -> Thresholds:
    high, low = _within("occupied", occupied, 0.5, 0.999), _within("free", free, 0.001, 0.5)
    read = Thresholds(
        math.floor(math.log(high / (1.0 - high)) * LOG_ODDS_PER_NAT) + 1,
        math.ceil(math.log(low / (1.0 - low)) * LOG_ODDS_PER_NAT) - 1,
        round(_within("clamp", clamp, 0.0, _MOST_CLAMP) * LOG_ODDS_PER_NAT),
    )
    if read.clamp < max(read.occupied, -read.free):
        raise ConfigError(
            f"clamp must reach the thresholds, or no voxel can be occupied or free: found {clamp} nats for occupied "
            f"{occupied} and free {free}, give at least {max(read.occupied, -read.free) / LOG_ODDS_PER_NAT:.2f}"
        )
    return read


def _within(name: str, value: float, least: float, most: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
        raise ConfigError(f"{name} of a point cloud map must lie between {least:.6g} and {most:.6g}, found {value!r}")
    return value
