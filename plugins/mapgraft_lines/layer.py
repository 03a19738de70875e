"""The evidence of one source about walls and free space."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from mapgraft.contracts import Layer, MapError
from mapgraft_lines.kernels.keys import SLOT_BITS
from mapgraft_lines.region import LineRegion
from mapgraft_lines.table import Table, distinct

NAME: Final = "line_segments"
FROM_SCANS: Final = "scans"
READY_MADE: Final = "ready map"
CONVERTED: Final = "conversion"

LOOKS, W, WX, WY, WXX, WXY, WYY, DX, DY = range(9)
PIECE_COLUMNS: Final = 9
SPACE_COLUMNS: Final = 1


def no_pieces() -> Table:
    return Table.empty(PIECE_COLUMNS)


def no_space() -> Table:
    return Table.empty(SPACE_COLUMNS)


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What is known of walls and of free space, as integers that add.

    ``pieces`` has a row per cell and direction in which pieces of wall were seen (slots from 1). Its columns: in how
    many observations (``LOOKS``); the information W of all pieces, in units of 1/256 over (0.02 m)² for a piece as long
    as the cell; the moments of the pieces weighted by it (``WX`` … ``WYY``), in steps of 1/1024 m from the cell's lower
    left corner; and W times the unit vector along the wall, 256 per one (``DX``, ``DY``), of twice the angle where the
    side from which it was seen is not known. ``space`` has a row per cell (slot 0) through which beams went freely, and
    in how many observations.
    """

    pieces: Table = field(default_factory=no_pieces)
    space: Table = field(default_factory=no_space)

    def __len__(self) -> int:
        return len(self.pieces) + len(self.space)

    @property
    def is_empty(self) -> bool:
        return self.pieces.is_empty and self.space.is_empty

    def keys(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """All keys about which there is evidence, ascending: slots of pieces, and all cells that are known by any."""
        return distinct(self.pieces.keys, self.pieces.keys >> SLOT_BITS << SLOT_BITS, self.space.keys)

    def plus(self, other: Evidence, times: int = 1) -> Evidence:
        return Evidence(self.pieces.plus(other.pieces, times), self.space.plus(other.space, times))

    def without(self, keys: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Evidence:
        return Evidence(self.pieces.without(keys), self.space.without(keys))

    def equals(self, other: Evidence) -> bool:
        return self.pieces.equals(other.pieces) and self.space.equals(other.space)


@dataclass(slots=True, eq=False)
class LineLayer:
    """Raw, additive evidence in the frame of whoever gathered it; a write puts a new table in the old one's place.

    ``own`` was observed, ``absorbed`` baked in from other sources. ``observations`` counts what was integrated,
    ``sensors`` names what saw it, ``mapper`` is ``scans``, ``ready map``, ``conversion`` or empty before the first.
    """

    cell_m: float
    own: Evidence = field(default_factory=Evidence)
    absorbed: Evidence = field(default_factory=Evidence)
    observations: int = 0
    sensors: frozenset[str] = frozenset()
    mapper: str = ""

    @property
    def map_type(self) -> str:
        return NAME

    @property
    def is_empty(self) -> bool:
        return self.own.is_empty and self.absorbed.is_empty

    def all(self) -> Evidence:
        """What was observed and what was baked in."""
        return self.own if self.absorbed.is_empty else self.own.plus(self.absorbed)

    def most_looks(self) -> int:
        """How often the most seen piece of wall was seen, or the most free cell looked through."""
        counts = [table.counts[:, LOOKS] for of in (self.own, self.absorbed) for table in (of.pieces, of.space)]
        return max(int(looks.max(initial=0)) for looks in counts)

    def region(self) -> LineRegion:
        """The slots about which there is evidence."""
        if self.absorbed.is_empty:
            return LineRegion(self.cell_m, self.own.keys())
        return LineRegion(self.cell_m, distinct(self.own.keys(), self.absorbed.keys()))


def as_layer(layer: Layer) -> LineLayer:
    """The layer as one of this type; raises MapError when it is of another."""
    if not isinstance(layer, LineLayer):
        raise MapError(f"{NAME} needs a layer of its own type, found one of {layer.map_type}: convert it first")
    return layer
