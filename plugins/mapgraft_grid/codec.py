"""Layers as bytes: canonical, compressed, and checked when they come back.

``MGGRID`` and a version, then one zstd frame that holds, little-endian: the parameters (``_HEAD``), the last pose, the
sensors' names, and arrays, each as item size, length and items: tile keys; hits and misses (tiles, 64, 64) in the
smallest of 8, 16 and 32 bits that holds them; keys and log-odds of absorbed tiles; keys and rows of rays; poses. Tiles
without evidence are left out and everything is sorted, so that equal layers have equal bytes.
"""

from __future__ import annotations

import math
import struct
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft_grid.kernels.sketch import HIT, STEPS_PER_CELL
from mapgraft_grid.kernels.tile_keys import KEY_BITS, TILE, tile_x, tile_y
from mapgraft_grid.layer import FROM_SCANS, READY_MADE, GridLayer
from mapgraft_grid.parameters import CELL_LIMIT, COARSEST_M, FINEST_M, Lattice, SensorModel, TraceLimits
from mapgraft_grid.tiles import Cell
from mapgraft_grid.traces import Pose
from mapgraft_standard.frames import Frame

_FRAME: Final = Frame("grid", b"MGGRID", 1, 1 << 29)  # 65 000 tiles of up to 255 looks
_MOST_TRACES: Final = 4096  # rays or poses per tile
_HEAD: Final = struct.Struct("<3d 2i 2I 3d Q 2B H")
_POSE: Final = struct.Struct("<Q 3q")
_ARRAY: Final = struct.Struct("<B Q")
_MAPPERS: Final = ("", FROM_SCANS, READY_MADE)


def encode(layer: GridLayer) -> bytes:
    """Canonical bytes of a layer: equal evidence and traces give equal bytes, however they came together."""
    return _FRAME.head + _FRAME.packer().compress(_payload(layer))


def decode(data: bytes) -> GridLayer:
    """The layer of these bytes; raises MapError when they do not hold exactly what ``encode`` packs."""
    payload = bytes(_FRAME.unpacked(data))
    try:
        layer = _Reader(payload).layer()
    except (struct.error, ValueError, IndexError) as fault:
        raise _FRAME.damaged(fault) from fault
    if _payload(layer) != payload:
        raise _FRAME.damaged("its parts are out of order or incomplete")
    return layer


def _payload(layer: GridLayer) -> bytes:
    lattice, model, limits = layer.lattice, layer.sensor_model, layer.traces.limits
    names = [name.encode() for name in sorted(layer.sensors)]
    keys = np.sort(layer.pool.index.keys)
    hits, misses = layer.pool.counts(keys)
    of = layer.pool.absorbed.of[layer.pool.index.find(keys)]
    baked = np.zeros(keys.size, np.bool_)
    baked[of >= 0] = layer.pool.absorbed.tiles[of[of >= 0]].any(axis=(1, 2))
    counted = (hits | misses).any(axis=(1, 2))
    ray_keys, rays = layer.traces.ray_rows()
    parts = [
        _HEAD.pack(
            lattice.resolution_m,
            *lattice.anchor_m,
            model.l_hit,
            model.l_miss,
            limits.rays_per_tile,
            limits.poses_per_tile,
            limits.beam_step_rad,
            limits.path_step_m,
            limits.path_step_rad,
            layer.observations,
            _MAPPERS.index(layer.mapper),
            layer.traces.last is not None,
            len(names),
        ),
        _POSE.pack(*layer.traces.last) if layer.traces.last else b"",
        *(struct.pack("<H", len(name)) + name for name in names),
        _array(keys[counted]),
        _array(_smallest(hits[counted])),
        _array(_smallest(misses[counted])),
        _array(keys[baked]),
        _array(layer.pool.absorbed.tiles[of[baked]]),
        _array(ray_keys),
        _array(rays),
        _array(np.array(layer.traces.poses(), np.int64).reshape(-1, 4)),
    ]
    return b"".join(parts)


def _smallest(counts: NDArray[np.uint32]) -> NDArray[np.unsignedinteger]:
    most = int(counts.max(initial=0))
    return counts.astype(np.uint8 if most < 1 << 8 else np.uint16 if most < 1 << 16 else np.uint32)


def _array(values: NDArray[np.integer]) -> bytes:
    little = values.astype(values.dtype.newbyteorder("<"), copy=False)
    return _ARRAY.pack(values.itemsize, values.size) + little.tobytes()


