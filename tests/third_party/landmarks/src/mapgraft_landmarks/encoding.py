"""Landmark layers as bytes. Equal layers give equal bytes.

A line of JSON (format, cell size, observations, sensors, number of looked-at and of sighted cells), then little-endian
columns: ix and iy (int32) and looks (int64) of all cells, rows (uint32) and sightings, sum of x, sum of y (int64) of
the sighted ones.
"""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_landmarks.cells import COLUMNS, INDEX_LIMIT, LOOKS, SIGHTINGS, Cells, pack, unpack
from mapgraft_landmarks.layer import LandmarkLayer

_FORMAT = "mapgraft-landmarks 1"


def encode_layer(layer: LandmarkLayer) -> bytes:
    """The layer as bytes (see the module)."""
    counts = layer.cells.counts
    rows = np.flatnonzero(counts[:, SIGHTINGS])
    header = {
        "format": _FORMAT,
        "cell_m": layer.cell_m,
        "observations": layer.observations,
        "sensors": sorted(layer.sensors),
        "cells": len(layer.cells),
        "sighted": len(rows),
    }
    ix, iy = unpack(layer.cells.keys)
    columns = (
        ix.astype("<i4"),
        iy.astype("<i4"),
        counts[:, LOOKS].astype("<i8"),
        rows.astype("<u4"),
        counts[rows, SIGHTINGS:].astype("<i8"),
    )
    return json.dumps(header, sort_keys=True).encode() + b"\n" + b"".join(column.tobytes() for column in columns)


def decode_layer(data: bytes) -> LandmarkLayer:
    """The layer in the bytes; raises MapError when they are not what ``encode_layer`` writes."""
    line, newline, body = data.partition(b"\n")
    try:
        header = json.loads(line)
        if not newline or header["format"] != _FORMAT:
            raise MapError(f"this is no landmark map of format {_FORMAT!r}, found {line[:60]!r}")
        n, sighted = int(header["cells"]), int(header["sighted"])
        cell_m, observations = float(header["cell_m"]), int(header["observations"])
        sensors = frozenset(map(str, header["sensors"]))
    except (ValueError, KeyError, TypeError):
        raise MapError(f"this is no landmark map, found {line[:60]!r}") from None
    if n < 0 or sighted < 0 or not cell_m > 0 or len(body) != 16 * n + 28 * sighted:
        raise MapError(f"a landmark map of {n} cells is cut off or damaged: found {len(body)} bytes of evidence")
    return LandmarkLayer(cell_m, _decoded_cells(body, n, sighted), observations, sensors)


def _decoded_cells(body: bytes, n: int, sighted: int) -> Cells:
    ix, iy, looks, rows, rest = _columns(
        body, (("<i4", n), ("<i4", n), ("<i8", n), ("<u4", sighted), ("<i8", 3 * sighted))
    )
    if n and (max(np.abs(ix).max(), np.abs(iy).max()) > INDEX_LIMIT):
        raise MapError(f"a landmark map has cell indices up to {INDEX_LIMIT}, found more: the bytes are damaged")
    keys = pack(ix, iy)
    counts = np.zeros((n, COLUMNS), np.int64)
    counts[:, LOOKS] = looks
    if sighted and rows.max() >= n:
        raise MapError("a landmark map names a cell that it does not have: the bytes are damaged")
    counts[rows, SIGHTINGS:] = rest.reshape(sighted, 3)
    if (np.diff(keys) <= 0).any() or (np.diff(rows) <= 0).any() or (counts[:, : SIGHTINGS + 1] < 0).any():
        raise MapError("a landmark map has its cells in order and no negative counts: the bytes are damaged")
    return Cells(keys, counts)


def _columns(body: bytes, spec: tuple[tuple[str, int], ...]) -> Iterator[NDArray[np.int64]]:
    at = 0
    for dtype, length in spec:
        yield np.frombuffer(body, dtype, length, at).astype(np.int64)
        at += length * np.dtype(dtype).itemsize
