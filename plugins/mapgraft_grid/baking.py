"""Mixing a contribution into a layer for good, and discarding what can be told apart afterwards."""

from __future__ import annotations

import numpy as np

from mapgraft.contracts import MapError, Reset
from mapgraft_grid.foreign import ForeignEvidence
from mapgraft_grid.kernels import erasing
from mapgraft_grid.layer import GridLayer
from mapgraft_grid.region import GridRegion
from mapgraft_grid.tiles import BitRows, Slots

_ABSORBED_LIMIT = 1 << 29  # of one cell, 1024 per nat, so that no sum leaves int32


def touched(layer: GridLayer) -> GridRegion:
    """The cells about which the layer holds evidence."""
    keys = np.sort(layer.pool.index.keys)
    return GridRegion.from_bits(layer.lattice, keys, _touched_rows(layer, layer.pool.index.find(keys)))


def absorb(layer: GridLayer, evidence: ForeignEvidence) -> GridRegion:
    """Add weighted log-odds to the layer, in place; returns the cells about which the evidence says something.

    They are told from the evidence alone: where it cancels what the layer has absorbed before, it is in the sum all the
    same. Raises MapError on overflow.
    """
    keys = np.sort(evidence.index.keys)
    tiles = evidence.tiles[evidence.index.find(keys)]
    changed = GridRegion.from_bits(layer.lattice, keys, erasing.nonzero_rows(tiles))
    slots = layer.pool.claim(changed.keys)
    absorbed = layer.pool.absorbed
    tiles = tiles[np.searchsorted(keys, changed.keys)]
    before = absorbed.of[slots]
    old = np.where((before >= 0)[:, None, None], absorbed.tiles[before], 0) if len(absorbed) else np.zeros_like(tiles)
    total = old.astype(np.int64) + tiles
    if (abs(total) > _ABSORBED_LIMIT).any():
        raise MapError("a cell has absorbed more evidence than fits: too many merges were baked into one map")
    for slot, values in zip(slots.tolist(), total, strict=True):
        absorbed.write(slot, values.astype(np.int32))
    layer.version += 1
    return changed


def reset(layer: GridLayer, foreign: GridRegion, keep: GridRegion) -> Reset:
    """Set ``foreign`` minus ``keep`` to unknown, in place.

    Counts the cells that held evidence and now hold none, and the cells of both regions: what they have absorbed does
    not tell whose it is, because what donors say may cancel.
    """
    for region in (foreign, keep):
        if region.keys.size and region.lattice != layer.lattice:
            raise MapError(f"a layer on {layer.lattice} cannot be reset by a region on {region.lattice}")
    discard = foreign.minus(keep)
    pool = layer.pool
    slots = pool.index.find(discard.keys)
    held = GridRegion.from_bits(layer.lattice, discard.keys, _touched_rows(layer, slots) & discard.rows)
    erasing.erase(slots, discard.rows, pool.hits)
    erasing.erase(slots, discard.rows, pool.misses)
    present = slots >= 0
    if len(pool.wide):
        wide = np.where(present, pool.wide.of[slots], -1).astype(np.int32)
        erasing.erase(wide, discard.rows, pool.wide.tiles[:, 0])
        erasing.erase(wide, discard.rows, pool.wide.tiles[:, 1])
    if len(pool.absorbed):
        erasing.erase(
            np.where(present, pool.absorbed.of[slots], -1).astype(np.int32), discard.rows, pool.absorbed.tiles
        )
    layer.version += 1
    return Reset(discard, len(held), len(foreign.intersection(keep)))


def _touched_rows(layer: GridLayer, slots: Slots) -> BitRows:
    rows: BitRows = erasing.touched_rows(slots, *layer.pool.arrays())
    return rows
