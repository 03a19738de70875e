"""How observations enter a layer: scans are counted, ready-made maps replace what was there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import GridMessage, MapError, Observation, Scan, Transform
from mapgraft_grid import baking
from mapgraft_grid.grid_map import LARGEST_DENSE
from mapgraft_grid.kernels import rays, sketch, tile_keys
from mapgraft_grid.kernels.tile_keys import TILE, tile_key
from mapgraft_grid.layer import FROM_SCANS, READY_MADE, GridLayer
from mapgraft_grid.parameters import (
    CELL_LIMIT,
    COARSEST_M,
    FINEST_M,
    LOG_ODDS_PER_NAT,
    Lattice,
    SensorModel,
    Thresholds,
    log_odds,
)
from mapgraft_grid.placing import place
from mapgraft_grid.region import GridRegion
from mapgraft_grid.tiles import BitRows, Cell, TileKeys, TilePool

_NO_BEAM_POSES: Final = np.zeros((0, 3))
_MOST_SCATTERED: Final = 4096  # tiles of a rectangle in which a map may lie as it likes
_SCATTER: Final = 32  # tiles of the rectangle per tile that is mapped: no drive makes more, one wrong pose does
_MOST_LOOKS: Final = 1 << 31  # per layer, so that no count leaves uint32
_STRAIGHT: Final = 1e-9  # sine up to which a ready-made map is not turned

_Given = tuple[
    NDArray[np.float64],
    NDArray[np.float32],
    NDArray[np.bool_],
    NDArray[np.float64],
    NDArray[np.float64],
    tuple[float, float, float],
    tuple[float, float],
]


class Beams(NamedTuple):
    """The beams of scans in cells: (n, 4) x0, y0, x1, y1, and (n,) rays.NO_BEAM, FREE_END or HIT_END."""

    beams: NDArray[np.float64]
    kinds: NDArray[np.uint8]


_Kept = tuple[Observation, Lattice, tuple[float, float], Beams]
_latest: dict[int, _Kept] = {}
_MOST_KEPT: Final = 64  # scans
_together: dict[tuple[object, ...], tuple[tuple[Observation, ...], Beams]] = {}
_NO_BEAMS: Final = Beams(np.empty((0, 4)), np.empty(0, np.uint8))

CountTable = NDArray[np.uint32]  # (101, 2) hits and misses for the values 0 … 100


class Seen(NamedTuple):
    """What one scan sees: tiles in ascending order with their free and hit cells, and its beams in cells."""

    keys: TileKeys
    free: BitRows
    hit: BitRows
    directions: NDArray[np.float64]  # (n, 2) in the sensor frame
    beams: NDArray[np.float64]  # (n, 4) x0, y0, x1, y1
    kinds: NDArray[np.uint8]  # (n,) rays.NO_BEAM, FREE_END or HIT_END


def add_scan(layer: GridLayer, observation: Observation, scan: Scan, reach_m: tuple[float, float]) -> GridRegion:
    """Count one scan, each cell once; returns the cells touched. The layer is as before when it raises MapError."""
    _require_mapper(layer, FROM_SCANS, observation)
    lattice, traces = layer.lattice, layer.traces
    seen = cells_of(scan, observation.T_map_sensor, lattice, reach_m)
    if isinstance(seen, int):
        raise MapError(_refusal(seen, observation))
    spread = _spread(layer, seen.keys, observation)
    _remember(observation, lattice, reach_m, Beams(seen.beams, seen.kinds))
    traces.add_pose(observation.T_map_base, layer.observations, lattice)
    layer.pool.count(seen.keys, seen.free, seen.hit)
    layer.spread = spread
    if traces.limits.rays_per_tile:
        traces.insert_rays(*sketch.pick(seen.directions, seen.beams, seen.kinds, traces.limits.beam_step_rad))
    _note(layer, FROM_SCANS, observation)
    return GridRegion(lattice, seen.keys, seen.free | seen.hit)


def _spread(layer: GridLayer, keys: TileKeys, observation: Observation) -> tuple[int, int, int, int] | None:
    """The tiles that scans have reached, with these; raises MapError when no array could hold what lies between."""
    before = layer.spread
    if before is None and len(layer.pool.index):
        before = tile_keys.spread(layer.pool.index.keys)
    if not keys.size:
        return before
    x0, y0, x1, y1 = tile_keys.spread(keys)
    if before is not None:
        x0, y0, x1, y1 = min(x0, before[0]), min(y0, before[1]), max(x1, before[2]), max(y1, before[3])
    across, up = x1 - x0 + 1, y1 - y0 + 1
    width, height = across * TILE, up * TILE
    mapped = len(layer.pool.index) + keys.size
    scattered = across * up > max(_MOST_SCATTERED, _SCATTER * mapped)
    if scattered or width * height > LARGEST_DENSE:
        T, why = observation.T_map_sensor, f"the most is {LARGEST_DENSE:,}"
        raise MapError(
            f"a scan of {observation.robot} from ({T.x_m:.6g}, {T.y_m:.6g}) m would stretch its map to {width:,} × "
            f"{height:,} cells, {'almost all of them empty' if scattered else why}: check its pose, or take a coarser "
            "resolution_m"
        )
    return x0, y0, x1, y1


def cells_of(scan: Scan, T_map_sensor: Transform, lattice: Lattice, reach_m: tuple[float, float]) -> Seen | int:
    """What one scan sees; or the status of kernels.rays.cast that says why it cannot be used.

    Raises MapError when the arrays of the scan do not belong together.
    """
    n = scan.ranges_m.size
    poses = scan.T_sensor_beam
    if scan.directions.shape != (n, 2) or scan.hits.size != n or not (poses is None or poses.shape == (n, 3)):
        raise MapError(
            f"a scan needs a direction and a hit for each of its {n} ranges, found {scan.directions.shape}, "
            f"{scan.hits.shape} and beam poses {None if poses is None else poses.shape}: its reader is wrong"
        )
    beams, kinds = np.empty((n, 4)), np.empty(n, np.uint8)
    given = _given(scan, T_map_sensor, lattice, reach_m)
    status, first, keys, free, hit = rays.cast(*given, 0, beams, kinds)
    while first:  # a scan of thousands of cells across is drawn in bands
        _, first, more_keys, more_free, more_hit = rays.cast(*given, first, beams, kinds)
        keys = np.concatenate((keys, more_keys))
        free, hit = np.concatenate((free, more_free)), np.concatenate((hit, more_hit))
    return status if status != rays.OK else Seen(keys, free, hit, given[0], beams, kinds)


def _given(scan: Scan, T_map_sensor: Transform, lattice: Lattice, reach_m: tuple[float, float]) -> _Given:
    """A scan as the kernels take it."""
    poses = scan.T_sensor_beam
    return (
        _plain(scan.directions, np.float64),
        _plain(scan.ranges_m, np.float32),
        _plain(scan.hits, np.bool_),
        _NO_BEAM_POSES if poses is None else _plain(poses, np.float64),
        T_map_sensor.matrix,
        (lattice.resolution_m, lattice.anchor_m[0], lattice.anchor_m[1]),
        reach_m,
    )


def beams_of(observations: Sequence[Observation], lattice: Lattice, reach_m: tuple[float, float]) -> Beams:
    """The beams of some scans as they were counted, one after the other; what is no scan, or cannot be used, has none.

    Those of the latest scans are kept, because every merge asks for them.
    """
    asked = (*map(id, observations), lattice, reach_m)
    kept = _together.get(asked)
    if kept is None or any(a is not b for a, b in zip(kept[0], observations, strict=True)):
        parts = [_beams_of(observation, lattice, reach_m) for observation in observations]
        beams = Beams(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True))) if parts else _NO_BEAMS
        _together.clear()
        kept = _together[asked] = (tuple(observations), beams)
    return kept[1]


def _beams_of(observation: Observation, lattice: Lattice, reach_m: tuple[float, float]) -> Beams:
    kept = _latest.get(id(observation))
    if kept is None or kept[0] is not observation or kept[1] != lattice or kept[2] != reach_m:
        return _projected(observation, lattice, reach_m)
    return kept[3]


def _remember(observation: Observation, lattice: Lattice, reach_m: tuple[float, float], beams: Beams) -> None:
    if len(_latest) >= _MOST_KEPT:
        _latest.pop(next(iter(_latest)))
    _latest[id(observation)] = (observation, lattice, reach_m, beams)


def _projected(observation: Observation, lattice: Lattice, reach_m: tuple[float, float]) -> Beams:
    scan = observation.payload
    if not isinstance(scan, Scan):
        return _NO_BEAMS
    beams, kinds = np.empty((scan.ranges_m.size, 4)), np.empty(scan.ranges_m.size, np.uint8)
    fits = rays.project(*_given(scan, observation.T_map_sensor, lattice, reach_m), beams, kinds)
    return Beams(beams, kinds) if fits else _NO_BEAMS


def replace_content(
    layer: GridLayer, observation: Observation, message: GridMessage, thresholds: Thresholds, adopt: bool
) -> GridRegion:
    """Make the layer say what a ready-made map says; returns the cells that it says or said something about.

    With ``adopt`` the layer takes the map's lattice, else a map that lies otherwise is placed on the layer's. What the
    layer has absorbed from others stays. The layer is as before when it raises MapError.
    """
    _require_mapper(layer, READY_MADE, observation)
    _require_valid(message, observation)
    T = observation.T_map_sensor @ message.T_map_origin
    pool, lattice = _placed(message, T, None if adopt else layer.lattice, layer, thresholds)
    before = baking.touched(layer)
    layer.traces.add_pose(observation.T_map_base, layer.observations, lattice)
    layer.lattice = lattice
    old, layer.pool = layer.pool, pool
    for slot, key in enumerate(old.index.keys.tolist()):
        if old.absorbed.of[slot] >= 0:
            here = int(pool.claim(np.array([key], np.int64))[0])
            pool.absorbed.write(here, old.absorbed.tiles[old.absorbed.of[slot]])
    _note(layer, READY_MADE, observation)
    return before.union(baking.touched(layer))


def count_table(model: SensorModel, thresholds: Thresholds) -> CountTable:
    """Hits and misses for each value of a ready-made map, 0 … 100.

    Of all counts that keep the value's class (occupied, free, neither) those whose log-odds come nearest to the
    value's, clamped; of equals the fewest.
    """
    hits = np.arange(thresholds.clamp // model.l_hit + 3)
    misses = np.arange(thresholds.clamp // -model.l_miss + 3)
    # one of the two at most 1: more of both would say that the cell was seen differently at different times
    h = np.concatenate((np.repeat(hits, 2), np.tile((0, 1), misses.size)))
    m = np.concatenate((np.tile((0, 1), hits.size), np.repeat(misses, 2)))
    evidence = h * model.l_hit + m * model.l_miss
    table = np.empty((101, 2), np.uint32)
    for value in range(101):
        wanted = _evidence_of(value, thresholds)
        same = (evidence >= thresholds.occupied) == (wanted >= thresholds.occupied)
        same &= (evidence <= thresholds.free) == (wanted <= thresholds.free)
        off = np.where(same, abs(evidence - wanted), np.inf)
        best = int(np.lexsort((h + m, off))[0])
        table[value] = h[best], m[best]
    return table


def _evidence_of(value: int, thresholds: Thresholds) -> float:
    if value in (0, 100):
        return thresholds.clamp if value else -thresholds.clamp
    return max(-thresholds.clamp, min(thresholds.clamp, log_odds(value / 100.0) * LOG_ODDS_PER_NAT))


def _placed(
    message: GridMessage, T: Transform, lattice: Lattice | None, layer: GridLayer, thresholds: Thresholds
) -> tuple[TilePool, Lattice]:
    """The message's counts on ``lattice``, or on the lattice that fits it best when that is None."""
    table = count_table(layer.sensor_model, thresholds)
    turned = abs(T.yaw_rad) > _STRAIGHT
    fitting, origin = Lattice.through(T.x_m, T.y_m, message.resolution_m)
    if not turned and lattice in (None, fitting):
        return _tiled(message, table, origin), fitting
    loose = GridLayer(Lattice(message.resolution_m), layer.sensor_model, layer.traces.limits)
    loose.pool = _tiled(message, table, (0, 0))
    target = lattice or Lattice(message.resolution_m)
    if not len(loose.pool.index):
        return loose.pool, target
    return place(loose, T, 1.0, target, thresholds).pool, target


