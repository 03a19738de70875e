"""The fuser ``voxels``: the donor's hits and misses beside the receiver's own."""

from __future__ import annotations

from mapgraft.contracts import ConfigError, Contribution, Donation, Map, MapError, MapType, Match
from mapgraft_cloud.cloud_map import as_map
from mapgraft_cloud.map_type import PointCloud
from mapgraft_cloud.placing import RESAMPLER


class Voxels:
    """Adds the donor's evidence to the receiver's ``weight`` times (0 … 3): the binary Bayes filter, voxel by voxel.

    Its summary tells ``voxels_changed``, and how many of the donor's occupied voxels the receiver did not know
    (``voxels_filled``).
    """

    def __init__(self, *, weight: int = 1) -> None:
        if isinstance(weight, bool) or not isinstance(weight, int) or not 0 <= weight <= 3:
            raise ConfigError(f"voxels weighs the donor by a whole number 0 … 3, found weight={weight!r}")
        self._weight = weight

    def fuse(self, map_type: MapType, target: Map, source: Donation, match: Match) -> Contribution:
        """The contribution; EmptyMapError when the donor's layer is empty, MapError when one of them is no cloud."""
        if not isinstance(map_type, PointCloud) or source.layer.map_type != map_type.name:
            raise MapError(
                f"voxels fuses point clouds, found a receiver of type {map_type.name!r} and a layer of type "
                f"{source.layer.map_type!r}: convert them first"
            )
        T = match.T_receiver_donor.snapped()
        placed = map_type.place(source.layer, T, match.scale)
        region = map_type.region(placed)
        occupied = map_type.view(placed).points_m
        new = ~as_map(target).makes_out(occupied)
        return Contribution(
            provenance=source.provenance,
            layer=placed,
            T_receiver_donor=T,
            scale=match.scale,
            resampler=RESAMPLER,
            weights=self._weight,
            fill=None,
            region=region,
            summary={"voxels_changed": float(len(region)), "voxels_filled": float(new.sum())},
        )
