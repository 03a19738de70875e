"""Sets of cells as sorted tile keys with 64 words of bits each."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_grid.kernels.tile_keys import TILE, tile_key, tile_x, tile_y


@njit(cache=True)
def union(
    keys_a: NDArray[np.int64], rows_a: NDArray[np.uint64], keys_b: NDArray[np.int64], rows_b: NDArray[np.uint64]
) -> tuple[NDArray[np.int64], NDArray[np.uint64]]:
    """The cells in a or b; keys sorted, no two equal."""
    keys = np.empty(keys_a.size + keys_b.size, np.int64)
    rows = np.empty((keys.size, TILE), np.uint64)
    a = b = n = 0
    while a < keys_a.size or b < keys_b.size:
        in_a = a < keys_a.size and (b == keys_b.size or keys_a[a] <= keys_b[b])
        in_b = b < keys_b.size and (a == keys_a.size or keys_b[b] <= keys_a[a])
        keys[n] = keys_a[a] if in_a else keys_b[b]
        for row in range(TILE):
            rows[n, row] = (rows_a[a, row] if in_a else np.uint64(0)) | (rows_b[b, row] if in_b else np.uint64(0))
        a += in_a
        b += in_b
        n += 1
    return keys[:n], rows[:n]


@njit(cache=True)
def meet(
    keys_a: NDArray[np.int64],
    rows_a: NDArray[np.uint64],
    keys_b: NDArray[np.int64],
    rows_b: NDArray[np.uint64],
    without: bool,
) -> tuple[NDArray[np.int64], NDArray[np.uint64]]:
    """The cells in a that are in b, or with ``without`` the cells in a that are not in b; empty tiles left out."""
    keys = np.empty(keys_a.size, np.int64)
    rows = np.empty((keys_a.size, TILE), np.uint64)
    b = n = 0
    for a in range(keys_a.size):
        while b < keys_b.size and keys_b[b] < keys_a[a]:
            b += 1
        both = b < keys_b.size and keys_b[b] == keys_a[a]
        some = np.uint64(0)
        for row in range(TILE):
            other = rows_b[b, row] if both else np.uint64(0)
            rows[n, row] = rows_a[a, row] & (~other if without else other)
            some |= rows[n, row]
        if some:
            keys[n] = keys_a[a]
            n += 1
    return keys[:n], rows[:n]


@njit(cache=True)
def share(
    keys_a: NDArray[np.int64], rows_a: NDArray[np.uint64], keys_b: NDArray[np.int64], rows_b: NDArray[np.uint64]
) -> bool:
    """Whether any cell is in both a and b."""
    b = 0
    for a in range(keys_a.size):
        while b < keys_b.size and keys_b[b] < keys_a[a]:
            b += 1
        if b == keys_b.size:
            return False
        if keys_b[b] == keys_a[a]:
            for row in range(TILE):
                if rows_a[a, row] & rows_b[b, row]:
                    return True
    return False


@njit(cache=True)
def population(rows: NDArray[np.uint64]) -> int:
    """How many bits are set in (k, 64) words (Warren, Hacker's Delight, figure 5-2)."""
    total = np.uint64(0)
    for tile in range(rows.shape[0]):
        for row in range(TILE):
            x = rows[tile, row]
            x = x - ((x >> np.uint64(1)) & np.uint64(0x5555555555555555))
            x = (x & np.uint64(0x3333333333333333)) + ((x >> np.uint64(2)) & np.uint64(0x3333333333333333))
            x = (x + (x >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
            total += (x * np.uint64(0x0101010101010101)) >> np.uint64(56)
    return int(np.int64(total))


@njit(cache=True)
def to_mask(
    keys: NDArray[np.int64], rows: NDArray[np.uint64], origin_x: int, origin_y: int, mask: NDArray[np.bool_]
) -> None:
    """Set the cells of the window whose element [0, 0] is cell (origin_x, origin_y); what lies outside is left out."""
    height, width = mask.shape
    for i in range(keys.size):
        x0 = tile_x(keys[i]) * TILE - origin_x
        y0 = tile_y(keys[i]) * TILE - origin_y
        for row in range(max(0, -y0), min(TILE, height - y0)):
            for column in range(max(0, -x0), min(TILE, width - x0)):
                if (rows[i, row] >> np.uint64(column)) & np.uint64(1):
                    mask[y0 + row, x0 + column] = True


@njit(cache=True)
def from_mask(mask: NDArray[np.bool_], origin_x: int, origin_y: int) -> tuple[NDArray[np.int64], NDArray[np.uint64]]:
    """The set cells of a window whose element [0, 0] is cell (origin_x, origin_y)."""
    height, width = mask.shape
    first_x, first_y = origin_x >> 6, origin_y >> 6
    across = ((origin_x + width - 1) >> 6) - first_x + 1
    up = ((origin_y + height - 1) >> 6) - first_y + 1
    words = np.zeros((across * up, TILE), np.uint64)
    for y in range(height):
        cy = origin_y + y
        for x in range(width):
            if mask[y, x]:
                cx = origin_x + x
                tile = ((cy >> 6) - first_y) * across + (cx >> 6) - first_x
                words[tile, cy & 63] |= np.uint64(1) << np.uint64(cx & 63)
    keys = np.empty(across * up, np.int64)
    n = 0
    for tile in range(across * up):
        some = np.uint64(0)
        for row in range(TILE):
            some |= words[tile, row]
            words[n, row] = words[tile, row]
        if some:
            keys[n] = tile_key(first_x + tile % across, first_y + tile // across)
            n += 1
    return keys[:n], words[:n]
