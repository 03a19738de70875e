"""A kernel that runs as long as one likes, and gives back what numba's own Python code has to put together."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit
def kernel(count):
    total = 0.0
    for n in range(count):
        total += n % 7
    return np.zeros(3), np.ones(3), total
