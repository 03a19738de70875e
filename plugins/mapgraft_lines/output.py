"""How maps of line segments are shown and written to files."""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import OutputMessage, Points
from mapgraft_lines.line_map import LineMap
from mapgraft_lines.walls import SLOT_MASK, Walls, cell_corners_m

FORMAT: Final = "mapgraft line segments 1"
_LINE_LIST, _CUBE_LIST = 5, 6  # visualization_msgs/Marker
_WIDTH_M: Final = {"walls": 0.05, "own": 0.02, "received": 0.02}
_COLOURS: Final = {
    "walls": (0.1, 0.1, 0.1, 1.0),
    "own": (0.12, 0.47, 0.71, 1.0),
    "received": (1.0, 0.5, 0.05, 1.0),
    "free": (0.75, 0.85, 0.95, 0.4),
}
_RAISED_M: Final = {"free": -0.02, "walls": 0.0, "own": 0.02, "received": 0.02}
_SVG_MARGIN_M: Final = 0.5


def markers(map_: LineMap) -> OutputMessage:
    """A ``visualization_msgs/msg/MarkerArray`` of line lists, one namespace each.

    ``walls`` are the walls of the map; where something was received, ``own`` and ``received`` are the segments of
    either side that lie on them. ``free`` are the cells that were looked through (cubes).
    """
    shown = [_lines("walls", map_.walls)]
    if not map_.received.is_empty:
        shown += [_lines(side, map_.side(side)) for side in ("own", "received")]
    middles = cell_corners_m(_free_keys(map_), map_.cell_m) + 0.5 * map_.cell_m
    free = {
        **_marker("free", _CUBE_LIST, (map_.cell_m, map_.cell_m, 0.01)),
        "points": _points(middles, _RAISED_M["free"]),
    }
    return OutputMessage("lines", "visualization_msgs/msg/MarkerArray", {"markers": [*shown, free]})


def _lines(name: str, walls: Walls) -> dict[str, object]:
    marker = _marker(name, _LINE_LIST, (_WIDTH_M[name], 0.0, 0.0))
    return {**marker, "points": _points(walls.ends_m.reshape(-1, 2), _RAISED_M[name])}


def _marker(name: str, kind: int, scale: tuple[float, float, float]) -> dict[str, object]:
    r, g, b, a = _COLOURS[name]
    return {
        "ns": name,
        "id": 0,
        "type": kind,
        "action": 0,
        "pose": {"orientation": {"w": 1.0}},
        "scale": dict(zip("xyz", scale, strict=True)),
        "color": {"r": r, "g": g, "b": b, "a": a},
    }


def _points(points: Points, z_m: float) -> list[dict[str, float]]:
    return [{"x": x, "y": y, "z": z_m} for x, y in points.tolist()]


def geojson(map_: LineMap) -> bytes:
    """A GeoJSON FeatureCollection in metres of the map frame, which is no place on Earth.

    One LineString per wall with ``kind`` ``wall``, ``sigma_m``, ``sigma_rad``, ``looks``, ``faced`` (the seen side is
    on the left) and ``own_share``; where something was received, one of ``kind`` ``own`` or ``received`` for each
    segment of either side with ``walls``, the ids of the walls on which it lies; and one MultiPolygon of ``kind``
    ``free``. ``read`` reads walls and free space back.
    """
    features = _features("wall", "w", map_.walls, None)
    if not map_.received.is_empty:
        for side in ("own", "received"):
            on: dict[int, list[str]] = {}
            for wall, segment in map_.links(side).tolist():
                on.setdefault(segment, []).append(f"w{wall}")
            features += _features(side, side[0], map_.side(side), on)
    rectangles = free_rectangles_m(map_)
    if len(rectangles):
        features.append(
            {
                "type": "Feature",
                "id": "free",
                "properties": {"kind": "free", "cell_m": map_.cell_m},
                "geometry": {"type": "MultiPolygon", "coordinates": [[_ring(row)] for row in rectangles.tolist()]},
            }
        )
    head = {"type": "FeatureCollection", "format": FORMAT, "unit": "m"}
    lines = ",\n".join(json.dumps(feature, separators=(",", ":")) for feature in features)
    return (json.dumps(head)[:-1] + ', "features": [\n' + lines + "\n]}\n").encode()


