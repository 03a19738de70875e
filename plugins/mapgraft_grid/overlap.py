"""What the two sides of a comparison have in common."""

from __future__ import annotations

from mapgraft.contracts import Comparison, Map, MapError
from mapgraft_grid.grid_map import GridMap


def pair_of(comparison: Comparison, metric: str) -> tuple[GridMap, GridMap]:
    """(target, donor) as grids of one lattice; raises MapError when they are not."""
    target, donor = _grid(comparison.target, metric), _grid(comparison.donor, metric)
    if target.lattice != donor.lattice:
        raise MapError(
            f"{metric} compares grids of one lattice, found {target.lattice} and {donor.lattice}: "
            "place the donor's layer at the receiver's resolution first"
        )
    return target, donor


def _grid(map_: Map, metric: str) -> GridMap:
    if not isinstance(map_, GridMap):
        raise MapError(f"{metric} compares occupancy grids, found a map of type {map_.map_type!r}: use another metric")
    return map_
