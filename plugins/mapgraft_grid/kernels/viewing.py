"""From counts to evidence, and from evidence to what a reader sees."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_grid.kernels.tile_keys import TILE, tile_x, tile_y

EVIDENCE_LIMIT = 1 << 25  # of one source in one cell, 1024 per nat: 32 768 nats, so that 60 sources fit int32


@njit(cache=True)
def _clipped(value: np.int64, limit: int) -> np.int64:
    if value > limit:
        return np.int64(limit)
    if value < -limit:
        return np.int64(-limit)
    return value


@njit(cache=True)
def evidence(
    slots: NDArray[np.int32],
    hits: NDArray[np.uint16],
    misses: NDArray[np.uint16],
    wide_of: NDArray[np.int32],
    wide: NDArray[np.uint32],
    absorbed_of: NDArray[np.int32],
    absorbed: NDArray[np.int32],
    l_hit: int,
    l_miss: int,
    out: NDArray[np.int32],
) -> None:
    """The log-odds of tiles, 1024 per nat, into ``out`` (k, 64, 64); zero where the slot is -1."""
    for i in range(slots.size):
        slot = slots[i]
        if slot < 0:
            out[i] = 0
            continue
        base = wide_of[slot]
        extra = absorbed_of[slot]
        for row in range(TILE):
            for column in range(TILE):
                h, m = np.int64(hits[slot, row, column]), np.int64(misses[slot, row, column])
                if base >= 0:
                    h += wide[base, 0, row, column]
                    m += wide[base, 1, row, column]
                value = _clipped(h * l_hit + m * l_miss, EVIDENCE_LIMIT)
                if extra >= 0:
                    value += absorbed[extra, row, column]
                out[i, row, column] = value


@njit(cache=True)
def read(
    own: NDArray[np.int32],
    foreign_slots: NDArray[np.int32],
    foreign: NDArray[np.int32],
    clamp: int,
    free: int,
    occupied: int,
    out: NDArray[np.int16],
    known: NDArray[np.int32],
) -> None:
    """Add what other sources say, clamp, and count the known cells of each tile.

    ``own`` (k, 64, 64) log-odds; ``foreign`` (n, 64, 64) with its tile for each of the k, or -1; ``out`` (k, 64, 64);
    ``known`` (k,), -1 for a tile
    without any evidence.
    """
    for i in range(own.shape[0]):
        slot = foreign_slots[i]
        count = np.int64(0)
        some = np.int64(0)
        for row in range(TILE):
            for column in range(TILE):
                value = np.int64(own[i, row, column])
                if slot >= 0:
                    value += foreign[slot, row, column]
                value = _clipped(value, clamp)
                out[i, row, column] = value
                count += (value <= free) | (value >= occupied)
                some |= value
        known[i] = count if some else -1


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
                evidence[i, row, column] = _clipped(value, EVIDENCE_LIMIT)


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
