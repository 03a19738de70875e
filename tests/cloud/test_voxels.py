"""What voxels count: hits, misses, positions; ready-made maps; placing; baking; the limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import (
    CLOUD,
    SCAN,
    Cloud,
    ConfigError,
    Contribution,
    EmptyMapError,
    MapError,
    Observation,
    Provenance,
    Scan,
    Transform,
)
from mapgraft_cloud.blocks import MISSES
from mapgraft_cloud.grid_conversion import counted
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.map_type import PointCloud
from mapgraft_cloud.parameters import MOST_LOOKS
from mapgraft_cloud.region import VoxelRegion, keys_of, places_of, voxels_of

Observe = Callable[..., Observation]
VOXEL = np.array([[1.23, -0.41, 0.72]])


def counts_at(layer: CloudLayer, point: tuple[float, float, float]) -> tuple[int, int]:
    """Hits and misses of the voxel at a point."""
    voxel = np.floor(np.array([point]) / layer.voxel_m).astype(np.int64)
    hits, misses = counted(layer, keys_of(voxel))[0, :, places_of(voxel)[0]].tolist()
    return hits, misses


def contribution(kind: PointCloud, layer: CloudLayer, weight: int = 1) -> Contribution:
    return Contribution(
        Provenance("donor", 1, 1), layer, Transform.identity(), 1.0, "test", weight, None, kind.region(layer)
    )


def test_a_sweep_hits_once_per_voxel_and_misses_what_lies_before(observe: Observe) -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, observe([[2.05, 0.05, 0.05], [2.06, 0.04, 0.05], [2.07, 0.06, 0.05]]))
    assert counts_at(layer, (2.05, 0.05, 0.05)) == (1, 0)
    assert counts_at(layer, (1.05, 0.03, 0.03)) == (0, 1)
    assert counts_at(layer, (1.95, 0.05, 0.05)) == (0, 0)  # beams stop one voxel short
    assert counts_at(layer, (2.25, 0.05, 0.05)) == (0, 0)
    assert np.allclose(kind.view(layer).points_m, [[2.06, 0.05, 0.05]], atol=2e-3)


def test_a_hit_wins_over_a_miss_of_the_same_sweep(observe: Observe) -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, observe([[1.05, 0.05, 0.05], [3.05, 0.14, 0.14]]))
    assert counts_at(layer, (1.05, 0.05, 0.05)) == (1, 0)


def test_beams_end_where_they_cannot_be_trusted_any_more(observe: Observe) -> None:
    kind = PointCloud(max_range_m=5.0, free_range_m=2.0)
    layer = kind.new_layer()
    kind.integrate(layer, observe([[8.05, 0.0, 0.0]]))
    seen = kind.view(layer)
    assert not len(seen.points_m)
    assert counts_at(layer, (1.05, 0.0, 0.0)) == (0, 1)
    assert counts_at(layer, (2.55, 0.0, 0.0)) == (0, 0)


@settings(max_examples=30, deadline=None)
@given(
    origin=st.tuples(*[st.floats(-3, 3)] * 3),
    end=st.tuples(*[st.floats(-3, 3)] * 3),
)
def test_every_voxel_that_a_beam_crosses_is_seen_through(
    origin: tuple[float, float, float], end: tuple[float, float, float]
) -> None:
    kind = PointCloud(short_voxels=0, min_range_m=0.0)
    layer = kind.new_layer()
    cloud = Cloud(np.array([end], np.float32) - np.array([origin], np.float32))
    pose = Transform.from_quaternion(origin, (0.0, 0.0, 0.0, 1.0))
    kind.integrate(layer, Observation("r", 1, 1, "lidar", CLOUD, cloud, pose, pose))
    keys = layer.own.filled()
    block, place = np.nonzero(counted(layer, keys)[:, MISSES])
    crossed = {tuple(voxel) for voxel in voxels_of(keys[block], place).tolist()}
    points = pose.apply(cloud.points_m)[0] / 0.1
    steps = np.linspace(np.array(origin) / 0.1, points, 4001)[1:-1]
    inside = np.abs(steps - np.round(steps)).min(axis=1) > 1e-3  # not on a border, where rounding decides
    last = tuple(np.floor(points).astype(int).tolist())
    wanted = {tuple(voxel) for voxel in np.floor(steps[inside]).astype(int).tolist()} - {last}
    near_end = {v for v in wanted if max(abs(a - b) for a, b in zip(v, last, strict=True)) <= 1}
    assert wanted - near_end <= crossed
    assert all(np.abs(np.array(v) + 0.5 - steps).max(axis=1).min() < 0.55 for v in crossed)


def test_a_ready_made_map_replaces_the_one_before_and_mixes_with_no_sweeps(observe: Observe) -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, observe([[1, 1, 1], [2, 2, 2]], None, None, True))
    touched = kind.integrate(layer, observe([[3, 3, 3]], None, None, True))
    assert len(kind.view(layer).points_m) == 1
    assert len(touched) == 3
    assert kind.metadata(layer).extra["free_space"] is False
    with pytest.raises(MapError, match="cannot be mapped from sweeps as well"):
        kind.integrate(layer, observe(VOXEL))
    swept = kind.new_layer()
    kind.integrate(swept, observe(VOXEL))
    with pytest.raises(MapError, match="cannot be a ready-made one as well"):
        kind.integrate(swept, observe(VOXEL, None, None, True))


def test_one_sweep_in_a_file_sees_through_when_somebody_says_from_where(observe: Observe) -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, observe([[2.05, 0.05, 0.05]], None, (0.0, 0.0, 0.0), True))
    assert kind.metadata(layer).extra["free_space"] is True


def test_what_is_no_cloud_is_refused(observe: Observe) -> None:
    kind = PointCloud()
    scan = Scan(np.array([[1.0, 0.0]]), np.array([1.0], np.float32), np.array([True]))
    still = Transform.identity()
    with pytest.raises(MapError, match="found a scan of r: choose another map type"):
        kind.integrate(kind.new_layer(), Observation("r", 1, 1, "laser", SCAN, scan, still, still))
    with pytest.raises(MapError, match=r"points beyond it in a cloud of r: check poses and units"):
        kind.integrate(kind.new_layer(), observe([[1e7, 0, 0]]))


@pytest.mark.parametrize(
    "wrong",
    [{"resolution_m": 0}, {"l_hit": -1}, {"occupied": 0.4}, {"free": 0.9}, {"clamp": 0.1}, {"export": "las"}],
)
def test_impossible_parameters_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        PointCloud(**wrong)


def test_memory_grows_with_what_was_looked_at_not_with_the_way_between(observe: Observe) -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    for far in (0.0, 50_000.0):
        kind.integrate(layer, observe([[1, 0, 0]], Transform.planar(far, 0.0, 0.0)))
    once = layer.own.keys.size
    for _ in range(50):
        kind.integrate(layer, observe([[1, 0, 0]]))
    assert layer.own.keys.size == once < 20
    assert layer.nbytes < 2_000_000


def test_counts_that_would_not_fit_are_refused(observe: Observe) -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    kind.integrate(layer, observe(VOXEL))
    placed = kind.place(layer, Transform.identity())
    before = kind.encode(layer)
    layer.own.counts[layer.own.counts > 0] = MOST_LOOKS - 1
    for copy in (layer, kind.decode(kind.encode(layer))):  # the same, alive and after a journey
        kind.integrate(copy, observe(VOXEL))
        full = kind.encode(copy)
        with pytest.raises(MapError, match="map fewer of the sweeps"):
            kind.integrate(copy, observe(VOXEL))
        assert kind.encode(copy) == full != before
    taken = contribution(kind, layer)
    kind.absorb(placed, taken)
    full = kind.encode(placed)
    with pytest.raises(MapError, match="map fewer of the sweeps"):
        kind.absorb(placed, taken)
    assert kind.encode(placed) == full


def test_identity_moves_nothing(drives: tuple[CloudLayer, CloudLayer]) -> None:
    kind = PointCloud()
    assert kind.encode(kind.place(drives[0], Transform.identity())) == kind.encode(drives[0])


def test_a_tilted_map_is_placed_where_it_belongs(drives: tuple[CloudLayer, CloudLayer]) -> None:
    kind = PointCloud()
    T = Transform.from_quaternion((1.0, 2.0, 3.0), (0.2, -0.1, 0.3, 0.9))
    wanted = T.apply(kind.view(drives[0]).points_m)
    placed = kind.view(kind.place(drives[0], T)).points_m
    from scipy.spatial import cKDTree

    assert np.mean(cKDTree(wanted).query(placed)[0] < 0.1) > 0.98
    assert np.mean(cKDTree(placed).query(wanted)[0] < 0.15) > 0.9


def test_an_empty_layer_cannot_be_placed() -> None:
    kind = PointCloud()
    with pytest.raises(EmptyMapError, match="nothing to place"):
        kind.place(kind.new_layer(), Transform.identity())


def test_baking_in_and_discarding_is_counted(observe: Observe) -> None:
    kind, other = PointCloud(), PointCloud(l_hit=1.2)
    own, donor = kind.new_layer(), other.new_layer()
    kind.integrate(own, observe([[1.05, 0.05, 0.05]]))
    other.integrate(donor, observe([[1.05, 0.05, 0.05], [0.05, 1.05, 0.05]]))
    fused = kind.view(own, [contribution(kind, donor, 2)])
    foreign = kind.absorb(own, contribution(kind, donor, 2))
    baked = kind.view(own)
    assert np.array_equal(baked.log_odds, fused.log_odds)
    assert np.array_equal(baked.offsets, fused.offsets)
    assert kind.encode(kind.decode(kind.encode(own))) == kind.encode(own)
    keep = VoxelRegion.empty(0.1)
    reset = kind.reset(own, foreign, keep)
    assert reset.cells_reset == len(foreign)
    assert not len(kind.region(own))


def test_bytes_that_are_no_layer_are_refused(drives: tuple[CloudLayer, CloudLayer]) -> None:
    kind = PointCloud()
    data = kind.encode(drives[0])
    for broken in (b"", b"GARBAGE", data[:-9], data + b"x", data[:60] + b"?" + data[61:]):
        with pytest.raises(MapError, match="an encoded point cloud map"):
            kind.decode(broken)
    with pytest.raises(MapError, match="of version 7 was found, this program reads 1"):
        kind.decode(data[:7] + b"\x07\x00" + data[9:])


def test_the_map_is_shown_and_written(drives: tuple[CloudLayer, CloudLayer]) -> None:
    kind = PointCloud()
    seen = kind.view(drives[0])
    message, _ = kind.messages(seen)
    assert message.message_type == "sensor_msgs/msg/PointCloud2"
    assert message.fields["width"] == len(seen.points_m)
    assert list(kind.files(seen, "map")) == ["map.pcd"]
    for export, name in (("pcd_ascii", "map.pcd"), ("ply", "map.ply"), ("ply_ascii", "map.ply")):
        assert list(PointCloud(export=export).files(seen, "map")) == [name]
    assert not tuple(kind.messages(kind.view(kind.new_layer())))
    with pytest.raises(EmptyMapError, match="cannot be written"):
        kind.files(kind.view(kind.new_layer()), "map")
