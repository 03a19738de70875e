"""How good a grid is, window by window: near 1 where its walls are true, falling as they lie 0.1 m off and more."""

from __future__ import annotations

import functools
import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_grid.grid_map import OCCUPIED, DenseGrid
from mapgraft_grid.quality_features import FEATURES, SPECKLE_CELLS, feature_shares, reach_cells

STRIDE_M: Final = 1.0  # a window is two strides wide, so that windows overlap by half
WALL_MIN_M: Final = 1.0  # with less wall than this a window cannot be judged
MOST_WINDOWS: Final = 4_000_000
PIECE_CELLS: Final = 4_000_000  # looked at in one piece; larger grids in squares of SIDE_CELLS
SIDE_CELLS: Final = 1024
MODEL_FILE: Final = Path(__file__).parent / "quality_model.json"

_WALL: Final = "wall"

Windows = NDArray[np.float64]  # (rows, columns) one value per window


@dataclass(frozen=True, slots=True)
class QualityModel:
    """quality = logistic(intercept + Σ weight · √feature), fitted on simulated degradations."""

    intercept: float
    weights: Mapping[str, float]

    @classmethod
    def load(cls, path: Path = MODEL_FILE) -> QualityModel:
        given = json.loads(path.read_text(encoding="utf-8"))
        return cls(given["intercept"], given["weights"])

    def quality(self, features: Mapping[str, Windows]) -> Windows:
        logit = self.intercept + sum(self.weights[name] * np.sqrt(features[name]) for name in FEATURES)
        out: Windows = 1.0 / (1.0 + np.exp(-logit))
        return out


@functools.cache
def shipped_model() -> QualityModel:
    """The model that comes with the package."""
    return QualityModel.load()


class Piece(NamedTuple):
    """A part of a grid's array, and the block that it begins in."""

    rows: slice
    columns: slice
    row: int
    column: int


