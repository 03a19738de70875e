"""Voxels seen from above: what stands in a column, or how often it was seen through."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_cloud.kernels.block_keys import BLOCK, VOLUME


@njit(cache=True)
def gather(
    grounds: NDArray[np.int64],
    bottoms: NDArray[np.int64],
    hits: NDArray[np.int64],
    misses: NDArray[np.int64],
    band: NDArray[np.int64],
    model: NDArray[np.int64],
    out: NDArray[np.int64],
) -> None:
    """The counts of columns ``out`` (g, 2, 64: hits, misses) from blocks (k,) with counts (k, 512).

    ``grounds`` (k,) tells to which columns a block belongs, ``bottoms`` (k,) its lowest voxel's z; only z in ``band``
    (low, high) count. A column takes the counts of the voxel that is most surely occupied by ``model`` (hit, miss), and
    where none is, of the one that was most often seen through; of equal ones the lowest.
    """
    for block in range(grounds.size):
        for i in range(VOLUME):
            z = bottoms[block] + i // (BLOCK * BLOCK)
            h, m = hits[block, i], misses[block, i]
            if z < band[0] or z >= band[1] or (h == 0 and m == 0):
                continue
            place = i % (BLOCK * BLOCK)
            old_h, old_m = out[grounds[block], 0, place], out[grounds[block], 1, place]
            odds, old = h * model[0] + m * model[1], old_h * model[0] + old_m * model[1]
            surer = odds > 0 and (odds > old or (old_h == 0 and old_m == 0))
            if surer or (odds <= 0 and old <= 0 and m > old_m):
                out[grounds[block], 0, place], out[grounds[block], 1, place] = h, m
