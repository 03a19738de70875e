"""Which pieces of one cell run alike enough to be one piece of wall."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mapgraft_lines.kernels.keys import BARE, BARE_BINS, FACED_BINS, SLOT_BITS, slot_of


@njit(cache=True)
def beside(a: int, b: int) -> bool:
    """Whether two slots of a cell are the same or of neighbouring directions."""
    if a < BARE and b < BARE:
        return (a - b + 1) % FACED_BINS <= 2
    return a >= BARE and b >= BARE and (a - b + 1) % BARE_BINS <= 2


@njit(cache=True)
def heads(keys: NDArray[np.int64], weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each piece (n,), keys ascending, the piece of its cell it is joined to: the heaviest of its neighbours.

    The heaviest of a cell takes those of the neighbouring directions, then the heaviest of what is left; so no two that
    remain run in neighbouring directions.
    """
    out = np.full(keys.size, -1, np.int64)
    first = 0
    while first < keys.size:
        last = first
        while last < keys.size and keys[last] >> SLOT_BITS == keys[first] >> SLOT_BITS:
            last += 1
        while True:
            head = -1
            for k in range(first, last):
                if out[k] < 0 and (head < 0 or weights[k] > weights[head]):
                    head = k
            if head < 0:
                break
            for k in range(first, last):
                if out[k] < 0 and beside(slot_of(keys[k]), slot_of(keys[head])):
                    out[k] = head
        first = last
    return out
