"""Point-cloud maps in three dimensions: the map type, its files and messages, matchers, fuser, metrics and rules."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mapgraft.contracts import CLOUD, CLOUD_MAP, Descriptor, Register, RegisterRules, hookimpl

MAPGRAFT_CONTRACT = (1, 0)
_CLOUD: Final = ("point_cloud",)


@hookimpl
def register_map_types(register: Register) -> None:
    register(
        Descriptor(
            "point_cloud",
            "mapgraft_cloud.map_type:PointCloud",
            "hits and misses per voxel, from PointCloud2 and foxglove.PointCloud, PCD and PLY",
            observes={CLOUD: 50, CLOUD_MAP: 50},
        )
    )


@hookimpl
def register_decoders(register: Register) -> None:
    register(
        Descriptor(
            "point_cloud2",
            "mapgraft_cloud.messages:point_cloud2",
            "clouds in PointCloud2 messages, any layout of fields",
            accepts=("sensor_msgs/msg/PointCloud2",),
            gives=CLOUD,
        )
    )
    register(
        Descriptor(
            "foxglove_point_cloud",
            "mapgraft_cloud.messages:foxglove_point_cloud",
            "clouds in foxglove.PointCloud messages, protobuf or JSON",
            accepts=("foxglove/msg/PointCloud", "foxglove_msgs/msg/PointCloud"),
            gives=CLOUD,
        )
    )


@hookimpl
def register_formats(register: Register) -> None:
    register(
        Descriptor(
            "cloud_file",
            "mapgraft_cloud.cloud_file:read",
            "point clouds as PCD or PLY files, ASCII or binary",
            accepts=(".pcd", ".ply"),
            gives=CLOUD_MAP,
        )
    )


@hookimpl
def register_matchers(register: Register) -> None:
    register(
        Descriptor(
            "kiss",
            "mapgraft_cloud.kiss:Kiss",
            "KISS-Matcher and wall columns for a first guess, small_gicp for the rest; needs no prior",
            accepts=_CLOUD,
            uses_prior=True,
            requires=("kiss_matcher", "small_gicp"),
            extra="cloud",
        )
    )
    register(
        Descriptor(
            "gicp",
            "mapgraft_cloud.gicp:Gicp",
            "small_gicp around a prior",
            accepts=_CLOUD,
            uses_prior=True,
            needs_prior=True,
            requires=("small_gicp",),
            extra="cloud",
            laws=("mapgraft_cloud.conformance:GicpLaws",),
        )
    )


@hookimpl
def register_fusers(register: Register) -> None:
    register(
        Descriptor(
            "voxels",
            "mapgraft_cloud.voxels:Voxels",
            "adds the donor's hits and misses to the receiver's voxels",
            accepts=_CLOUD,
        )
    )


@hookimpl
def register_metrics(register: Register) -> None:
    register(
        Descriptor(
            "cloud_overlap",
            "mapgraft_cloud.evidence:CloudOverlap",
            "share of both maps' surfaces that the other has too, where it was looked",
            accepts=_CLOUD,
        )
    )
    register(
        Descriptor(
            "cloud_contradiction",
            "mapgraft_cloud.evidence:CloudContradiction",
            "share of both maps' surfaces that the other saw through",
            accepts=_CLOUD,
        )
    )


@hookimpl
def register_conversions(register: Register) -> None:
    register(
        Descriptor(
            "point_cloud_to_occupancy_grid",
            "mapgraft_cloud.grid_conversion:GridConversion",
            "columns of a height band: a hit is a hit, what was seen through is free",
            accepts=_CLOUD,
            gives="occupancy_grid",
            requires=("mapgraft_grid",),
            laws=("mapgraft_cloud.conformance:CloudToGrid",),
        )
    )
    register(
        Descriptor(
            "occupancy_grid_to_point_cloud",
            "mapgraft_cloud.grid_conversion:SliceConversion",
            "walls and free space as one slice of voxels at a stated height",
            accepts=("occupancy_grid",),
            gives="point_cloud",
            requires=("mapgraft_grid",),
            laws=("mapgraft_cloud.conformance:GridToSlice",),
        )
    )


@hookimpl
def register_rules(register: RegisterRules) -> None:
    register("point clouds", (Path(__file__).parent / "rules.yaml").read_text(encoding="utf-8"))
