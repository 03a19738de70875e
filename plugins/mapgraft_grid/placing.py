"""Placing a layer in another frame and resolution, by exact arithmetic."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import EmptyMapError, MapError, Transform
from mapgraft_grid.kernels import placing, sketch
from mapgraft_grid.kernels.tile_keys import TILE, tile_key, tile_x, tile_y
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.parameters import CELL_LIMIT, Lattice, Thresholds
from mapgraft_grid.tiles import TileKeys
from mapgraft_grid.traces import YAW_STEPS_PER_RAD, Pose

NEAREST: Final = "nearest/1"  # target cells no coarser than the source's: the source cell at the target cell's centre
CENTRES: Final = "centres/1"  # coarser ones: every source cell goes where its centre lies

_MOST_RATIO: Final = 4096  # between two resolutions
_MOST_TILES: Final = 1 << 16  # of a placed layer: 1 GB of counts
_AT_ONCE: Final = 256  # target tiles per call: 8 MB of counts
_EXACT: Final = 80  # binary places of a cell map's coefficients
_STEPS: Final = 2 * sketch.STEPS_PER_CELL  # of a cell: what positions are given in, so that centres are whole
_CELL: Final = 1 << placing.PLACES


class CellMap:
    """A planar map of cells to cells in integers: p ← linear · p + shift."""

    __slots__ = ("_linear", "_shift")

    def __init__(self, linear: tuple[tuple[Fraction, Fraction], ...], shift: tuple[Fraction, Fraction]) -> None:
        self._linear = [round(value * (1 << _EXACT)) for row in linear for value in row]
        self._shift = [round(value * (1 << _EXACT)) * _STEPS for value in shift]

    def __call__(self, x: int, y: int) -> tuple[int, int]:
        """Where a position, in 1/512 cell, comes to lie: in cells with 32 binary places, rounded down."""
        a, b, c, d = self._linear
        right = _EXACT - placing.PLACES + _STEPS.bit_length() - 1
        return (a * x + b * y + self._shift[0]) >> right, (c * x + d * y + self._shift[1]) >> right

    def linear(self) -> NDArray[np.int64]:
        """The linear part (2, 2) with 32 binary places."""
        places = _EXACT - placing.PLACES
        fixed = [(value + (1 << (places - 1))) >> places for value in self._linear]
        return np.array(fixed, np.int64).reshape(2, 2)

    def floats(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The linear part (2, 2) and the shift (2,) in cells."""
        linear = np.array([value / (1 << _EXACT) for value in self._linear]).reshape(2, 2)
        return linear, np.array([value / (_STEPS << _EXACT) for value in self._shift])


def resampler(source_m: float, target_m: float, scale: float = 1.0) -> str:
    """The name of the rule by which cells of ``source_m``, stretched by ``scale``, come to cells of ``target_m``."""
    return CENTRES if Fraction(target_m) > Fraction(source_m) * Fraction(scale) else NEAREST


def place(
    layer: GridLayer, T_receiver_donor: Transform, scale: float, lattice: Lattice, thresholds: Thresholds
) -> GridLayer:
    """The layer's counts and traces on another lattice, after scaling by ``scale`` and moving by the snapped transform.

    Raises EmptyMapError when the layer holds nothing, MapError when it cannot be placed.
    """
    _require_placeable(layer, T_receiver_donor, scale, lattice)
    T = T_receiver_donor.snapped()
    forward, backward = _cell_maps(layer.lattice, lattice, T, Fraction(scale))
    keys = np.sort(layer.pool.index.keys)
    hits, misses = layer.pool.counts(keys)
    some = (hits | misses).any(axis=(1, 2))
    keys, hits, misses = keys[some], hits[some], misses[some]
    if not keys.size:
        raise EmptyMapError("a layer without any evidence was to be placed: wait until its robot has mapped something")
    out = GridLayer(lattice, layer.sensor_model, layer.traces.limits)
    out.observations, out.sensors, out.mapper = layer.observations, layer.sensors, layer.mapper
    coarser = resampler(layer.lattice.resolution_m, lattice.resolution_m, scale) == CENTRES
    model = (layer.sensor_model.l_hit, layer.sensor_model.l_miss, thresholds.occupied)
    targets = _target_tiles(keys, forward)
    for first in range(0, targets.size, _AT_ONCE):
        part = targets[first : first + _AT_ONCE]
        placed = np.empty((2, part.size, TILE, TILE), np.uint32)
        placing.nearest(keys, hits, misses, backward.linear(), _starts(part, backward), placed[0], placed[1])
        if coarser:
            rectangle = _rectangles(part, forward, backward)
            placing.centres(keys, hits, misses, model, forward.linear(), *rectangle, placed[0], placed[1])
        filled = (placed[0] | placed[1]).any(axis=(1, 2))
        out.pool.set_counts(part[filled], placed[0, filled], placed[1, filled])
    _place_traces(layer, out, forward, T.yaw_rad)
    return out


