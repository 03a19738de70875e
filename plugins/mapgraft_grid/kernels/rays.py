"""Which cells the beams of one scan pass through and end in: an exact grid traversal on rows of 64 bits.

A beam covers one contiguous run of cells in every row it crosses (Amanatides and Woo 1987 walk the same cells one by
one). Setting a run is one OR on a 64-bit word, so a beam costs as much as the rows it crosses, and a cell that several
beams of the scan cross is counted once without asking.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_grid.kernels.tile_keys import TILE, tile_key

CELL_LIMIT = float((1 << 30) - 1)  # cells beyond ± this are refused
TILES_WIDE = 1 << 15  # a scan may not spread over more tiles than this in x or y
_ALL = np.uint64(0xFFFFFFFFFFFFFFFF)
_BAND_WORDS = 1 << 18  # the bits of one pass: 2 MB, about a second-level cache

OK = 0
OUT_OF_REACH = 1  # a beam starts or ends beyond the limit, or is not finite
TOO_WIDE = 2

NO_BEAM = 0
FREE_END = 1
HIT_END = 2


@njit(cache=True)
def _snapped(cells: float) -> float:
    """The nearest multiple of 2⁻²⁰ cell, so that taking whole tiles away rounds nothing, at any distance."""
    return float(np.floor(cells * (1 << 20) + 0.5)) / (1 << 20)


@njit(cache=True)
def project(
    directions: NDArray[np.float64],
    ranges_m: NDArray[np.float32],
    hits: NDArray[np.bool_],
    beam_poses: NDArray[np.float64],
    T: NDArray[np.float64],
    lattice: tuple[float, float, float],
    reach: tuple[float, float],
    beams: NDArray[np.float64],
    kinds: NDArray[np.uint8],
) -> bool:
    """Fill ``beams`` (n, 4) with x0, y0, x1, y1 in cells and ``kinds`` (n,); False when a beam is out of reach."""
    resolution, anchor_x, anchor_y = lattice
    max_range, free_range = reach
    here_x, here_y = (T[0, 3] - anchor_x) / resolution, (T[1, 3] - anchor_y) / resolution
    for i in range(ranges_m.size):
        kinds[i] = NO_BEAM
        length = float(ranges_m[i])
        if not length >= 0.0:
            continue
        kind = HIT_END
        if not hits[i] or length > max_range:
            kind = FREE_END
            length = min(length, free_range)
        ex, ey = directions[i, 0] * length, directions[i, 1] * length
        x0, y0 = here_x, here_y
        if beam_poses.shape[0] > 0:
            c, s = np.cos(beam_poses[i, 2]), np.sin(beam_poses[i, 2])
            sx, sy = beam_poses[i, 0], beam_poses[i, 1]
            ex, ey = c * ex - s * ey + sx, s * ex + c * ey + sy
            x0 += (T[0, 0] * sx + T[0, 1] * sy) / resolution
            y0 += (T[1, 0] * sx + T[1, 1] * sy) / resolution
        x1 = here_x + (T[0, 0] * ex + T[0, 1] * ey) / resolution
        y1 = here_y + (T[1, 0] * ex + T[1, 1] * ey) / resolution
        farthest = max(abs(x0), abs(y0), abs(x1), abs(y1))
        if not farthest < CELL_LIMIT or np.isnan(x0 + y0 + x1 + y1):
            return False
        beams[i, 0], beams[i, 1], beams[i, 2], beams[i, 3] = _snapped(x0), _snapped(y0), _snapped(x1), _snapped(y1)
        kinds[i] = kind
    return True


@njit(cache=True)
def _tile_box(beams: NDArray[np.float64], kinds: NDArray[np.uint8]) -> tuple[int, int, int, int]:
    """The tiles that hold all beams: first x, first y, count in x, count in y; no count without a beam."""
    x0 = y0 = CELL_LIMIT
    x1 = y1 = -CELL_LIMIT
    for i in range(kinds.size):
        if kinds[i] != NO_BEAM:
            x0 = min(x0, beams[i, 0], beams[i, 2])
            x1 = max(x1, beams[i, 0], beams[i, 2])
            y0 = min(y0, beams[i, 1], beams[i, 3])
            y1 = max(y1, beams[i, 1], beams[i, 3])
    if x1 < x0:
        return 0, 0, 0, 0
    first_x, first_y = int(np.floor(x0 / TILE)), int(np.floor(y0 / TILE))
    return first_x, first_y, int(np.floor(x1 / TILE)) - first_x + 1, int(np.floor(y1 / TILE)) - first_y + 1


@njit(cache=True, inline="always")
def _set_run(words: NDArray[np.uint64], at: np.uint64, first: np.uint64, last: np.uint64) -> None:
    """Set the cells first … last of one row; ``at`` is the word of the row in the band's first tile column."""
    word, end = first >> np.uint64(6), last >> np.uint64(6)
    low = _ALL << (first & np.uint64(63))
    high = _ALL >> (np.uint64(63) - (last & np.uint64(63)))
    if word == end:
        words[at + (word << np.uint64(6))] |= low & high
    else:
        words[at + (word << np.uint64(6))] |= low
        word += np.uint64(1)
        while word < end:
            words[at + (word << np.uint64(6))] = _ALL
            word += np.uint64(1)
        words[at + (end << np.uint64(6))] |= high


