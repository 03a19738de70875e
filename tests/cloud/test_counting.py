"""One look is one look: points that are no returns, voxels that come together, donors beside ready-made maps, bytes."""

from __future__ import annotations

import json
import struct
import tracemalloc
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import CLOUD, Cloud, Contribution, MapError, Observation, Provenance, Transform
from mapgraft_cloud.grid_conversion import counted
from mapgraft_cloud.layer import CloudLayer
from mapgraft_cloud.map_type import PointCloud
from mapgraft_cloud.messages import point_cloud2
from mapgraft_cloud.region import keys_of, places_of

Observe = Callable[..., Observation]
WALL = np.array([[2.0, y, z] for y in np.arange(0.0, 2.0, 0.03) for z in np.arange(0.0, 1.0, 0.03)])


def looks(layer: CloudLayer) -> tuple[int, int]:
    """The most hits and the most misses of any voxel."""
    counts = counted(layer, layer.keys())
    return int(counts[:, 0].max(initial=0)), int(counts[:, 1].max(initial=0))


def organised(points: np.ndarray) -> SimpleNamespace:
    """A PointCloud2 of (rows, columns, 3) points that calls itself dense."""
    height, width = points.shape[:2]
    fields = [SimpleNamespace(name=axis, offset=4 * k, datatype=7, count=1) for k, axis in enumerate("xyz")]
    return SimpleNamespace(
        height=height,
        width=width,
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * width,
        data=np.frombuffer(points.astype("<f4").tobytes(), np.uint8),
        is_dense=True,
    )


def test_beams_without_return_are_no_walls_on_the_way() -> None:
    kind = PointCloud()
    layer = kind.new_layer()
    beams = np.zeros((16, 24, 3), np.float32)
    beams[::2, :, 0] = 4.0
    for step in range(5):
        cloud = point_cloud2(organised(beams))
        pose = Transform.planar(0.5 * step, 0.0, 0.0)
        kind.integrate(layer, Observation("r", step, step, "lidar", CLOUD, cloud, pose, pose))
        assert cloud.dropped == 8 * 24
    assert layer.dropped == 5 * 8 * 24
    assert (kind.view(layer).points_m[:, 0] > 3.5).all()


def test_a_cloud_of_zeros_is_a_cloud_without_points() -> None:
    cloud = point_cloud2(organised(np.zeros((4, 9, 3))))
    assert (len(cloud.points_m), cloud.dropped) == (0, 36)


def test_the_robot_itself_is_no_wall(observe: Observe) -> None:
    kind, near = PointCloud(), PointCloud(min_range_m=0.0)
    bumper = [[0.2, 0.0, 0.0], [0.0, -0.25, 0.1], [3.0, 0.0, 0.0]]
    layer, with_bumper = kind.new_layer(), near.new_layer()
    kind.integrate(layer, observe(bumper))
    near.integrate(with_bumper, observe(bumper))
    assert (len(kind.view(layer).points_m), layer.dropped) == (1, 2)
    assert (len(near.view(with_bumper).points_m), with_bumper.dropped) == (3, 0)


@settings(max_examples=25, deadline=None)
@given(
    size=st.sampled_from([0.05, 0.1, 0.17, 0.2, 0.4]),
    x=st.integers(-300, 300),
    yaw=st.integers(-314, 314),
    sweeps=st.integers(1, 3),
)
def test_placing_makes_no_more_looks_than_there_were_sweeps(size: float, x: int, yaw: int, sweeps: int) -> None:
    donor, receiver = PointCloud(resolution_m=0.05), PointCloud(resolution_m=size)
    layer, still = donor.new_layer(), Transform.identity()
    for _ in range(sweeps):
        cloud = Cloud(WALL.astype(np.float32))
        donor.integrate(layer, Observation("r", 1, 1, "lidar", CLOUD, cloud, still, still))
    placed = receiver.place(layer, Transform.planar(x / 100.0, 0.0, yaw / 100.0))
    assert looks(placed) == (sweeps, sweeps)
    points = receiver.view(placed).points_m
    back = Transform.planar(x / 100.0, 0.0, yaw / 100.0).inverse().apply(points)
    assert np.abs(back[:, 0] - 2.0).max() < 0.01  # the wall is where it was, not on the lattice of its voxels


