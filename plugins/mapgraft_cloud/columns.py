"""Named columns of numbers, as files and messages have them, made into a cloud."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import Cloud

Columns = Mapping[str, NDArray[np.generic]]  # (n,) each


def cloud_of(columns: Columns, origin_m: tuple[float, float, float] | None) -> Cloud:
    """The cloud in columns that have x, y and z; points that are no returns are left out and counted.

    These are points that are not finite and, in a sweep (``origin_m`` is not None), points exactly where the
    sensor is: organised clouds have so many points as the sensor has beams, and some drivers write zeros where nothing
    came back.
    """
    points = np.stack([np.asarray(columns[axis]).astype(np.float32) for axis in "xyz"], axis=1)
    seen = np.isfinite(points).all(axis=1)
    if origin_m is not None:
        seen &= (points != np.array(origin_m, np.float32)).any(axis=1)
    kept = points if seen.all() else points[seen]
    kept.setflags(write=False)
    return Cloud(kept, origin_m, int(np.count_nonzero(~seen)))
