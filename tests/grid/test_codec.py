"""Layers as bytes: canonical, and nothing else is taken for a layer."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from random import Random

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from mapgraft.contracts import MapError, Observation, Transform
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid

MakeScan = Callable[..., Observation]

HEADER = b"MGGRID\x01\x00"


def _scans(scan_of: MakeScan, seed: int, count: int) -> list[Observation]:
    random = np.random.default_rng(seed)
    return [
        scan_of(
            np.linspace(-1.5, 1.5, 30),
            random.uniform(0.2, 8.0, 30),
            random.random(30) < 0.8,
            (*random.uniform(-3, 3, 2), random.uniform(-math.pi, math.pi)),
            sensor=f"laser {i % 2}",
        )
        for i in range(count)
    ]


def _layer(grid: OccupancyGrid, scans: list[Observation]) -> GridLayer:
    layer = grid.new_layer()
    for scan in scans:
        grid.integrate(layer, scan)
    return layer


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), count=st.integers(0, 8), resolution=st.sampled_from([0.05, 0.1, 1.0]))
def test_decoding_is_the_inverse(scan_of: MakeScan, seed: int, count: int, resolution: float) -> None:
    grid = OccupancyGrid(resolution_m=resolution, l_hit=0.7, rays_per_tile=5, poses_per_tile=3)
    layer = _layer(grid, _scans(scan_of, seed, count))
    data = grid.encode(layer)
    again = OccupancyGrid().decode(data)
    assert grid.encode(again) == data
    assert (again.lattice, again.sensor_model, again.traces.limits) == (
        layer.lattice,
        layer.sensor_model,
        layer.traces.limits,
    )
    assert (again.observations, again.sensors, again.mapper) == (layer.observations, layer.sensors, layer.mapper)
    assert grid.region(again) == grid.region(layer)
    assert (again.path() == layer.path()).all()
    for ours, theirs in zip(again.rays(), layer.rays(), strict=True):
        assert (ours == theirs).all()
    more = _scans(scan_of, seed + 1, 2)
    for scan in more:
        grid.integrate(layer, scan)
        grid.integrate(again, scan)
    assert grid.encode(again) == grid.encode(layer), "a decoded layer goes on as the original does"


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), order=st.randoms(use_true_random=False))
def test_equal_layers_have_equal_bytes(scan_of: MakeScan, seed: int, order: Random) -> None:
    """The order of the scans decides the path and nothing else."""
    grid = OccupancyGrid(resolution_m=0.1, rays_per_tile=4, poses_per_tile=0)
    scans = _scans(scan_of, seed, 6)
    still = [
        Observation(s.robot, 0, 0, s.sensor, s.kind, s.payload, s.T_map_sensor, Transform.identity()) for s in scans
    ]
    first = grid.encode(_layer(grid, still))
    order.shuffle(still)
    assert grid.encode(_layer(grid, still)) == first


def test_tiles_that_were_erased_leave_no_bytes(scan_of: MakeScan) -> None:
    grid = OccupancyGrid(resolution_m=0.1, rays_per_tile=0, poses_per_tile=0)
    here = scan_of(0.0, 2.0)
    left = []
    for x in (100.0, -300.0):
        there = scan_of(0.0, 2.0, True, (x, x, 0.0))
        layer = _layer(grid, [here, there])
        grid.reset(layer, grid.region(_layer(grid, [there])), grid.region(grid.new_layer()))
        left.append(grid.encode(layer))
    assert left[0] == left[1]


def test_a_real_building_takes_little_room(intel: list[Observation]) -> None:
    grid = OccupancyGrid()
    data = grid.encode(_layer(grid, intel))
    assert len(data) < 400_000
    assert grid.encode(grid.decode(data)) == data


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_damaged_bytes_are_refused(scan_of: MakeScan, data: st.DataObject) -> None:
    """Whatever happens to the payload: an error in one sentence, or exactly what these bytes say."""
    grid = OccupancyGrid(resolution_m=0.5, rays_per_tile=3)
    good = grid.encode(_layer(grid, _scans(scan_of, 1, 3)))
    payload = bytearray(zstandard.ZstdDecompressor().decompress(good[len(HEADER) :]))
    for _ in range(data.draw(st.integers(1, 4))):
        kind = data.draw(st.sampled_from(["flip", "cut", "insert", "number"]))
        at = data.draw(st.integers(0, min(len(payload) - 9, 400)) | st.integers(0, len(payload) - 9))
        if kind == "flip":
            payload[at] ^= 1 << data.draw(st.integers(0, 7))
        elif kind == "cut":
            del payload[at : at + data.draw(st.integers(1, 64))]
        elif kind == "insert":
            payload[at:at] = data.draw(st.binary(min_size=1, max_size=16))
        else:
            payload[at : at + 8] = struct.pack("<Q", data.draw(st.sampled_from([0, 2**31, 2**63 - 1, 2**64 - 1])))
    bad = HEADER + zstandard.ZstdCompressor(level=3).compress(bytes(payload))
    try:
        layer = grid.decode(bad)
    except MapError as error:
        assert str(error).count("\n") == 0
    else:
        again = zstandard.ZstdDecompressor().decompress(grid.encode(layer)[len(HEADER) :])
        assert again == bytes(payload)


def test_truncated_and_foreign_bytes_are_refused(scan_of: MakeScan) -> None:
    grid = OccupancyGrid(resolution_m=0.5)
    good = grid.encode(_layer(grid, _scans(scan_of, 2, 3)))
    for length in range(0, len(good), 7):
        with pytest.raises(MapError):
            grid.decode(good[:length])
    for bad in (good + b"x", b"", b"PK\x03\x04" + good, HEADER + b"no zstd at all", HEADER):
        with pytest.raises(MapError):
            grid.decode(bad)
    with pytest.raises(MapError, match="version 7"):
        grid.decode(b"MGGRID\x07\x00" + good[8:])


def test_cells_finer_than_any_configuration_allows_are_refused() -> None:
    good = OccupancyGrid(resolution_m=0.5).encode(OccupancyGrid(resolution_m=0.5).new_layer())
    payload = zstandard.ZstdDecompressor().decompress(good[len(HEADER) :])
    tiny = zstandard.ZstdCompressor(level=3).compress(struct.pack("<d", 5e-324) + payload[8:])
    with pytest.raises(MapError, match="resolution"):
        OccupancyGrid().decode(HEADER + tiny)


def test_bytes_that_swell_are_refused_before_they_fill_the_memory() -> None:
    swelling = zstandard.ZstdCompressor(level=1).compress(bytes((1 << 29) + 1))
    assert len(swelling) < 100_000
    with pytest.raises(MapError, match="unpacks to more than"):
        OccupancyGrid().decode(HEADER + swelling)