def _tiled(message: GridMessage, table: CountTable, origin_cell: tuple[int, int]) -> TilePool:
    """The counts of a message whose cell (0, 0) is ``origin_cell``."""
    (ix, iy), (height, width) = origin_cell, message.cells.shape
    pad_y = (iy % TILE, -(iy + height) % TILE)
    pad_x = (ix % TILE, -(ix + width) % TILE)
    values = np.pad(message.cells, (pad_y, pad_x), constant_values=-1)
    up, across = values.shape[0] // TILE, values.shape[1] // TILE
    tiles = values.reshape(up, TILE, across, TILE).swapaxes(1, 2).reshape(-1, TILE, TILE)
    lookup = np.concatenate((table, np.zeros((1, 2), np.uint32)))  # the last row is for -1
    pool = TilePool()
    for number in np.flatnonzero((tiles >= 0).any(axis=(1, 2))).tolist():
        counts = lookup[tiles[number]]
        key = tile_key(ix // TILE + number % across, iy // TILE + number // across)
        pool.set_counts(np.array([key], np.int64), counts[None, ..., 0], counts[None, ..., 1])
    return pool


def _plain(array: NDArray[np.generic], dtype: type[Cell]) -> NDArray[Cell]:
    """The array itself, or a writable contiguous copy: a kernel is compiled anew for every other kind of array."""
    if array.dtype == dtype and array.flags.c_contiguous and array.flags.writeable:
        return cast("NDArray[Cell]", array)
    return np.array(array, dtype, order="C")


def _require_valid(message: GridMessage, observation: Observation) -> None:
    cells = message.cells
    if not FINEST_M <= message.resolution_m <= COARSEST_M:
        raise MapError(
            f"a map of {observation.robot} has {message.resolution_m} m per cell, from {FINEST_M} to {COARSEST_M} "
            "can be used: check the map's description"
        )
    if cells.ndim != 2 or cells.size > LARGEST_DENSE:
        raise MapError(f"a map of {observation.robot} must have up to {LARGEST_DENSE} cells, found {cells.shape}")
    if cells.size and (cells.min() < -1 or cells.max() > 100):
        raise MapError(
            f"a map of {observation.robot} must hold -1 (unknown) and 0 … 100, found {cells.min()} … {cells.max()}"
        )


def _require_mapper(layer: GridLayer, mapper: str, observation: Observation) -> None:
    if layer.mapper not in ("", mapper):
        raise MapError(
            f"{observation.robot} was mapped from a {layer.mapper.rstrip('s')} before and now sends a "
            f"{mapper.rstrip('s')}: choose one of the two for this robot"
        )
    if layer.observations >= _MOST_LOOKS:
        raise MapError(f"a layer can hold {_MOST_LOOKS} observations: begin a new one")


def _note(layer: GridLayer, mapper: str, observation: Observation) -> None:
    layer.mapper = mapper
    if observation.sensor and observation.sensor not in layer.sensors:
        layer.sensors |= {observation.sensor}
    layer.observations += 1
    layer.version += 1


def _refusal(status: int, observation: Observation) -> str:
    if status == rays.TOO_WIDE:
        return f"the beams of one scan of {observation.robot} start too far from each other: check the beams' poses"
    return f"a scan of {observation.robot} reaches beyond ±{CELL_LIMIT} cells or is not finite: check its pose"
