"""Mixing a donor into a layer for good, and discarding what came from donors."""

from __future__ import annotations

from mapgraft.contracts import Contribution, Reset
from mapgraft_cloud.blocks import BlockPool, empty_bits, require_countable
from mapgraft_cloud.layer import CloudLayer, as_layer
from mapgraft_cloud.region import VoxelRegion
from mapgraft_cloud.views import parts_of, weight_of


def absorb(layer: CloudLayer, contribution: Contribution) -> VoxelRegion:
    """Add the donor's counts, as often as it is weighted, beside what the layer observed itself."""
    donor = as_layer(contribution.layer)
    parts_of(layer, [contribution])  # raises where the two do not fit
    weight = weight_of(contribution)
    if not weight:
        return VoxelRegion.empty(layer.voxel_m)
    for model, pool in donor.pools():
        before = layer.absorbed.get(model)
        require_countable((before.most if before else 0) + weight * pool.most)
    for model, pool in donor.pools():
        for blocks in pool.blocks():
            layer.absorbed.setdefault(model, BlockPool()).add(blocks, weight)
    return donor.region()


def reset(layer: CloudLayer, foreign: VoxelRegion, keep: VoxelRegion) -> Reset:
    """Set ``foreign`` minus ``keep`` to unknown, and count what held evidence and what stays."""
    discarded = foreign.minus(keep)
    held = empty_bits(discarded.keys.size)
    for _, pool in layer.pools():
        held |= pool.held(discarded.keys) & discarded.bits
        pool.clear(discarded.keys, discarded.bits)
    lost = len(VoxelRegion(layer.voxel_m, discarded.keys, held))
    return Reset(discarded, lost, len(foreign) - len(discarded))