def _features(kind: str, letter: str, walls: Walls, on: dict[int, list[str]] | None) -> list[dict[str, Any]]:
    out = []
    for number, ((x0, y0), (x1, y1)) in enumerate(walls.ends_m.tolist()):
        told: dict[str, Any] = {
            "kind": kind,
            "sigma_m": _rounded(walls.sigma_m[number]),
            "sigma_rad": _rounded(walls.sigma_rad[number]),
            "looks": _rounded(walls.looks[number]),
            "faced": bool(walls.faced[number]),
        }
        told |= {"own_share": _rounded(walls.own_share[number])} if on is None else {"walls": on.get(number, [])}
        line = [[_rounded(x0), _rounded(y0)], [_rounded(x1), _rounded(y1)]]
        geometry = {"type": "LineString", "coordinates": line}
        out.append({"type": "Feature", "id": f"{letter}{number}", "properties": told, "geometry": geometry})
    return out


def free_rectangles_m(map_: LineMap) -> NDArray[np.float64]:
    """Free space as rectangles (k, 4) x0, y0, x1, y1 in metres: runs of cells along y, column by column."""
    keys = _free_keys(map_)
    if not len(keys):
        return np.empty((0, 4))
    corners = cell_corners_m(keys, map_.cell_m)
    first = np.flatnonzero(np.diff(keys, prepend=keys[0] - 1) != SLOT_MASK + 1)
    last = np.append(first[1:], len(keys)) - 1
    return np.column_stack((corners[first], corners[last] + map_.cell_m))


def _free_keys(map_: LineMap) -> NDArray[np.int64]:
    keys = map_.total.space.keys
    held: NDArray[np.int64] = np.setdiff1d(keys, map_.standing_keys() & ~SLOT_MASK)
    return held


def _ring(row: list[float]) -> list[list[float]]:
    x0, y0, x1, y1 = row
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


def _rounded(value: float) -> float:
    return round(float(value), 4) + 0.0


def svg(map_: LineMap) -> bytes:
    """A drawing, one unit per metre, y up: free space pale, walls black, and the received ones orange."""
    rectangles, walls = free_rectangles_m(map_), map_.walls
    corners = np.concatenate((rectangles.reshape(-1, 2), walls.ends_m.reshape(-1, 2)))
    if not len(corners):
        corners = cell_corners_m(map_.known_keys(), map_.cell_m)
    (x0, y0), (x1, y1) = corners.min(axis=0) - _SVG_MARGIN_M, corners.max(axis=0) + _SVG_MARGIN_M
    boxes = "".join(f"M{a:.3f} {b:.3f}H{c:.3f}V{d:.3f}H{a:.3f}Z" for a, b, c, d in rectangles.tolist())
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{x0:.3f} {-y1:.3f} {x1 - x0:.3f} {y1 - y0:.3f}" '
        f'width="{x1 - x0:.3f}m" height="{y1 - y0:.3f}m">'.replace('m"', '"'),
        f'<g transform="scale(1 -1)"><path id="free" d="{boxes}" fill="#dbe7f3"/>',
        _strokes("walls", walls.ends_m[walls.own_share > 0.0], "#111111"),
        _strokes("received", walls.ends_m[walls.own_share <= 0.0], "#ff7f0e"),
        "</g></svg>\n",
    ]
    return "\n".join(parts).encode()


def _strokes(name: str, ends: NDArray[np.float64], colour: str) -> str:
    lines = "".join(f"M{x0:.4f} {y0:.4f}L{x1:.4f} {y1:.4f}" for x0, y0, x1, y1 in ends.reshape(-1, 4).tolist())
    return f'<path id="{name}" d="{lines}" fill="none" stroke="{colour}" stroke-width="0.06" stroke-linecap="round"/>'
