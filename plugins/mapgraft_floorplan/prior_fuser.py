"""The fuser ``plan_prior``: what a plan says, bounded, as a prior and never as an observation."""

from __future__ import annotations

import math
from typing import Final

from mapgraft.contracts import ConfigError, Contribution, Donation, Map, MapError, MapType, Match
from mapgraft_grid.grid_map import GridMap
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.map_type import OccupancyGrid
from mapgraft_grid.parameters import in_fixed_point
from mapgraft_grid.weights import Bounds

LINES: Final = "line_segments"
MOST_NATS: Final = 2.0  # five misses of the default sensor model: more would be an observation's weight


class PlanPrior:
    """Lets a plan say where walls and rooms may be: in a grid with log-odds of at most ``wall`` and ``room`` (nats).

    The contribution has the role ``prior``. With the defaults a wall counts as much as one hit of the default sensor
    model and a room as one miss, so that three looks through a wall that was never built are enough to doubt it, and a
    room is not shown as free before somebody has looked. Nothing of it counts as an observation, as known area or as
    quality, and it is never offered further, because it lies in a layer of its own. A receiver of line segments gets
    the walls as segments that were seen once, however often and in however many parts they are drawn. The summary tells
    ``prior``: 1, and ``cells_changed``.
    """

    def __init__(self, *, wall: float = 0.85, room: float = 0.41) -> None:
        for name, nats in (("wall", wall), ("room", room)):
            if isinstance(nats, bool) or not (math.isfinite(nats) and 0.0 < nats <= MOST_NATS):
                raise ConfigError(f"plan_prior needs {name} above 0 and up to {MOST_NATS:g} nats, found {nats!r}")
        self._bounds = Bounds(in_fixed_point(wall), in_fixed_point(room))

    def fuse(self, map_type: MapType, target: Map, source: Donation, match: Match) -> Contribution:
        """The contribution; EmptyMapError when the plan is empty, MapError when the receiver is of another type."""
        if map_type.name == LINES:
            return self._beside(map_type, target, source, match)
        if not (
            isinstance(map_type, OccupancyGrid) and isinstance(target, GridMap) and isinstance(source.layer, GridLayer)
        ):
            raise MapError(
                f"plan_prior makes floor plans priors of occupancy grids and line segments, found a receiver of type "
                f"{map_type.name!r} and a layer of type {source.layer.map_type!r}: convert them first"
            )
        T = match.T_receiver_donor.snapped()
        placed = map_type.place(source.layer, T, match.scale)
        region = map_type.region(placed)
        return Contribution(
            provenance=source.provenance,
            layer=placed,
            T_receiver_donor=T,
            scale=match.scale,
            resampler=map_type.resampler(source.layer, match.scale),
            weights=self._bounds,
            fill=None,
            region=region,
            role="prior",
            summary={"prior": 1.0, "cells_changed": float(len(region))},
        )

    def _beside(self, map_type: MapType, target: Map, source: Donation, match: Match) -> Contribution:
        from mapgraft_lines.union import LineUnion
        from mapgraft_lines.weights import as_prior

        return as_prior(LineUnion().fuse(map_type, target, source, match))
