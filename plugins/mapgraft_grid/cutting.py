"""Layers in parts, for others who have most of them: one with what is said once, and of each tile its own."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_grid.codec import Content, content_of
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.kernels.sketch import STEPS_PER_CELL
from mapgraft_grid.kernels.tile_keys import TILE, tile_key
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.parameters import SensorModel, TraceLimits
from mapgraft_grid.tiles import TileKeys
from mapgraft_grid.traces import RayRows

_HEAD: Final = b"h"
_COUNTS, _BAKED, _RAYS, _POSES = b"c", b"b", b"r", b"p"
_KEY: Final = struct.Struct(">q")  # big-endian: names sort as keys do
_CELLS: Final = TILE * TILE
_SIDE: Final = TILE * STEPS_PER_CELL
_RAY: Final = np.dtype([("end", "<u2", 2), ("origin", "<i4", 2), ("hit", "u1")])
_POSE: Final = 4  # numbers of one pose, 8 bytes each


def cut(layer: GridLayer) -> dict[bytes, bytes]:
    """A layer as parts, little-endian: ``h`` what there is once; with the tile's key behind it ``c`` the counts, ``b``
    what was baked in (int32), ``r`` the rays one by one, and ``p`` the poses column by column.

    Counts are byte planes: the lowest bytes of all hits, of all misses, then the next ones, as many as it takes. So a
    part differs from what it was before in as many bytes as there are cells that were looked at.
    """
    content = content_of(layer)
    told = {_HEAD: content.head}
    for key, hits, misses in zip(content.keys.tolist(), content.hits, content.misses, strict=True):
        told[_COUNTS + _KEY.pack(key)] = _planes(hits, misses)
    for key, tile in zip(content.baked_keys.tolist(), content.baked, strict=True):
        told[_BAKED + _KEY.pack(key)] = tile.astype("<i4").tobytes()
    for key, rays in _by_tile(content.ray_keys, content.rays):
        told[_RAYS + _KEY.pack(key)] = _ray_bytes(rays)
    for key, poses in _by_tile(_tiles_of(content.poses), content.poses):
        told[_POSES + _KEY.pack(key)] = poses.T.astype("<i8").tobytes()
    return told


def join(parts: Mapping[bytes, bytes]) -> GridLayer:
    """The layer of these parts; raises MapError when they are not exactly what ``cut`` makes of one."""
    try:
        layer = _content(parts).layer()
    except (ValueError, struct.error, KeyError) as fault:
        raise MapError(f"the parts of a grid do not hold together ({fault}): send it again") from fault
    if cut(layer) != dict(parts):
        raise MapError("the parts of a grid are not cut as written: send it again")
    return layer


def preview(layer: GridLayer, seen: GridMap) -> GridLayer:
    """A layer with one look at each cell that is known in the layer's view ``seen``, as sure as that view can be."""
    read, limits = seen.thresholds, layer.traces.limits
    bare = TraceLimits(0, 0, limits.beam_step_rad, limits.path_step_m, limits.path_step_rad)
    made = GridLayer(layer.lattice, SensorModel(read.clamp, -read.clamp), bare)
    tiles = [(key, tile.log_odds) for key, tile in seen.tiles.items() if tile.known]
    shown = np.array([log_odds for _, log_odds in tiles], np.int16).reshape(-1, TILE, TILE)
    hits, misses = (shown >= read.occupied).astype(np.uint32), (shown <= read.free).astype(np.uint32)
    made.pool.set_counts(np.array([key for key, _ in tiles], np.int64), hits, misses)
    made.observations, made.mapper, made.sensors = layer.observations, layer.mapper, layer.sensors
    return made


def _planes(hits: NDArray[np.uint32], misses: NDArray[np.uint32]) -> bytes:
    used = (int(max(hits.max(), misses.max())).bit_length() + 7) // 8
    both = np.stack((hits, misses)).astype("<u4").view(np.uint8).reshape(2, _CELLS, 4)
    return both[:, :, :used].transpose(2, 0, 1).tobytes()


def _counts(data: bytes) -> NDArray[np.uint32]:
    """Hits and misses (2, 64, 64) of one tile; raises ValueError when they are none."""
    used, rest = divmod(len(data), 2 * _CELLS)
    if rest or not 1 <= used <= 4:
        raise ValueError(f"{len(data)} bytes of counts")
    both = np.zeros((2, _CELLS, 4), np.uint8)
    both[:, :, :used] = np.frombuffer(data, np.uint8).reshape(used, 2, _CELLS).transpose(1, 2, 0)
    counts: NDArray[np.uint32] = both.view("<u4").astype(np.uint32).reshape(2, TILE, TILE)
    return counts


def _content(parts: Mapping[bytes, bytes]) -> Content:
    """What all parts say together; raises ValueError, KeyError or struct.error when they cannot be read."""
    named: dict[bytes, list[tuple[int, bytes]]] = {_COUNTS: [], _BAKED: [], _RAYS: [], _POSES: []}
    for name in sorted(parts):
        if name != _HEAD:
            named[name[:1]].append((*_KEY.unpack(name[1:]), parts[name]))
    counts = np.array([_counts(data) for _, data in named[_COUNTS]], np.uint32).reshape(-1, 2, TILE, TILE)
    baked = b"".join(data for _, data in named[_BAKED])
    rays = [_ray_rows(data) for _, data in named[_RAYS]]
    poses = np.concatenate([_rows(data, "<i8", _POSE) for _, data in named[_POSES]] or [np.empty((0, _POSE), "<i8")])
    return Content(
        parts[_HEAD],
        _keys(named[_COUNTS]),
        counts[:, 0],
        counts[:, 1],
        _keys(named[_BAKED]),
        np.frombuffer(baked, "<i4").astype(np.int32).reshape(-1, TILE, TILE),
        np.repeat(_keys(named[_RAYS]), [len(rows) for rows in rays]),
        np.concatenate([*rays, np.empty((0, 5), np.int32)]),
        poses[np.lexsort(poses.T[::-1])].astype(np.int64),
    )


def _keys(named: Sequence[tuple[int, bytes]]) -> TileKeys:
    return np.array([key for key, _ in named], np.int64)


def _ray_bytes(rays: NDArray[np.integer]) -> bytes:
    """Rays (n, 5) of one tile, each by itself: one that is new leaves the others as they were."""
    out = np.empty(len(rays), _RAY)
    out["end"], out["origin"], out["hit"] = rays[:, :2], rays[:, 2:4], rays[:, 4]
    return out.tobytes()


def _ray_rows(data: bytes) -> RayRows:
    told = np.frombuffer(data, _RAY)
    return np.column_stack((told["end"], told["origin"], told["hit"])).astype(np.int32)


def _rows(data: bytes, dtype: str, columns: int) -> NDArray[np.int64]:
    rows: NDArray[np.int64] = np.frombuffer(data, dtype).reshape(columns, -1).T
    return rows


def _tiles_of(poses: NDArray[np.int64]) -> TileKeys:
    corners = (poses[:, 1:3] // _SIDE).tolist()
    return np.array([tile_key(x, y) for x, y in corners], np.int64)


def _by_tile(keys: TileKeys, rows: NDArray[np.integer]) -> Iterator[tuple[int, NDArray[np.integer]]]:
    """The rows of each tile, in the order in which they were."""
    order = np.argsort(keys, kind="stable")
    found, first = np.unique(keys[order], return_index=True)
    yield from zip(found.tolist(), np.split(rows[order], first[1:]), strict=False)