def test_of_voxels_that_come_together_the_surest_counts(observe: Observe) -> None:
    fine, coarse = PointCloud(resolution_m=0.1), PointCloud(resolution_m=0.2)
    layer = fine.new_layer()
    for _ in range(3):
        fine.integrate(layer, observe([[2.05, 0.05, 0.05]], None, (2.05, 3.0, 0.05)))
    fine.integrate(layer, observe([[2.15, 0.05, 0.05]], None, (2.15, 3.0, 0.05)))
    placed = coarse.place(layer, Transform.identity())
    voxel = np.array([[10, 0, 0]])
    assert counted(placed, keys_of(voxel))[0, :, places_of(voxel)[0]].tolist() == [3, 0]
    assert coarse.view(placed).points_m[:, 0] == pytest.approx([(3 * 2.05 + 2.15) / 4], abs=1e-3)


def baked(kind: PointCloud, layer: CloudLayer, donor: CloudLayer) -> Contribution:
    given = Contribution(Provenance("d", 1, 1), donor, Transform.identity(), 1.0, "test", 1, None, kind.region(donor))
    kind.absorb(layer, given)
    return given


def test_a_new_ready_made_map_leaves_what_was_baked_in_before(observe: Observe) -> None:
    kind = PointCloud()
    layer, donor = kind.new_layer(), kind.new_layer()
    kind.integrate(layer, observe([[1.05, 0.05, 0.05]], None, None, True))
    kind.integrate(donor, observe([[5.05, 0.05, 0.05], [6.05, 0.05, 0.05]], None, None, True))
    given = baked(kind, layer, donor)
    kind.integrate(layer, observe([[1.25, 0.05, 0.05]], None, None, True))
    assert np.allclose(kind.view(layer).points_m[:, 0], [1.25, 5.05, 6.05], atol=1e-3)
    assert kind.encode(kind.decode(kind.encode(layer))) == kind.encode(layer)
    reset = kind.reset(layer, given.region, kind.region(kind.new_layer()))
    assert (reset.cells_reset, reset.cells_contaminated) == (2, 0)
    assert np.allclose(kind.view(layer).points_m[:, 0], [1.25], atol=1e-3)


def repacked(data: bytes, change: Callable[[bytes], bytes], level: int = 3) -> bytes:
    body = zstandard.ZstdDecompressor().decompressobj().decompress(data[9:])
    packer = zstandard.ZstdCompressor(level=level, write_checksum=True).compressobj()
    return data[:9] + packer.compress(change(body)) + packer.flush()


def header(change: Callable[[dict[str, object]], None]) -> Callable[[bytes], bytes]:
    def changed(body: bytes) -> bytes:
        line, _, rest = body.partition(b"\n")
        told = json.loads(line)
        change(told)
        return json.dumps(told, sort_keys=True).encode() + b"\n" + rest

    return changed


def test_only_canonical_bytes_are_a_layer(drives: tuple[CloudLayer, CloudLayer]) -> None:
    kind = PointCloud()
    data = kind.encode(drives[0])
    assert kind.encode(kind.decode(data)) == data
    for wrong in (
        repacked(data, lambda body: body, level=9),
        repacked(data, header(lambda told: told.update(voxel_m=0.0))),
        repacked(data, header(lambda told: told.update(observations=-1))),
        repacked(data, header(lambda told: told.update(more=1))),
        repacked(data, header(lambda told: told.update(pools=[]))),
        repacked(data, lambda body: header(lambda told: told.update(pools=[]))(body[: body.index(b"\n") + 1])),
        repacked(data, header(lambda told: told.update(floors=[[0, 0, 1 << 40, 1]]))),
        repacked(data, lambda body: body + b"\0"),
        repacked(data, lambda body: body[:-4] + struct.pack("<I", (1 << 32) - 1)),  # a position outside its voxel
    ):
        with pytest.raises(MapError, match="an encoded point cloud map"):
            kind.decode(wrong)


def test_a_small_message_cannot_take_much_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    from mapgraft_cloud import codec

    monkeypatch.setattr(codec, "_FRAME", codec._FRAME._replace(most_bytes=1 << 20))
    kind = PointCloud()
    bomb = repacked(kind.encode(kind.new_layer()), lambda _: bytes(1 << 28))
    assert len(bomb) < 20_000
    tracemalloc.start()
    with pytest.raises(MapError, match="unpacks to more than"):
        kind.decode(bomb)
    assert tracemalloc.get_traced_memory()[1] < 1 << 28
    tracemalloc.stop()
