"""Whether walls run in more than one direction."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

ACROSS_SINE: Final = math.sin(math.radians(30.0))
MOST: Final = 2000  # walls that are looked at, the first


def crossing_m(angles_rad: NDArray[np.float64], lengths_m: NDArray[np.float64]) -> float:
    """How many metres of wall run at 30° or more to the direction in which most of them run."""
    angles, lengths = angles_rad[:MOST], lengths_m[:MOST]
    if not len(angles):
        return 0.0
    across = np.abs(np.sin(angles[:, None] - angles)) >= ACROSS_SINE
    main = int(np.argmin(across @ lengths))
    return float(lengths[across[main]].sum())
