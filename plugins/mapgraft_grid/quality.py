"""How good a grid is, window by window: near 1 where its walls are true, falling as they lie 0.1 m off and more."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft_grid.grid_map import OCCUPIED, DenseGrid
from mapgraft_grid.quality_features import FEATURES, feature_shares

STRIDE_M: Final = 1.0  # a window is two strides wide, so that windows overlap by half
WALL_MIN_M: Final = 1.0  # with less wall than this a window cannot be judged
MODEL_FILE: Final = Path(__file__).parent / "quality_model.json"

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

    def sums(self, cells: NDArray[np.generic]) -> Windows:
        """The sums of cells (h, w) over all windows."""
        block = self.block_cells
        height, width = cells.shape
        rows, columns = -(-(height + self.offset[1]) // block) + 1, -(-(width + self.offset[0]) // block) + 1
        padded = np.zeros((rows * block, columns * block))
        padded[self.offset[1] : self.offset[1] + height, self.offset[0] : self.offset[0] + width] = cells
        blocks = padded.reshape(rows, block, columns, block).sum(axis=(1, 3))
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
    """The features (``FEATURES``) of every window, and its metres of wall."""
    shares = feature_shares(grid).items()
    features = {name: _ratio(layout.sums(over), layout.sums(under)) for name, (over, under) in shares}
    wall_m = layout.sums(grid.classes == OCCUPIED) * grid.resolution_m
    features["resolution_m"] = np.full_like(wall_m, max(measured_m or 0.0, grid.resolution_m))
    return features, wall_m


def _ratio(over: Windows, under: Windows) -> Windows:
    return np.divide(over, under, out=np.zeros_like(over), where=under > 0)
