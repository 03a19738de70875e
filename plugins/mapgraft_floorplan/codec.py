"""Floor plans as bytes. Equal layers give equal bytes.

A line of JSON (format, observations, scale_known, sensors, number of own and of baked-in pieces), then little-endian
int32: the rows and the counts of the own pieces, and those of the baked-in ones.
"""

from __future__ import annotations

import json

import numpy as np

from mapgraft.contracts import MapError
from mapgraft_floorplan.layer import PlanLayer, Walls
from mapgraft_floorplan.plan import MOST_SEGMENTS
from mapgraft_floorplan.region import keys_of

_FORMAT = "mapgraft-floor-plan 1"
_BYTES = 20  # of one piece: four positions and a count


def encode(layer: PlanLayer) -> bytes:
    header = {
        "format": _FORMAT,
        "observations": layer.observations,
        "scale_known": layer.scale_known,
        "sensors": sorted(layer.sensors),
        "walls": [len(layer.walls.rows), len(layer.absorbed.rows)],
    }
    parts = [json.dumps(header, sort_keys=True).encode(), b"\n"]
    for walls in (layer.walls, layer.absorbed):
        parts += [walls.rows.astype("<i4").tobytes(), walls.counts.astype("<i4").tobytes()]
    return b"".join(parts)


def decode(data: bytes) -> PlanLayer:
    """The layer in the bytes; raises MapError when they are not what ``encode`` writes."""
    line, newline, body = data.partition(b"\n")
    try:
        header = json.loads(line)
        if not newline or header["format"] != _FORMAT:
            raise MapError(f"this is no floor plan of format {_FORMAT!r}, found {line[:60]!r}")
        own, baked = (int(n) for n in header["walls"])
        observations, known = int(header["observations"]), bool(header["scale_known"])
        sensors = frozenset(map(str, header["sensors"]))
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
        raise MapError(f"this is no floor plan, found {line[:60]!r}") from None
    if min(own, baked, observations) < 0 or own > MOST_SEGMENTS or len(body) != _BYTES * (own + baked):
        raise MapError(f"a floor plan of {own} + {baked} walls is cut off or damaged: found {len(body)} bytes of walls")
    layer = PlanLayer(_walls(body, own), _walls(body[_BYTES * own :], baked), known, observations, sensors)
    if encode(layer) != data:
        raise MapError("a floor plan is written in one way only, found another: the bytes are damaged")
    return layer


def _walls(body: bytes, n: int) -> Walls:
    numbers = np.frombuffer(body, "<i4", 5 * n).astype(np.int32)
    rows, counts = numbers[: 4 * n].reshape(n, 4).copy(), numbers[4 * n :].copy()
    keys = keys_of(rows)
    if (counts < 1).any() or not np.array_equal(np.unique(keys), keys):
        raise MapError("a floor plan has each wall once, in order, with a count of at least 1: the bytes are damaged")
    return Walls(rows, counts)
