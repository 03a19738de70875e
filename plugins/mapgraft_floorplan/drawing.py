"""How plans are shown and written to files."""

from __future__ import annotations

import numpy as np

from mapgraft.contracts import EmptyMapError, OutputMessage
from mapgraft_floorplan.plan import Segments

MARKERS_TYPE = "visualization_msgs/msg/MarkerArray"
_LINE_LIST, _ADD, _DELETE_ALL = 5, 0, 3
_WIDTH_M = 0.05
_COLOUR = {"r": 0.45, "g": 0.3, "b": 0.75, "a": 1.0}
_MM = 1000.0
_MARGIN_M = 0.5


def markers(segments_m: Segments) -> OutputMessage:
    """The walls (n, 4) as one list of lines, after wiping what was drawn before."""
    points = [{"x": x, "y": y, "z": 0.0} for x, y in segments_m.reshape(-1, 2).tolist()]
    lines = {
        "ns": "walls",
        "type": _LINE_LIST,
        "action": _ADD,
        "pose": {"orientation": {"w": 1.0}},
        "scale": {"x": _WIDTH_M},
        "color": _COLOUR,
        "points": points,
    }
    return OutputMessage("plan", MARKERS_TYPE, {"markers": [{"action": _DELETE_ALL}, lines]})


def svg(segments_m: Segments) -> bytes:
    """The walls (n, 4) as an SVG drawing in millimetres, y upwards, its coordinates those of the plan's frame.

    Raises EmptyMapError when there are none.
    """
    if not len(segments_m):
        raise EmptyMapError("a floor plan without walls cannot be drawn: read a plan first")
    ends = segments_m.reshape(-1, 2)
    (x0, y0), (x1, y1) = ends.min(axis=0) - _MARGIN_M, ends.max(axis=0) + _MARGIN_M
    x, y, width, height = (_MM * value for value in (x0, -y1, x1 - x0, y1 - y0))
    mm = np.round(segments_m * _MM, 3)
    path = " ".join(f"M{a:.10g} {-b:.10g}L{c:.10g} {-d:.10g}" for a, b, c, d in mm.tolist())
    text = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.10g}mm" height="{height:.10g}mm" '
        f'viewBox="{x:.10g} {y:.10g} {width:.10g} {height:.10g}">\n'
        f'<path d="{path}" fill="none" stroke="black" stroke-width="{_WIDTH_M * _MM:g}"/>\n</svg>\n'
    )
    return text.encode()
