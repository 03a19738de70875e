"""The view of evidence: which walls stand where, and what is known to be free."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Map, MapError, Points
from mapgraft_lines.layer import NAME, Evidence
from mapgraft_lines.segments import cell_keys
from mapgraft_lines.table import Keys, distinct
from mapgraft_lines.walls import SLOT_MASK, Grown, Walls, cell_corners_m, grown, standing

UNKNOWN, FREE, WALL = 0, 1, 2
LARGEST_DENSE: Final = 100_000_000  # cells

Side = str  # "own" or "received"


@dataclass(frozen=True, slots=True)
class Reading:
    """How evidence is read: a piece stands that was seen ``looks_min`` times and in ``share_min`` of the looks at its
    cell; walls shorter than ``length_min_m`` are none.
    """

    looks_min: int = 1
    share_min: float = 0.2
    length_min_m: float = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A window of cells: ``classes`` (h, w) UNKNOWN, FREE or WALL, row 0 at the smallest y; ``origin`` (ix, iy)."""

    classes: NDArray[np.uint8]
    origin: tuple[int, int]
    cell_m: float

    def at(self, points_m: Points) -> NDArray[np.uint8]:
        """The classes (n,) of the cells in which points (n, 2) lie."""
        index = np.floor(points_m / self.cell_m).astype(np.int64) - self.origin
        height, width = self.classes.shape
        inside = ((index >= 0) & (index < (width, height))).all(axis=1)
        out = np.zeros(len(points_m), np.uint8)
        out[inside] = self.classes[index[inside, 1], index[inside, 0]]
        return out


@dataclass(frozen=True, slots=True, eq=False)
class LineMap:
    """Walls and free cells at one moment, immutable; what is not asked for is not computed.

    ``own`` and ``received`` are the evidence of the map's own source and that of others: each wall knows the segments
    of either side that lie on it (``side``, ``links``), and taking a source out leaves the rest as it was.
    """

    cell_m: float
    own: Evidence
    received: Evidence = field(default_factory=Evidence)
    reading: Reading = field(default_factory=Reading)
    sources: tuple[object, ...] = ()  # what ``received`` was made of
    kept: dict[str, Any] = field(default_factory=dict)  # what was computed from the rest

    @property
    def total(self) -> Evidence:
        """The evidence of all."""
        if "evidence" not in self.kept:
            self.kept["evidence"] = self.own if self.received.is_empty else self.own.plus(self.received)
        total: Evidence = self.kept["evidence"]
        return total

    @property
    def map_type(self) -> str:
        return NAME

    def known(self) -> int:
        """How many cells are free or hold a standing piece of wall."""
        return len(self.known_keys())

    def known_keys(self) -> Keys:
        """The cells (slot 0) that are known, ascending."""
        if "known" not in self.kept:
            held = distinct(self.standing_keys() & ~SLOT_MASK)
            self.kept["known"] = distinct(held, self.total.space.keys)
        known: Keys = self.kept["known"]
        return known

    def standing_keys(self) -> Keys:
        """The pieces that stand, ascending."""
        return standing(self.total.pieces, self.total.space, self.reading.looks_min, self.reading.share_min).keys

    @property
    def walls(self) -> Walls:
        """The walls, longest first."""
        return self._grown("total", self.total).walls

    def wall_keys(self) -> Keys:
        """The pieces that lie on the walls, ascending."""
        found = self._grown("total", self.total)
        return found.keys[found.wall >= 0]

    def side(self, side: Side) -> Walls:
        """The segments of one side alone: ``own`` or ``received``."""
        return self._grown(side, self.own if side == "own" else self.received).walls

    def links(self, side: Side) -> NDArray[np.int64]:
        """Which segments of a side (column 1) lie on which walls (column 0): (k, 2), ascending, without repeats."""
        whole = self._grown("total", self.total)
        part = self._grown(side, self.own if side == "own" else self.received)
        _, a, b = np.intersect1d(whole.keys, part.keys, assume_unique=True, return_indices=True)
        pairs = np.column_stack((whole.wall[a], part.wall[b]))
        links: NDArray[np.int64] = np.unique(pairs[(pairs >= 0).all(axis=1)], axis=0)
        return links

    @property
    def cells(self) -> Cells:
        """The known cells as an array; raises MapError when they lie too far apart for one."""
        if "cells" not in self.kept:
            self.kept["cells"] = self._dense()
        cells: Cells = self.kept["cells"]
        return cells

    def knows(self, points_m: Points) -> NDArray[np.bool_]:
        """Which of the points (n, 2) lie in known cells or next to one with a piece of wall: walls bridge gaps."""
        index = np.floor(points_m / self.cell_m).astype(np.int64)
        found: NDArray[np.bool_] = np.isin(cell_keys(index[:, 0], index[:, 1]), self._around_keys())
        return found

    def _around_keys(self) -> Keys:
        """The known cells and the neighbours of those that hold a piece of wall, ascending."""
        if "around" not in self.kept:
            corners = cell_corners_m(distinct(self.standing_keys() & ~SLOT_MASK), self.cell_m)
            held = np.rint(corners / self.cell_m).astype(np.int64)
            steps = np.stack(np.meshgrid((-1, 0, 1), (-1, 0, 1)), axis=-1).reshape(-1, 2)
            near = (held[:, None] + steps).reshape(-1, 2)
            self.kept["around"] = distinct(self.known_keys(), cell_keys(near[:, 0], near[:, 1]))
        keys: Keys = self.kept["around"]
        return keys

    def _grown(self, name: str, evidence: Evidence) -> Grown:
        if name not in self.kept:
            reading = self.reading
            if name != "total" and self.received.is_empty:
                self.kept[name] = self._grown("total", self.total) if name == "own" else _nothing(self.cell_m)
            else:
                pieces = standing(evidence.pieces, evidence.space, reading.looks_min, reading.share_min)
                own = self.own if name == "total" else evidence
                self.kept[name] = grown(pieces, own.pieces, self.cell_m, reading.length_min_m)
        found: Grown = self.kept[name]
        return found

    def _dense(self) -> Cells:
        keys = self.known_keys()
        if not len(keys):
            return Cells(np.zeros((0, 0), np.uint8), (0, 0), self.cell_m)
        index = np.round(cell_corners_m(keys, self.cell_m) / self.cell_m).astype(np.int64)
        low = index.min(axis=0)
        width, height = (index.max(axis=0) - low + 1).tolist()
        if width * height > LARGEST_DENSE:
            raise MapError(
                f"a map of line segments spans {width} × {height} cells of {self.cell_m:g} m, the most that can be "
                f"compared is {LARGEST_DENSE}: look for segments far away from the rest, or take a larger cell_m"
            )
        classes = np.zeros((height, width), np.uint8)
        walls = np.isin(keys, distinct(self.standing_keys() & ~SLOT_MASK))
        classes[index[:, 1] - low[1], index[:, 0] - low[0]] = np.where(walls, WALL, FREE)
        classes.setflags(write=False)
        return Cells(classes, (int(low[0]), int(low[1])), self.cell_m)


def _nothing(cell_m: float) -> Grown:
    return grown(Evidence().pieces, Evidence().pieces, cell_m, 0.0)


def as_map(map_: Map) -> LineMap:
    """The map as one of this type; raises MapError when it is of another."""
    if not isinstance(map_, LineMap):
        raise MapError(f"{NAME} needs a map of its own type, found one of {map_.map_type}: convert it first")
    return map_
