"""The fuser ``line_union``: the donor's segments beside the receiver's own."""

from __future__ import annotations

import numpy as np

from mapgraft.contracts import ConfigError, Contribution, Donation, EmptyMapError, Map, MapError, MapType, Match
from mapgraft_lines.layer import as_layer
from mapgraft_lines.line_map import as_map
from mapgraft_lines.placing import RESAMPLER
from mapgraft_lines.weights import MOST


class LineUnion:
    """Keeps the segments of both sides, linked where they lie on one wall; the donor's count ``weight`` times (1 … 3).

    A wall of the fused map is the line through all pieces of both sides that lie on it, each weighted by its
    information, as long as all of them reach. What the donor brought in is a table of its own, so that taking it out
    leaves no trace. Its summary tells ``pieces``, ``pieces_new`` (in cells and directions in which the receiver had
    none) and ``cells_new`` (that the receiver did not know).
    """

    def __init__(self, *, weight: int = 1) -> None:
        if isinstance(weight, bool) or not isinstance(weight, int) or not 1 <= weight <= MOST:
            raise ConfigError(f"line_union weighs the donor by a whole number from 1 to {MOST}, found {weight!r}")
        self._weight = weight

    def fuse(self, map_type: MapType, target: Map, source: Donation, match: Match) -> Contribution:
        """The contribution; EmptyMapError when the donor's layer is empty, MapError when one is of another type."""
        own, donor = as_map(target), as_layer(source.layer)
        if donor.is_empty:
            raise EmptyMapError("the donor's map of line segments is empty: there is nothing to fuse")
        T = match.T_receiver_donor.snapped()
        placed = as_layer(map_type.place(donor, T, match.scale))
        if placed.cell_m != own.cell_m:
            raise MapError(
                f"the receiver's map has cells of {own.cell_m:g} m and places others on {placed.cell_m:g} m: "
                "give the robot one cell_m"
            )
        pieces, region = placed.own.pieces.keys, placed.region()
        known = np.isin(pieces, own.own.pieces.keys, assume_unique=True)
        cells = map_type.known_region(map_type.view(placed))
        return Contribution(
            provenance=source.provenance,
            layer=placed,
            T_receiver_donor=T,
            scale=match.scale,
            resampler=RESAMPLER,
            weights=self._weight,
            fill=None,
            region=region,
            summary={
                "pieces": float(len(pieces)),
                "pieces_new": float(len(pieces) - np.count_nonzero(known)),
                "cells_new": float(len(cells.minus(map_type.known_region(target)))),
            },
        )