def _require_placeable(layer: GridLayer, T: Transform, scale: float, lattice: Lattice) -> None:
    if len(layer.pool.absorbed):
        raise MapError("a layer that has absorbed other sources cannot be given away: offer the one from before")
    if not 0 < scale < math.inf:
        raise MapError(f"the scale of a placement must be above 0, found {scale}")
    ratio = lattice.resolution_m / (layer.lattice.resolution_m * scale)
    if not 1 / _MOST_RATIO <= ratio <= _MOST_RATIO:
        raise MapError(
            f"cells of {layer.lattice.resolution_m * scale:.3g} m cannot be placed on cells of {lattice.resolution_m} "
            f"m: resolutions may differ {_MOST_RATIO} times at most"
        )
    if not np.isfinite(T.matrix).all() or abs(T.matrix[2, 2] - 1.0) > 1e-6:
        raise MapError(f"a grid can only be turned in its plane, found {T}: give a planar transform")


def _cell_maps(source: Lattice, target: Lattice, T: Transform, scale: Fraction) -> tuple[CellMap, CellMap]:
    """From source cells to target cells and back, exact; the rotation is inverted by transposing it."""
    c, s = Fraction(T.matrix.item(0, 0)), Fraction(T.matrix.item(1, 0))
    tx, ty = Fraction(T.x_m), Fraction(T.y_m)
    ax, ay = (Fraction(value) for value in source.anchor_m)
    bx, by = (Fraction(value) for value in target.anchor_m)
    fine, coarse = Fraction(source.resolution_m) * scale, Fraction(target.resolution_m)
    k = fine / coarse
    forward = CellMap(
        ((c * k, -s * k), (s * k, c * k)),
        (
            (scale * (c * ax - s * ay) + tx - bx) / coarse,
            (scale * (s * ax + c * ay) + ty - by) / coarse,
        ),
    )
    dx, dy = bx - tx, by - ty
    backward = CellMap(
        ((c / k, s / k), (-s / k, c / k)),
        ((c * dx + s * dy) / fine - ax * scale / fine, (c * dy - s * dx) / fine - ay * scale / fine),
    )
    return forward, backward


def _target_tiles(keys: TileKeys, forward: CellMap) -> TileKeys:
    """The tiles that the source tiles can reach, ascending; perhaps some more."""
    linear, shift = forward.floats()
    corners = TILE * np.array([(tile_x(key), tile_y(key)) for key in keys.tolist()], np.float64)
    low = np.minimum(linear, 0).sum(axis=1) * TILE - 2
    high = np.maximum(linear, 0).sum(axis=1) * TILE + 2
    moved = np.stack((corners @ linear[0], corners @ linear[1]), axis=1) + shift
    if not (abs(moved) < CELL_LIMIT / 2).all():
        raise MapError(f"a placed layer would reach beyond ±{CELL_LIMIT // 2} cells: check the transform")
    first = np.floor((moved + low) / TILE).astype(np.int64)
    last = np.floor((moved + high) / TILE).astype(np.int64)
    if (last - first + 1).prod(axis=1).sum() > 16 * _MOST_TILES:
        raise MapError(_too_large(forward))
    reached = {
        tile_key(x, y)
        for (x0, y0), (x1, y1) in zip(first.tolist(), last.tolist(), strict=True)
        for x in range(x0, x1 + 1)
        for y in range(y0, y1 + 1)
    }
    if len(reached) > _MOST_TILES:
        raise MapError(_too_large(forward))
    return np.array(sorted(reached), np.int64)


def _too_large(forward: CellMap) -> str:
    finer = float(np.linalg.norm(forward.floats()[0][:, 0]))
    return (
        f"a layer placed on cells {finer:.3g} times as fine would fill more than {_MOST_TILES} tiles: "
        "take a coarser resolution"
    )


def _starts(keys: TileKeys, backward: CellMap) -> NDArray[np.int64]:
    """Where the centre of each target tile's first cell lies in the source (k, 2), with 32 binary places."""
    half, side = _STEPS // 2, TILE * _STEPS
    return np.array([backward(side * tile_x(key) + half, side * tile_y(key) + half) for key in keys.tolist()], np.int64)


def _rectangles(
    keys: TileKeys, forward: CellMap, backward: CellMap
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The source cells that can lie in each target tile: first cells (k, 2), where they come to lie, and the size."""
    reach = (abs(backward.linear()).sum(axis=1) * (TILE // 2) // _CELL + 2).tolist()
    half, side = _STEPS // 2, TILE * _STEPS
    firsts, places = [], []
    for key in keys.tolist():
        across, up = tile_x(key), tile_y(key)
        x, y = backward(side * across + side // 2, side * up + side // 2)
        first = (x // _CELL - reach[0], y // _CELL - reach[1])
        at = forward(_STEPS * first[0] + half, _STEPS * first[1] + half)
        firsts.append(first)
        places.append((at[0] - across * TILE * _CELL, at[1] - up * TILE * _CELL))
    return np.array(firsts, np.int64), np.array(places, np.int64), 2 * np.array(reach, np.int64) + 1


def _place_traces(layer: GridLayer, out: GridLayer, forward: CellMap, yaw_rad: float) -> None:
    keys, rows = layer.traces.ray_rows()
    out.traces.insert_rays(*placing.move_rays(keys, rows, *forward.floats()))
    turn = round(yaw_rad * YAW_STEPS_PER_RAD)
    to_step = _CELL // sketch.STEPS_PER_CELL
    for pose in layer.traces.poses():
        x, y = forward(2 * pose.x + 1, 2 * pose.y + 1)
        out.traces.insert_pose(Pose(pose.number, x // to_step, y // to_step, pose.yaw + turn))
