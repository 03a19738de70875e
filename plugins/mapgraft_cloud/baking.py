"""Mixing a donor into a layer for good, and discarding what came from donors."""

from __future__ import annotations

import numpy as np

from mapgraft.contracts import Contribution, Reset
from mapgraft_cloud.blocks import BlockPool
from mapgraft_cloud.layer import CloudLayer, as_layer
from mapgraft_cloud.region import VoxelRegion
from mapgraft_cloud.views import parts_of, weight_of


def absorb(layer: CloudLayer, contribution: Contribution) -> VoxelRegion:
    """Add the donor's counts, as often as it is weighted; donors of another sensor model keep their own counts."""
    donor = as_layer(contribution.layer)
    parts_of(layer, [contribution])  # raises where the two do not fit
    weight = weight_of(contribution)
    if not weight:
        return VoxelRegion.empty(layer.voxel_m)
    for model, pool in sorted(donor.pools.items()):
        keys, counts = pool.table()
        if keys.size:
            layer.pools.setdefault(model, BlockPool()).add(keys, counts, weight)
    return donor.region()


def reset(layer: CloudLayer, foreign: VoxelRegion, keep: VoxelRegion) -> Reset:
    """Set ``foreign`` minus ``keep`` to unknown, and count what held evidence and what stays."""
    discarded = foreign.minus(keep)
    held = np.zeros((discarded.keys.size, 512), np.bool_)
    mask = discarded.mask()
    for pool in layer.pools.values():
        held |= pool.held(discarded.keys) & mask
        pool.clear(discarded.keys, mask)
    return Reset(discarded, int(held.sum()), len(foreign) - len(discarded))
