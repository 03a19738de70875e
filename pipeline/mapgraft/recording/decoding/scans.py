"""From a laser scan message to the beams of a ``Scan``."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts.observations import Scan
from mapgraft.contracts.sources import ScanMessage
from mapgraft.errors import RecordingError


def scan_payload(message: ScanMessage) -> Scan:
    """The beams of a scan message, with the meaning that its fields give them.

    A range of +inf, or from ``range_max_m`` on, saw nothing up to ``range_max_m``: the definition says "greater than",
    but drivers and simulators that clip at the limit report the limit itself. NaN, -inf, ranges below ``range_min_m``
    and ranges that are not positive say nothing. Without a usable ``range_max_m`` (not finite, not positive) finite
    ranges are hits, and +inf says nothing, because nobody knows how far the beam was free. ``time_increment_s`` is left
    to the caller: it alone knows how the sensor moved, and fills ``Scan.T_sensor_beam``.

    Raises RecordingError when the beams have no finite angles.
    """
    ranges = message.ranges_m.astype(np.float32)  # aligned and our own, unlike the view into the chunk
    directions = beam_directions(message.angle_min_rad, message.angle_increment_rad, len(ranges))
    with np.errstate(invalid="ignore", over="ignore"):
        limit = np.float32(message.range_max_m)
        if not (np.isfinite(limit) and limit > 0):
            limit = np.float32(np.inf)
        free = ranges >= limit
        silent = ~(ranges > 0) | (ranges < np.float32(message.range_min_m))  # never true for NaN
    ranges[free] = limit
    ranges[silent | np.isinf(ranges)] = np.nan
    ranges.setflags(write=False)
    return Scan(directions, ranges, ~free)


@lru_cache(maxsize=256)
def beam_directions(angle_min_rad: float, angle_increment_rad: float, beams: int) -> NDArray[np.float64]:
    """(n, 2) unit vectors of the beams, counter-clockwise from x; one read-only array per geometry.

    Raises RecordingError when an angle is not finite.
    """
    if not (math.isfinite(angle_min_rad) and math.isfinite(angle_increment_rad)):
        raise RecordingError(
            f"a scan's angles must be finite, found a start of {angle_min_rad} and a step of {angle_increment_rad} rad"
        )
    angles = angle_min_rad + angle_increment_rad * np.arange(beams)
    directions = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    directions.setflags(write=False)
    return directions
