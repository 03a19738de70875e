"""What has to be known of a whole CARMEN log before its lines can be understood."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

SICK_ERROR_M = 81.8
"""A SICK LMS reports its error codes as 8183 to 8191 cm: nothing seen, dazzled, out of range."""

_BIN_M = 0.01
_BINS = 20_000
_FEWEST = 20
_DOMINANCE = 10


@dataclass(slots=True)
class RangeSurvey:
    """How often each range, to a centimetre, was read by one laser, and the largest maximum that its lines state."""

    histogram: NDArray[np.int64] = field(default_factory=lambda: np.zeros(_BINS, np.int64))
    stated_max_m: float = math.inf

    def see(self, ranges_m: NDArray[np.float32], stated_max_m: float) -> None:
        finite = ranges_m[np.isfinite(ranges_m) & (ranges_m > 0)]
        centimetres = np.minimum(np.round(finite / _BIN_M), _BINS - 1).astype(np.int64)
        np.add.at(self.histogram, centimetres, 1)
        self.stated_max_m = stated_max_m

    @property
    def no_return_m(self) -> float:
        """From which range on a reading means that nothing was seen; inf where the log does not tell.

        The error codes of a SICK LMS if there are any; else a value among the longest that dominates them, because
        real ranges never pile up on one centimetre; never more than the laser itself states.
        """
        filled = np.flatnonzero(self.histogram)
        if not len(filled):
            return self.stated_max_m
        longest = int(filled[-1])
        if longest * _BIN_M >= SICK_ERROR_M - _BIN_M / 2:
            return min(SICK_ERROR_M, self.stated_max_m)
        first = int(0.8 * longest)
        tail = self.histogram[first:]
        peak = int(np.argmax(tail))
        others = np.delete(tail, slice(max(peak - 1, 0), peak + 2))
        rival = int(others.max()) if len(others) else 0
        if tail[peak] >= _FEWEST and tail[peak] >= _DOMINANCE * rival:
            return min((first + peak - 0.5) * _BIN_M, self.stated_max_m)
        return self.stated_max_m
