"""Adding up sorted rows."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def merge(
    a_keys: NDArray[np.int64], a_counts: NDArray[np.int64], b_keys: NDArray[np.int64], b_counts: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows of both, keys (n,) strictly rising and counts (n, columns), those of one key added up."""
    n, m = a_keys.size, b_keys.size
    keys = np.empty(n + m, np.int64)
    counts = np.empty((n + m, a_counts.shape[1]), np.int64)
    i, j, k = 0, 0, 0
    while i < n or j < m:
        if j == m or (i < n and a_keys[i] < b_keys[j]):
            keys[k], counts[k] = a_keys[i], a_counts[i]
            i += 1
        elif i == n or b_keys[j] < a_keys[i]:
            keys[k], counts[k] = b_keys[j], b_counts[j]
            j += 1
        else:
            keys[k] = a_keys[i]
            for column in range(counts.shape[1]):
                counts[k, column] = a_counts[i, column] + b_counts[j, column]
            i, j = i + 1, j + 1
        k += 1
    return keys[:k].copy(), counts[:k].copy()