@dataclass(frozen=True, slots=True)
class WindowLayout:
    """Windows 2 m wide and 1 m apart, on blocks of ``block_cells`` cells of a grid's lattice.

    Window (row, column) covers the blocks ``first_block`` + (column, row) and the next ones to the right and above;
    ``offset`` (x, y) is how many cells inside the first block the grid's array begins.
    """

    block_cells: int
    first_block: tuple[int, int]
    offset: tuple[int, int]

    @classmethod
    def of(cls, grid: DenseGrid) -> WindowLayout:
        """The windows that hold a cell of the grid."""
        block = max(1, round(STRIDE_M / grid.resolution_m))
        x, y = grid.origin_cell
        first = (x // block - 1, y // block - 1)
        return cls(block, first, (x - first[0] * block, y - first[1] * block))

    def shape(self, height: int, width: int) -> tuple[int, int]:
        """How many rows and columns of blocks a grid of that size takes, and one more of each."""
        x, y = self.offset
        return -(-(height + y) // self.block_cells) + 1, -(-(width + x) // self.block_cells) + 1

    def sums(self, cells: NDArray[np.generic]) -> Windows:
        """The sums of cells (h, w) over all windows."""
        (height, width), blocks = cells.shape, np.zeros(self.shape(*cells.shape))
        for piece in self.pieces(height, width):
            self.add(blocks, cells[piece.rows, piece.columns], piece)
        return of_windows(blocks)

    def pieces(self, height: int, width: int) -> Iterator[Piece]:
        """The grid in pieces of whole blocks, one where it is small: what is asked of cells takes much memory."""
        x, y = self.offset
        whole = max(height + y, width + x)
        side = whole if height * width <= PIECE_CELLS else self.block_cells * max(SIDE_CELLS // self.block_cells, 1)
        for top in range(0, height + y, side):
            for left in range(0, width + x, side):
                rows, columns = _clipped(top, side, y, height), _clipped(left, side, x, width)
                if rows.start < rows.stop and columns.start < columns.stop:
                    yield Piece(rows, columns, top // self.block_cells, left // self.block_cells)

    def add(self, blocks: Windows, cells: NDArray[np.generic], piece: Piece) -> None:
        """Put the sums of a piece's cells where its blocks are."""
        block, (height, width) = self.block_cells, cells.shape
        above = piece.rows.start + self.offset[1] - block * piece.row
        before = piece.columns.start + self.offset[0] - block * piece.column
        rows, columns = -(-(height + above) // block), -(-(width + before) // block)
        padded = np.zeros((rows * block, columns * block))
        padded[above : above + height, before : before + width] = cells
        sums = padded.reshape(rows, block, columns, block).sum(axis=(1, 3))
        blocks[piece.row : piece.row + rows, piece.column : piece.column + columns] = sums


def of_windows(blocks: Windows) -> Windows:
    """The sums over windows, each of two by two blocks."""
    out: Windows = blocks[:-1, :-1] + blocks[1:, :-1] + blocks[:-1, 1:] + blocks[1:, 1:]
    return out


@dataclass(frozen=True, slots=True, eq=False)
class WindowQuality:
    """The windows of one map.

    ``quality`` (rows, columns) is NaN where there is too little wall; ``wall_m`` is the number of occupied cells times
    their size.
    """

    quality: Windows
    wall_m: Windows
    layout: WindowLayout

    def mean(self) -> float:
        """The quality of the map: the mean over its windows, weighted by wall; NaN when no window can be judged."""
        judged = ~np.isnan(self.quality)
        weight = self.wall_m[judged]
        return float((self.quality[judged] * weight).sum() / weight.sum()) if weight.size else math.nan


def window_quality(
    grid: DenseGrid, measured_m: float | None = None, model: QualityModel | None = None
) -> WindowQuality:
    """The quality of every window of the grid.

    ``measured_m`` is the resolution at which the evidence was gathered, where the grid was resampled from another.
    """
    layout = WindowLayout.of(grid)
    features, wall_m = window_features(grid, layout, measured_m)
    quality = (model or shipped_model()).quality(features)
    quality[wall_m < WALL_MIN_M] = np.nan
    return WindowQuality(quality, wall_m, layout)


def window_features(
    grid: DenseGrid, layout: WindowLayout, measured_m: float | None = None
) -> tuple[dict[str, Windows], Windows]:
    """The features (``FEATURES``) of every window, and its metres of wall; MapError when there are too many windows."""
    height, width = grid.classes.shape
    rows, columns = layout.shape(height, width)
    if rows * columns > MOST_WINDOWS:
        raise MapError(f"a grid of {width} × {height} cells of {grid.resolution_m:g} m is too wide to be judged")
    blocks = defaultdict[tuple[str, int], Windows](lambda: np.zeros((rows, columns)))
    for piece in layout.pieces(height, width):
        for name, share in _shares(grid, piece).items():
            for part, cells in enumerate(share):
                layout.add(blocks[name, part], cells, piece)
    sums = {key: of_windows(found) for key, found in blocks.items()}
    features = {name: _ratio(sums[name, 0], sums[name, 1]) for name in FEATURES if name != "resolution_m"}
    wall_m = sums[_WALL, 0] * grid.resolution_m
    features["resolution_m"] = np.full_like(wall_m, max(measured_m or 0.0, grid.resolution_m))
    return features, wall_m


def _shares(grid: DenseGrid, piece: Piece) -> dict[str, tuple[NDArray[np.generic], ...]]:
    """What is summed of a piece's cells: the features', seen with the cells around the piece, and the occupied ones."""
    reach = max(reach_cells(grid.resolution_m), SPECKLE_CELLS)
    top, left = max(piece.rows.start - reach, 0), max(piece.columns.start - reach, 0)
    around = slice(top, piece.rows.stop + reach), slice(left, piece.columns.stop + reach)
    seen = replace(grid, classes=grid.classes[around], log_odds=grid.log_odds[around])
    inner = tuple(slice(part.start - at, part.stop - at) for part, at in ((piece.rows, top), (piece.columns, left)))
    found = {name: tuple(cells[inner] for cells in share) for name, share in feature_shares(seen).items()}
    return {**found, _WALL: (seen.classes[inner] == OCCUPIED,)}


def _clipped(start: int, side: int, offset: int, size: int) -> slice:
    return slice(max(start - offset, 0), min(start + side - offset, size))


def _ratio(over: Windows, under: Windows) -> Windows:
    return np.divide(over, under, out=np.zeros_like(over), where=under > 0)
