"""Unpacking LZF, the compression of ``binary_compressed`` PCD files."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def unpack(data: NDArray[np.uint8], out: NDArray[np.uint8]) -> int:
    """Fill ``out`` from packed ``data``; returns how many bytes came out, -1 when the data are broken.

    Source: the format of liblzf by M. Lehmann, as its documentation describes it.
    """
    source, target = 0, 0
    while source < data.size:
        control = int(data[source])
        source += 1
        if control < 32:  # so many literal bytes, and one more
            length = control + 1
            if source + length > data.size or target + length > out.size:
                return -1
            for k in range(length):
                out[target + k] = data[source + k]
            source += length
        else:  # a copy of what came out before
            length = control >> 5
            if length == 7:
                if source >= data.size:
                    return -1
                length += int(data[source])
                source += 1
            if source >= data.size:
                return -1
            back = target - ((control & 31) << 8) - int(data[source]) - 1
            source += 1
            length += 2
            if back < 0 or target + length > out.size:
                return -1
            for k in range(length):
                out[target + k] = out[back + k]
        target += length
    return target
