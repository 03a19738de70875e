"""Voxels seen from above: what stands in a column, or how often it was seen through."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_cloud.kernels.block_keys import BLOCK, VOLUME

HITS, MISSES, RANK = range(3)
FREE, MAYBE, STANDS = 1, 2, 3  # what the best voxel of a column so far says; 0: nothing


@njit(cache=True)
def gather(
    grounds: NDArray[np.int64],
    bottoms: NDArray[np.int64],
    counts: NDArray[np.int64],
    low: NDArray[np.int64],
    thick: int,
    model: NDArray[np.int64],
    out: NDArray[np.int64],
) -> None:
    """The best voxels of columns ``out`` (g, 3, 64: hits, misses, what they say) from blocks (k,).

    ``grounds`` (k,) tells to which columns a block belongs, ``bottoms`` (k,) its lowest voxel's z; ``counts``
    (k, 2, 512) are hits and misses. Only ``thick`` voxels from z = ``low`` (g,) on count. ``model`` (4,) is the
    evidence of a hit and of a miss, from where on a voxel is occupied, and up to where it is free. A column takes the
    counts of the occupied voxel with most evidence; where none is, and nothing speaks for one, of the free voxel that
    was most often seen through; of equal ones the lowest.
    """
    for block in range(grounds.size):
        ground = grounds[block]
        for i in range(VOLUME):
            z = bottoms[block] + i // (BLOCK * BLOCK)
            h, m = counts[block, 0, i], counts[block, 1, i]
            if z < low[ground] or z >= low[ground] + thick or (h == 0 and m == 0):
                continue
            odds = h * model[0] + m * model[1]
            if odds >= model[2]:
                says = STANDS
            elif odds > 0:
                says = MAYBE
            elif odds <= model[3]:
                says = FREE
            else:
                continue
            best = out[ground, :, i % (BLOCK * BLOCK)]
            better = odds > best[HITS] * model[0] + best[MISSES] * model[1] if says == STANDS else m > best[MISSES]
            if says > best[RANK] or (says == best[RANK] and better):
                best[HITS], best[MISSES], best[RANK] = h, m, says
