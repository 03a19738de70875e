"""What other sources add to a map: weighted evidence, computed once and kept while its contribution lives."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Contribution, MapError
from mapgraft_grid.kernels import viewing
from mapgraft_grid.kernels.tile_keys import TILE
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.parameters import Lattice
from mapgraft_grid.region import GridRegion
from mapgraft_grid.tiles import Slots, TileIndex, TileKeys
from mapgraft_grid.weights import Bounds, TileWeights

MOST_SOURCES: Final = 60  # so that the sum of their evidence fits int32 (kernels.viewing.EVIDENCE_LIMIT)

_NO_KEYS: Final = np.empty(0, np.int64)


class ForeignEvidence:
    """Log-odds of tiles, 1024 per nat: ``tiles`` (n, 64, 64) int32 in the order of ``index``; never written again."""

    __slots__ = ("__weakref__", "index", "tiles")

    def __init__(self, index: TileIndex, tiles: NDArray[np.int32]) -> None:
        self.index = index
        self.tiles = tiles

    @classmethod
    def of_keys(cls, keys: TileKeys, tiles: NDArray[np.int32]) -> ForeignEvidence:
        """The evidence of tiles (k, 64, 64) with distinct keys (k,)."""
        index = TileIndex()
        index.claim(keys)
        return cls(index, tiles)


NOTHING: Final = ForeignEvidence.of_keys(_NO_KEYS, np.zeros((0, TILE, TILE), np.int32))


def own_evidence(layer: GridLayer, slots: Slots) -> NDArray[np.int32]:
    """What a layer says by itself, in its own sensor model: log-odds (k, 64, 64) of tiles, zero where a slot is -1."""
    pool, model = layer.pool, layer.sensor_model
    out = np.empty((slots.size, TILE, TILE), np.int32)
    viewing.evidence(slots, *pool.arrays(), (model.l_hit, model.l_miss), out)
    return out


@dataclass(frozen=True, slots=True)
class _Kept:
    version: int
    weights: object
    fill: object
    evidence: ForeignEvidence


class Applications:
    """Remembers what contributions add, as long as their layers live. Computing it again gives the same."""

    __slots__ = ("_kept", "_sum", "_summed")

    def __init__(self) -> None:
        self._kept: weakref.WeakKeyDictionary[GridLayer, _Kept] = weakref.WeakKeyDictionary()
        self._summed: tuple[weakref.ref[ForeignEvidence], ...] = ()
        self._sum = NOTHING

    def total(self, lattice: Lattice, contributions: Sequence[Contribution]) -> ForeignEvidence:
        """The sum over contributions; raises MapError when one lies on another lattice or they are too many."""
        if len(contributions) > MOST_SOURCES:
            raise MapError(f"a map can hold {MOST_SOURCES} contributions, found {len(contributions)}: revert some")
        parts = [self.one(lattice, contribution) for contribution in contributions]
        if len(parts) < 2:
            return parts[0] if parts else NOTHING
        if [ref() for ref in self._summed] != parts:
            self._sum = _added(parts)
            self._summed = tuple(map(weakref.ref, parts))
        return self._sum

    def one(self, lattice: Lattice, contribution: Contribution) -> ForeignEvidence:
        """What one contribution adds: its layer's evidence times the tile weights, and as it is where it only fills.

        Where the weights are ``Bounds``, those of a prior, its evidence cut off there.
        """
        layer, weights, fill = contribution.layer, contribution.weights, contribution.fill
        if not isinstance(layer, GridLayer) or layer.lattice != lattice:
            raise MapError(
                f"a contribution to this map must be a grid on {lattice}, "
                f"found {getattr(layer, 'lattice', layer.map_type)}: place the donor's layer first"
            )
        kept = self._kept.get(layer)
        if kept and kept.version == layer.version and kept.weights is weights and kept.fill is fill:
            return kept.evidence
        evidence = _applied(layer, weights, fill)
        self._kept[layer] = _Kept(layer.version, weights, fill, evidence)
        return evidence


def _applied(layer: GridLayer, weights: object, fill: object) -> ForeignEvidence:
    if isinstance(weights, Bounds):
        return _bounded(layer, weights)
    if not isinstance(weights, TileWeights):
        raise MapError(
            f"a grid's contribution needs TileWeights or Bounds, found {type(weights).__name__}: use a fuser for grids"
        )
    if fill is not None and (not isinstance(fill, GridRegion) or fill.lattice != layer.lattice):
        raise MapError("the cells to fill must be a region on the contribution's lattice: use a fuser for grids")
    keys = np.sort(layer.pool.index.keys)
    evidence = own_evidence(layer, layer.pool.index.find(keys))
    cells = fill if fill is not None else GridRegion.empty(layer.lattice)
    index = TileIndex()
    index.claim(cells.keys)
    viewing.weigh(evidence, weights.of(keys), index.find(keys), cells.rows)
    return ForeignEvidence.of_keys(keys, evidence)


def _bounded(layer: GridLayer, bounds: Bounds) -> ForeignEvidence:
    """What a prior adds: its layer's evidence, cut off."""
    keys = np.sort(layer.pool.index.keys)
    evidence = own_evidence(layer, layer.pool.index.find(keys))
    return ForeignEvidence.of_keys(keys, np.clip(evidence, -bounds.free, bounds.occupied))


def _added(parts: Sequence[ForeignEvidence]) -> ForeignEvidence:
    index = TileIndex()
    slots = [index.claim(part.index.keys) for part in parts]
    tiles = np.zeros((len(index), TILE, TILE), np.int32)
    for part, places in zip(parts, slots, strict=True):
        viewing.add_tiles(places, part.tiles, tiles)
    return ForeignEvidence(index, tiles)