@njit(cache=True)
def _draw(
    words: NDArray[np.uint64], width: int, x0: float, y0: float, x1: float, y1: float, first_row: int, end_row: int
) -> None:
    """Set all cells of one beam in the rows first_row … end_row - 1; coordinates in cells, not negative."""
    if y1 < y0:
        x0, y0, x1, y1 = x1, y1, x0, y0
    row0, row1 = int(y0), int(y1)
    if row0 >= end_row or row1 < first_row:
        return
    start, stop = max(row0, first_row), min(row1, end_row)  # in start … stop - 1 the beam leaves by the upper edge
    slope = (x1 - x0) / (y1 - y0) if row1 > row0 else 0.0
    right = x1 >= x0
    enter, last = int(x0), int(x1)
    if start > row0:
        enter = int(x0 + (start - y0) * slope)
        enter = min(enter, last) if right else max(enter, last)
    stride = width << 6
    if right:
        for row in range(start, stop):
            leave = min(int(x0 + (row + 1 - y0) * slope), last)
            at = ((row - first_row) >> 6) * stride + (row & 63)
            _set_run(words, np.uint64(at), np.uint64(enter), np.uint64(leave))
            enter = leave
    else:
        for row in range(start, stop):
            leave = max(int(x0 + (row + 1 - y0) * slope), last)
            at = ((row - first_row) >> 6) * stride + (row & 63)
            _set_run(words, np.uint64(at), np.uint64(leave), np.uint64(enter))
            enter = leave
    if row1 < end_row:
        at = ((row1 - first_row) >> 6) * stride + (row1 & 63)
        _set_run(words, np.uint64(at), np.uint64(min(enter, last)), np.uint64(max(enter, last)))


@njit(cache=True)
def _number_tiles(words: NDArray[np.uint64], tiles: int, numbers: NDArray[np.int32]) -> int:
    """Number the tiles of the band that hold any bit, in order; -1 for the others. Returns how many there are."""
    count = 0
    for tile in range(tiles):
        any_bit = np.uint64(0)
        for row in range(TILE):
            any_bit |= words[tile * TILE + row]
        numbers[tile] = -1
        if any_bit:
            numbers[tile] = count
            count += 1
    return count


@njit(cache=True)
def _band(
    beams: NDArray[np.float64],
    kinds: NDArray[np.uint8],
    box: tuple[int, int, int],
    first_tile: int,
    height: int,
    words: NDArray[np.uint64],
) -> tuple[NDArray[np.int64], NDArray[np.uint64], NDArray[np.uint64]]:
    """The cells of one band of tile rows; ``box`` is the first tile in x and y and the width in tiles."""
    base_x, base_y, width = box
    x, y = float(base_x * TILE), float(base_y * TILE)
    words[: width * height * TILE] = 0
    first_row = first_tile * TILE
    for i in range(kinds.size):
        if kinds[i] != NO_BEAM:
            x0, y0, x1, y1 = beams[i, 0] - x, beams[i, 1] - y, beams[i, 2] - x, beams[i, 3] - y
            _draw(words, width, x0, y0, x1, y1, first_row, first_row + height * TILE)
    numbers = np.empty(width * height, np.int32)
    count = _number_tiles(words, width * height, numbers)
    keys = np.empty(count, np.int64)
    free = np.empty((count, TILE), np.uint64)
    hit = np.zeros((count, TILE), np.uint64)
    for tile in range(width * height):
        n = numbers[tile]
        if n >= 0:
            keys[n] = tile_key(base_x + tile % width, base_y + first_tile + tile // width)
            for row in range(TILE):
                free[n, row] = words[tile * TILE + row]
    for i in range(kinds.size):
        if kinds[i] == HIT_END:
            column, row = int(beams[i, 2] - x), int(beams[i, 3] - y) - first_row
            if 0 <= row < height * TILE:
                n = numbers[(row >> 6) * width + (column >> 6)]
                bit = np.uint64(1) << np.uint64(column & 63)
                hit[n, row & 63] |= bit
                free[n, row & 63] &= ~bit
    return keys, free, hit


@njit(cache=True)
def cast(
    directions: NDArray[np.float64],
    ranges_m: NDArray[np.float32],
    hits: NDArray[np.bool_],
    beam_poses: NDArray[np.float64],
    T_map_sensor: NDArray[np.float64],
    lattice: tuple[float, float, float],
    reach: tuple[float, float],
    first: int,
    beams: NDArray[np.float64],
    kinds: NDArray[np.uint8],
) -> tuple[int, int, NDArray[np.int64], NDArray[np.uint64], NDArray[np.uint64]]:
    """The cells that one scan sees free and hit, each once, a hit winning over a miss.

    ``directions`` (n, 2), ``ranges_m`` (n,), ``hits`` (n,) and ``beam_poses`` (0, 3) or (n, 3) as in a Scan;
    ``lattice`` is (resolution, anchor x, anchor y) and ``reach`` (max_range, free_range), all in metres. A beam that
    hit nothing, or only beyond ``max_range``, is free up to ``free_range`` at most.

    Fills ``beams`` (n, 4) with start and end in cells and ``kinds`` (n,). Returns a status, the ``first`` to go on with
    (0 when all is done, as for nearly every scan), the touched tiles' keys (k,) in ascending order, and for each the
    free and the hit cells (k, 64): one word per row, lowest bit = lowest x.
    """
    status, box, height = OK, (0, 0, 0), 0
    if not project(directions, ranges_m, hits, beam_poses, T_map_sensor, lattice, reach, beams, kinds):
        status = OUT_OF_REACH
    else:
        base_x, base_y, width, height = _tile_box(beams, kinds)
        box = (base_x, base_y, width)
        if width > TILES_WIDE or height > TILES_WIDE:
            status = TOO_WIDE
    if status != OK:
        height = 0
    step = min(height - first, max(1, _BAND_WORDS // max(1, box[2] * TILE)))
    words = np.empty(box[2] * max(0, step) * TILE, np.uint64)
    keys, free, hit = _band(beams, kinds, box, first, max(0, step), words)
    return status, (first + step if first + step < height else 0), keys, free, hit
