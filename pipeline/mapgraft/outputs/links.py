"""Lines between merged robots, for viewers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mapgraft.outputs.standing import StandingMerge

MARKERS_TYPE = "visualization_msgs/msg/MarkerArray"
_LINE_STRIP, _ADD, _DELETE_ALL = 4, 0, 3
_WIDTH_M = 0.1
_COLOURS = {  # red, green, blue, alpha
    "confirmed": (0.1, 0.65, 0.3, 1.0),
    "provisional": (0.95, 0.6, 0.1, 1.0),
}


def link_markers(merges: Sequence[StandingMerge], ends_m: Mapping[str, NDArray[np.float64]]) -> dict[str, object]:
    """The fields of a MarkerArray that wipes what was drawn before and draws one line per standing merge.

    ``ends_m`` are (3,) positions of the robots in the frame of the message; a merge without both is left out.
    """
    lines = [
        _line(merge, ends_m[merge.receiver], ends_m[merge.donor])
        for merge in merges
        if merge.receiver in ends_m and merge.donor in ends_m
    ]
    return {"markers": [{"action": _DELETE_ALL}, *lines]}


def _line(merge: StandingMerge, receiver_m: NDArray[np.float64], donor_m: NDArray[np.float64]) -> dict[str, object]:
    r, g, b, a = _COLOURS.get(merge.state, _COLOURS["provisional"])
    points = [dict(zip("xyz", end.tolist(), strict=True)) for end in (receiver_m, donor_m)]
    return {
        "ns": merge.merge_id,
        "type": _LINE_STRIP,
        "action": _ADD,
        "scale": {"x": _WIDTH_M},
        "color": {"r": r, "g": g, "b": b, "a": a},
        "points": points,
    }
