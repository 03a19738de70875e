"""From ``nav_msgs/OccupancyGrid`` to a ready-made grid."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mapgraft.contracts.geometry import Transform
from mapgraft.contracts.observations import GridMessage
from mapgraft.errors import RecordingError, TransformError


def grid_payload(message: Any) -> GridMessage:
    """The grid in an ``OccupancyGrid`` object, its cells a copy.

    Values below 0 are unknown, values above 100 occupied. Raises RecordingError when the message lacks the fields of a
    grid, when the grid has no cells, when their number does not fit its size, or when its resolution or origin is not
    usable.
    """
    try:
        return _grid(message)
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise RecordingError(f"a grid does not have the fields of its type ({error})") from error


def _grid(message: Any) -> GridMessage:
    info = message.info
    width, height, resolution_m = int(info.width), int(info.height), float(info.resolution)
    values = np.asarray(message.data)
    if width <= 0 or height <= 0:
        raise RecordingError(f"a grid of {width} × {height} cells is empty: nothing was mapped yet, or it is broken")
    if width * height != len(values):
        raise RecordingError(
            f"a grid of {width} × {height} cells must hold {width * height} values, found {len(values)}"
        )
    if values.ndim != 1 or values.dtype.kind not in "iu":
        raise RecordingError("a grid's cells must be whole numbers in a row")
    if not (math.isfinite(resolution_m) and resolution_m > 0):
        raise RecordingError(f"a grid's resolution must be positive, found {resolution_m} m per cell")
    p, q = info.origin.position, info.origin.orientation
    try:
        origin = Transform.from_quaternion(
            (float(p.x), float(p.y), float(p.z)), (float(q.x), float(q.y), float(q.z), float(q.w))
        )
    except TransformError as error:
        raise RecordingError(f"a grid's origin is not usable: {error}") from error
    cells = np.clip(values.reshape(height, width), -1, 100).astype(np.int8)
    cells.setflags(write=False)
    return GridMessage(cells, resolution_m, origin)
