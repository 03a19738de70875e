"""A read-only occupancy map: what matchers, fusers and metrics look at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import EmptyMapError, MapError
from mapgraft_grid.kernels import viewing
from mapgraft_grid.kernels.tile_keys import TILE, tile_x, tile_y
from mapgraft_grid.layer import NAME
from mapgraft_grid.parameters import Lattice, Thresholds
from mapgraft_grid.tile_tree import TileTree

UNKNOWN: Final = 0
FREE: Final = 1
OCCUPIED: Final = 2

LARGEST_DENSE: Final = 400_000_000  # cells; 2 GB of classes and log-odds

Classes = NDArray[np.uint8]  # (h, w) UNKNOWN, FREE or OCCUPIED, row 0 at the smallest y
LogOdds = NDArray[np.int32]  # (h, w) clamped, 1024 per nat, 0 where nothing is known


@dataclass(frozen=True, slots=True, eq=False)
class DenseGrid:
    """A rectangle of cells as arrays, read-only; row 0 has the smallest y, column 0 the smallest x.

    ``origin_cell`` (ix, iy) is the lattice cell of element [0, 0] and ``origin_m`` (x, y) its lower-left corner.
    """

    classes: Classes
    log_odds: LogOdds
    origin_cell: tuple[int, int]
    origin_m: tuple[float, float]
    resolution_m: float


class GridMap:
    """What is known of every cell at one moment, immutable.

    Tiles that did not change are shared with the map it was made from. ``thresholds`` says how evidence was read.
    """

    __slots__ = ("__weakref__", "_dense", "_known", "_tiles", "lattice", "thresholds")

    def __init__(self, lattice: Lattice, thresholds: Thresholds, tiles: TileTree, known: int) -> None:
        self.lattice = lattice
        self.thresholds = thresholds
        self._tiles = tiles
        self._known = known
        self._dense: DenseGrid | None = None

    @property
    def map_type(self) -> str:
        return NAME

    @property
    def resolution_m(self) -> float:
        return self.lattice.resolution_m

    @property
    def anchor_m(self) -> tuple[float, float]:
        """The lower-left corner of cell (0, 0), in [0, resolution_m)."""
        return self.lattice.anchor_m

    @property
    def tiles(self) -> TileTree:
        """The tiles with any evidence, by key."""
        return self._tiles

    @property
    def is_empty(self) -> bool:
        return self._known == 0

    def known(self) -> int:
        """How many cells are free or occupied."""
        return self._known

    def dense(self) -> DenseGrid:
        """All known cells: the smallest rectangle that holds them, made once.

        Raises EmptyMapError when nothing is known, MapError when the rectangle is too large for an array.
        """
        if self._dense is None:
            x0, y0, x1, y1 = self.bounds_cells()
            self._dense = self.dense_over((x0, y0), (y1 - y0, x1 - x0))
        return self._dense

    def dense_over(self, origin_cell: tuple[int, int], shape: tuple[int, int]) -> DenseGrid:
        """The window of ``shape`` (h, w) whose element [0, 0] is cell ``origin_cell`` (ix, iy).

        Raises MapError when the window is too large for an array.
        """
        height, width = shape
        if height < 0 or width < 0 or height * width > LARGEST_DENSE:
            raise MapError(
                f"an array of {width} × {height} cells was asked for, the most is {LARGEST_DENSE}: "
                "look for poses or points far away from the rest, or take a coarser resolution"
            )
        log_odds = np.zeros(shape, np.int32)
        ix, iy = origin_cell
        inside = [
            key
            for key in self._tiles
            if -TILE < TILE * tile_x(key) - ix < width and -TILE < TILE * tile_y(key) - iy < height
        ]
        if inside:
            stacked = np.stack([self._tiles[key].log_odds for key in inside])
            viewing.assemble(np.array(inside, np.int64), stacked, ix, iy, log_odds)
        classes = viewing.classify(log_odds, self.thresholds.free, self.thresholds.occupied)
        log_odds.setflags(write=False)
        classes.setflags(write=False)
        return DenseGrid(classes, log_odds, origin_cell, self.lattice.corner_m(ix, iy), self.resolution_m)

    def bounds_cells(self) -> tuple[int, int, int, int]:
        """The smallest rectangle of cells that holds all known ones: ix, iy of its lower-left cell, and one beyond.

        Raises EmptyMapError when nothing is known.
        """
        some = [key for key, tile in self._tiles.items() if tile.known > 0]
        if not some:
            raise EmptyMapError("the map knows no free or occupied cell yet: integrate observations first")
        columns, rows = [tile_x(key) for key in some], [tile_y(key) for key in some]
        edges = (min(columns), min(rows), max(columns), max(rows))
        outer = [k for k in some if tile_x(k) in (edges[0], edges[2]) or tile_y(k) in (edges[1], edges[3])]
        boxes = np.array([self._bounds_of(key) for key in outer])
        x0, y0 = boxes[:, :2].min(axis=0)
        x1, y1 = boxes[:, 2:].max(axis=0)
        return int(x0), int(y0), int(x1), int(y1)

    def _bounds_of(self, key: int) -> tuple[int, int, int, int]:
        values = self._tiles[key].log_odds
        known = (values <= self.thresholds.free) | (values >= self.thresholds.occupied)
        rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        x, y = TILE * tile_x(key), TILE * tile_y(key)
        return x + int(columns[0]), y + int(rows[0]), x + int(columns[-1]) + 1, y + int(rows[-1]) + 1