class _Reader:
    """Takes a payload apart; struct.error, ValueError or IndexError when it does not hold together."""

    def __init__(self, payload: bytes) -> None:
        self._payload = payload
        self._at = 0

    def layer(self) -> GridLayer:
        resolution, ax, ay, l_hit, l_miss, rays, poses, *steps, observations, mapper, has_pose, names = self._take(
            _HEAD
        )
        if not (FINEST_M <= resolution <= COARSEST_M and 0 <= ax < resolution and 0 <= ay < resolution):
            raise ValueError(f"resolution {resolution} m, anchor {ax}, {ay} m")
        if rays > _MOST_TRACES or poses > _MOST_TRACES or not all(map(math.isfinite, steps)) or not l_hit > 0 > l_miss:
            raise ValueError("impossible parameters")
        layer = GridLayer(
            Lattice(resolution, (ax, ay)),
            SensorModel(l_hit, l_miss),
            TraceLimits(rays, poses, steps[0], steps[1], steps[2]),
        )
        layer.observations, layer.mapper = observations, _MAPPERS[mapper]
        layer.traces.last = Pose(*self._take(_POSE)) if has_pose else None
        layer.sensors = frozenset(self._text() for _ in range(names))
        self._counts(layer)
        self._absorbed(layer)
        self._traces(layer)
        if self._at != len(self._payload):
            raise ValueError("something follows its end")
        return layer

    def _counts(self, layer: GridLayer) -> None:
        keys = self._keys()
        hits = self._unsigned().reshape(-1, TILE, TILE)
        misses = self._unsigned().reshape(-1, TILE, TILE)
        layer.pool.set_counts(keys, hits, misses)

    def _absorbed(self, layer: GridLayer) -> None:
        keys = self._keys()
        tiles = self._items(np.dtype("<i4")).reshape(-1, TILE, TILE)
        for slot, values in zip(layer.pool.claim(keys).tolist(), tiles, strict=True):
            layer.pool.absorbed.write(slot, values)

    def _traces(self, layer: GridLayer) -> None:
        keys = self._checked(self._items(np.dtype("<i8")))
        rays = self._items(np.dtype("<i4")).reshape(-1, 5)
        inside = (rays[:, :2] >= 0).all() and (rays[:, :2] < TILE * STEPS_PER_CELL).all()
        if keys.size != rays.shape[0] or not inside or not np.isin(rays[:, HIT], (0, 1)).all():
            raise ValueError("impossible rays")
        layer.traces.insert_rays(keys, rays)
        poses = self._items(np.dtype("<i8")).reshape(-1, 4)
        if (abs(poses[:, 1:3]) > CELL_LIMIT * STEPS_PER_CELL).any() or (poses[:, 0] < 0).any():
            raise ValueError("impossible poses")
        for row in poses.tolist():
            layer.traces.insert_pose(Pose(*row))

    def _keys(self) -> NDArray[np.int64]:
        keys = self._checked(self._items(np.dtype("<i8")))
        if (np.diff(keys) <= 0).any():
            raise ValueError("tiles out of order")
        return keys

    def _checked(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        if (keys < 0).any() or (keys >= 1 << (2 * KEY_BITS)).any():
            raise ValueError("tiles that cannot be")
        most = CELL_LIMIT // TILE
        if any(abs(tile_x(key)) > most or abs(tile_y(key)) > most for key in np.unique(keys).tolist()):
            raise ValueError("tiles out of reach")
        return keys

    def _unsigned(self) -> NDArray[np.uint32]:
        size = self._payload[self._at]
        if size not in (1, 2, 4):
            raise ValueError(f"counts of {size} bytes")
        return self._items(np.dtype(f"<u{size}")).astype(np.uint32)

    def _items(self, dtype: np.dtype[Cell]) -> NDArray[Cell]:
        size, count = self._take(_ARRAY)
        if size != dtype.itemsize or count * size > len(self._payload) - self._at:
            raise ValueError(f"an array of {count} × {size} bytes where {len(self._payload) - self._at} are left")
        items = np.frombuffer(self._payload, dtype, count, self._at)
        self._at += count * size
        return items.astype(dtype.newbyteorder("="))

    def _take(self, shape: struct.Struct) -> tuple[Any, ...]:
        values = shape.unpack_from(self._payload, self._at)
        self._at += shape.size
        return values

    def _text(self) -> str:
        (length,) = self._take(struct.Struct("<H"))
        text = self._payload[self._at : self._at + length]
        self._at += length
        if len(text) < length:
            raise ValueError("a name is cut short")
        return text.decode()
