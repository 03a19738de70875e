"""Ready-made maps of line segments from GeoJSON files, as mapgraft writes them or as others draw walls."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError, MapError, Points
from mapgraft_lines.map_type import SegmentMap
from mapgraft_lines.output import FORMAT

LARGEST_FILE: Final = 512_000_000  # bytes
MOST_SEGMENTS: Final = 5_000_000
MOST_FREE: Final = 50_000_000  # places
SIGMA_M: Final = 0.02  # of segments that tell none
_OURS: Final = ("own", "received")  # segments of the sides of a merged map: the walls say it all


def read(path: str | Path, *, sigma_m: float | None = None) -> SegmentMap:
    """The segments of a GeoJSON file in metres: LineString and MultiLineString, the outlines of Polygons.

    A feature's ``sigma_m``, ``faced`` and ``looks`` are taken where it has them; ``sigma_m`` here goes before them, and
    stands for those that tell none (0.02 m). Polygons of ``kind`` ``free`` are free space. Raises MapError when the
    file is missing, no GeoJSON, tells of places on Earth, or holds nothing of this; ConfigError when ``sigma_m`` is
    wrong.
    """
    path = Path(path)
    if sigma_m is not None and not 1e-4 <= sigma_m <= 1.0:
        raise ConfigError(f"sigma_m must lie in 0.0001 … 1 m, found {sigma_m!r}")
    document = _parsed(path)
    segments, told, free = _Segments(), [], list[Points]()
    for feature in _features(document, path):
        properties, geometry = _properties(feature), feature.get("geometry") or {}
        if properties.get("kind") in _OURS:
            continue
        if properties.get("kind") == "free":
            free.append(_free(geometry, properties, path))
            continue
        before = len(segments)
        for line in _lines(geometry, path):
            segments.add(line, path)
        told += [_told(properties, sigma_m, path)] * (len(segments) - before)
    if not told:
        raise MapError(f"{path.name} holds no line: walls are LineString features in metres; check its layer")
    points = np.concatenate(segments.parts)
    if document.get("format") != FORMAT:
        _require_metres(document, points, path)
    table = np.array(told, np.float64)
    places = np.concatenate(free) if free else np.empty((0, 2))
    return SegmentMap(points, table[:, 0], table[:, 1] > 0.5, table[:, 2].astype(np.int64), places)


class _Segments:
    """The segments of lines, collected."""

    def __init__(self) -> None:
        self.parts: list[NDArray[np.float64]] = []
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, line: Any, path: Path) -> None:
        """The segments between the points of a line; MapError when it is none, or there are too many."""
        try:
            points = np.array([[float(x), float(y)] for x, y, *_ in line])
        except (TypeError, ValueError) as fault:
            raise MapError(f"{path.name} has a line that is no list of x, y: {str(line)[:60]}") from fault
        if len(points) < 2 or not np.isfinite(points).all():
            raise MapError(f"{path.name} has a line with {len(points)} finite points, a line has two: {str(line)[:60]}")
        self._count += len(points) - 1
        if self._count > MOST_SEGMENTS:
            raise MapError(f"{path.name} holds more than {MOST_SEGMENTS} segments: simplify it or take a part of it")
        self.parts.append(np.stack((points[:-1], points[1:]), axis=1))


def _parsed(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise MapError(f"{path.name} is larger than {LARGEST_FILE} bytes: simplify it or take a part of it")
        document = json.loads(path.read_bytes())
    except OSError as fault:
        raise MapError(f"{path} cannot be read: {fault.strerror}") from fault
    except (ValueError, RecursionError) as fault:
        raise MapError(f"{path.name} is no GeoJSON ({str(fault)[:80]})") from fault
    if not isinstance(document, dict) or not isinstance(document.get("features"), list):
        raise MapError(f"{path.name} is no GeoJSON FeatureCollection: 'features' is missing")
    return document


def _features(document: Mapping[str, Any], path: Path) -> Iterator[Mapping[str, Any]]:
    for feature in document["features"]:
        if not isinstance(feature, dict) or not isinstance(feature.get("geometry") or {}, dict):
            raise MapError(f"{path.name} has a feature without geometry: {str(feature)[:60]}")
        yield feature


def _properties(feature: Mapping[str, Any]) -> Mapping[str, Any]:
    found = feature.get("properties")
    return found if isinstance(found, dict) else {}


def _lines(geometry: Mapping[str, Any], path: Path) -> Iterator[Any]:
    """The lines of a geometry; nothing of what has none."""
    kind, coordinates = geometry.get("type"), geometry.get("coordinates", [])
    if not isinstance(coordinates, list):
        raise MapError(f"{path.name} has a {kind} whose coordinates are no list")
    if kind == "LineString":
        yield coordinates
    elif kind in ("MultiLineString", "Polygon"):
        yield from coordinates
    elif kind == "MultiPolygon":
        for polygon in coordinates:
            yield from polygon


def _told(properties: Mapping[str, Any], sigma_m: float | None, path: Path) -> tuple[float, float, float]:
    """Standard deviation, whether a side is known, looks."""
    try:
        sigma = sigma_m if sigma_m is not None else float(properties.get("sigma_m", SIGMA_M))
        looks = float(properties.get("looks", 1.0))
    except (TypeError, ValueError) as fault:
        raise MapError(f"{path.name} has a line whose sigma_m or looks is no number: {fault}") from fault
    if not 1e-4 <= sigma <= 1.0 or not 0.0 <= looks <= 1 << 20:
        raise MapError(
            f"{path.name} has a line with sigma_m {sigma:g} and looks {looks:g}: a standard deviation lies in "
            "0.0001 … 1 m, and looks are counted"
        )
    return sigma, float(properties.get("faced") is True), max(round(looks), 1)


def _free(geometry: Mapping[str, Any], properties: Mapping[str, Any], path: Path) -> Points:
    """Places in the rectangles of free space, one in each of their cells."""
    parts = [np.empty((0, 2))]
    try:
        cell_m = float(properties["cell_m"])
        rings = np.array([polygon[0] for polygon in geometry["coordinates"]], np.float64)
        low, high = rings.min(axis=1), rings.max(axis=1)
    except (KeyError, TypeError, ValueError, IndexError) as fault:
        raise MapError(f"{path.name} has free space that is no MultiPolygon of rectangles with a cell_m") from fault
    counts = np.rint((high - low) / cell_m) if cell_m > 0.0 else np.full((1, 2), math.inf)
    if not (np.isfinite(counts).all() and counts.prod(axis=1).sum() <= MOST_FREE):
        raise MapError(f"{path.name} has more than {MOST_FREE} cells of free space, of {cell_m:g} m: check its unit")
    for corner, (across, up) in zip(low, counts.astype(np.int64).tolist(), strict=True):
        places = np.stack(np.meshgrid(np.arange(across), np.arange(up), indexing="ij"), axis=-1).reshape(-1, 2)
        parts.append(corner + (places + 0.5) * cell_m)
    return np.concatenate(parts)


def _require_metres(document: Mapping[str, Any], points: NDArray[np.float64], path: Path) -> None:
    """MapError for places on Earth: GeoJSON means longitudes and latitudes unless somebody says otherwise."""
    named = str(document.get("crs", ""))
    spread = np.ptp(points.reshape(-1, 2), axis=0)
    if "unit" not in document and ("CRS84" in named or "4326" in named or (spread < 0.05).all()):
        raise MapError(
            f"{path.name} spans {spread[0]:.3g} × {spread[1]:.3g}, in degrees probably: project it to metres, or say "
            '"unit": "m" in it'
        )
