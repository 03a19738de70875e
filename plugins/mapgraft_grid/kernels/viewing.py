"""From counts to evidence, and from evidence to what a reader sees."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_grid.kernels.tile_keys import TILE, tile_x, tile_y

CELLS = TILE * TILE
EVIDENCE_LIMIT = 1 << 24  # of one source in one cell, 1024 per nat: 16 384 nats, so that 60 sources fit int32


@njit(cache=True)
def _counted(
    hits: NDArray[np.uint16], misses: NDArray[np.uint16], l_hit: np.int32, l_miss: np.int32, out: NDArray[np.int32]
) -> None:
    """The evidence of one tile (4096,) whose counts are narrow; nothing here leaves int32."""
    limit = np.int32(EVIDENCE_LIMIT)
    for cell in range(CELLS):
        value = np.int32(np.int32(hits[cell]) * l_hit + np.int32(misses[cell]) * l_miss)
        out[cell] = min(max(value, -limit), limit)


@njit(cache=True)
def _counted_wide(wide: NDArray[np.uint32], l_hit: int, l_miss: int, out: NDArray[np.int32]) -> None:
    """Add the evidence of wide counts (2, 4096) to a tile (4096,)."""
    for cell in range(CELLS):
        value = np.int64(out[cell]) + np.int64(wide[0, cell]) * l_hit + np.int64(wide[1, cell]) * l_miss
        out[cell] = min(max(value, np.int64(-EVIDENCE_LIMIT)), np.int64(EVIDENCE_LIMIT))


@njit(cache=True)
def _tile(
    slot: int,
    hits: NDArray[np.uint16],
    misses: NDArray[np.uint16],
    wide_of: NDArray[np.int32],
    wide: NDArray[np.uint32],
    absorbed_of: NDArray[np.int32],
    absorbed: NDArray[np.int32],
    model: tuple[int, int],
    out: NDArray[np.int32],
) -> None:
    """The log-odds of one tile into ``out`` (4096,); zero when the slot is -1."""
    if slot < 0:
        out[:] = 0
        return
    _counted(hits[slot].reshape(CELLS), misses[slot].reshape(CELLS), np.int32(model[0]), np.int32(model[1]), out)
    if wide_of[slot] >= 0:
        _counted_wide(wide[wide_of[slot]].reshape(2, CELLS), model[0], model[1], out)
    if absorbed_of[slot] >= 0:
        baked = absorbed[absorbed_of[slot]].reshape(CELLS)
        for cell in range(CELLS):
            out[cell] += baked[cell]


@njit(cache=True)
def evidence(
    slots: NDArray[np.int32],
    hits: NDArray[np.uint16],
    misses: NDArray[np.uint16],
    wide_of: NDArray[np.int32],
    wide: NDArray[np.uint32],
    absorbed_of: NDArray[np.int32],
    absorbed: NDArray[np.int32],
    model: tuple[int, int],
    out: NDArray[np.int32],
) -> None:
    """The log-odds of tiles, 1024 per nat, into ``out`` (k, 64, 64); zero where the slot is -1.

    ``hits`` and ``misses`` (n, 64, 64); ``wide_of`` and ``absorbed_of`` (n,) name the tile in ``wide`` (w, 2, 64, 64)
    and ``absorbed`` (a, 64, 64), or -1; ``model`` is (l_hit, l_miss).
    """
    for i in range(slots.size):
        _tile(slots[i], hits, misses, wide_of, wide, absorbed_of, absorbed, model, out[i].reshape(CELLS))


@njit(cache=True)
def _read(
    own: NDArray[np.int32],
    foreign: NDArray[np.int32],
    clamp: np.int32,
    free: np.int32,
    occupied: np.int32,
    out: NDArray[np.int16],
) -> int:
    """Add, clamp and count the known cells of one tile (4096,); -1 when there is no evidence at all."""
    known, some = np.int32(0), np.int32(0)
    for cell in range(CELLS):
        value = np.int32(own[cell] + foreign[cell])
        value = min(max(value, np.int32(-clamp)), clamp)
        out[cell] = value
        known += np.int32(value <= free) + np.int32(value >= occupied)
        some |= value
    return int(known) if some else -1


@njit(cache=True)
def fuse(
    slots: NDArray[np.int32],
    hits: NDArray[np.uint16],
    misses: NDArray[np.uint16],
    wide_of: NDArray[np.int32],
    wide: NDArray[np.uint32],
    absorbed_of: NDArray[np.int32],
    absorbed: NDArray[np.int32],
    model: tuple[int, int],
    foreign_slots: NDArray[np.int32],
    foreign: NDArray[np.int32],
    limits: tuple[int, int, int],
    out: NDArray[np.int16],
    known: NDArray[np.int32],
) -> None:
    """What a reader sees of tiles: own evidence plus that of others, clamped, into ``out`` (k, 64, 64).

    Own tiles as in ``evidence``; ``foreign`` (f, 64, 64) with its tile for each of the k, or -1; ``limits`` is (clamp,
    free, occupied). ``known`` (k,) counts the free and occupied cells, -1 for a tile without any evidence.
    """
    clamp, free, occupied = np.int32(limits[0]), np.int32(limits[1]), np.int32(limits[2])
    own, nothing = np.empty(CELLS, np.int32), np.zeros(CELLS, np.int32)
    for i in range(slots.size):
        _tile(slots[i], hits, misses, wide_of, wide, absorbed_of, absorbed, model, own)
        others = foreign[foreign_slots[i]].reshape(CELLS) if foreign_slots[i] >= 0 else nothing
        known[i] = _read(own, others, clamp, free, occupied, out[i].reshape(CELLS))


@njit(cache=True)
def assemble(
    keys: NDArray[np.int64], tiles: NDArray[np.int16], origin_x: int, origin_y: int, out: NDArray[np.int32]
) -> None:
    """Copy tiles (k, 64, 64) into the window (h, w) whose element [0, 0] is cell (origin_x, origin_y)."""
    height, width = out.shape
    for i in range(keys.size):
        x0 = tile_x(keys[i]) * TILE - origin_x
        y0 = tile_y(keys[i]) * TILE - origin_y
        for row in range(max(0, -y0), min(TILE, height - y0)):
            for column in range(max(0, -x0), min(TILE, width - x0)):
                out[y0 + row, x0 + column] = tiles[i, row, column]


@njit(cache=True)
def weigh(
    evidence: NDArray[np.int32], weights: NDArray[np.uint8], fill_slots: NDArray[np.int32], fill: NDArray[np.uint64]
) -> None:
    """Multiply tiles (k, 64, 64) by their weights (k,), in place; a weight of 0 leaves the cells of ``fill`` alone.

    ``fill`` (n, 64) rows of bits, with its tile for each of the k, or -1.
    """
    for i in range(weights.size):
        weight = np.int64(weights[i])
        slot = fill_slots[i]
        for row in range(TILE):
            bits = fill[slot, row] if slot >= 0 else np.uint64(0)
            for column in range(TILE):
                factor = weight
                if weight == 0:
                    factor = np.int64((bits >> np.uint64(column)) & np.uint64(1))
                value = np.int64(evidence[i, row, column]) * factor
                value = min(max(value, np.int64(-EVIDENCE_LIMIT)), np.int64(EVIDENCE_LIMIT))
                evidence[i, row, column] = value


@njit(cache=True)
def add_tiles(slots: NDArray[np.int32], tiles: NDArray[np.int32], pool: NDArray[np.int32]) -> None:
    """Add tiles (k, 64, 64) to those of a pool (n, 64, 64)."""
    for i in range(slots.size):
        for row in range(TILE):
            for column in range(TILE):
                pool[slots[i], row, column] += tiles[i, row, column]


@njit(cache=True)
def classify(log_odds: NDArray[np.int32], free: int, occupied: int) -> NDArray[np.uint8]:
    """0 unknown, 1 free (≤ ``free``), 2 occupied (≥ ``occupied``); same shape (h, w)."""
    out = np.empty(log_odds.shape, np.uint8)
    for row in range(log_odds.shape[0]):
        for column in range(log_odds.shape[1]):
            value = log_odds[row, column]
            out[row, column] = np.uint8(value <= free) + np.uint8(2) * np.uint8(value >= occupied)
    return out
