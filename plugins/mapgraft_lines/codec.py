"""Layers as bytes: canonical, compressed, and checked when they come back.

``MGLINES`` and a version, then one zstd frame: a line of JSON (size of the cells, observations, sensors, mapper, rows
of the four tables: own pieces and space, absorbed pieces and space), then of each table its keys as differences and
its columns one after the other, little-endian int64. Tables are sorted and have no empty rows, so that equal layers
have equal bytes.
"""

from __future__ import annotations

import json
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import ConfigError
from mapgraft_lines.kernels.keys import INDEX_BITS, SLOT_BITS, SLOTS
from mapgraft_lines.layer import (
    CONVERTED,
    FROM_SCANS,
    LOOKS,
    PIECE_COLUMNS,
    READY_MADE,
    SPACE_COLUMNS,
    Evidence,
    LineLayer,
    W,
)
from mapgraft_lines.parameters import cell
from mapgraft_lines.table import Counts, Table
from mapgraft_standard.frames import Frame

_FRAME: Final = Frame("map of line segments", b"MGLINES", 1, 1 << 32)  # 50 million rows
_MAPPERS: Final = ("", FROM_SCANS, READY_MADE, CONVERTED)
_COLUMNS: Final = (PIECE_COLUMNS, SPACE_COLUMNS, PIECE_COLUMNS, SPACE_COLUMNS)
_SLOT_MASK: Final = (1 << SLOT_BITS) - 1
_ITEM: Final = 8  # bytes of a number


def encode(layer: LineLayer) -> bytes:
    """Canonical bytes of a layer: equal evidence gives equal bytes, however it came together."""
    tables = (layer.own.pieces, layer.own.space, layer.absorbed.pieces, layer.absorbed.space)
    header = {
        "cell_m": layer.cell_m,
        "mapper": layer.mapper,
        "observations": layer.observations,
        "rows": [len(table) for table in tables],
        "sensors": sorted(layer.sensors),
    }
    columns = [column for table in tables for column in (_steps(table.keys), *table.counts.T)]
    body = b"".join(np.ascontiguousarray(column, "<i8").tobytes() for column in columns)
    payload = json.dumps(header, sort_keys=True, ensure_ascii=True).encode() + b"\n" + body
    return _FRAME.head + _FRAME.packer().compress(payload)


def decode(data: bytes) -> LineLayer:
    """The layer of these bytes; raises MapError when they are not exactly what ``encode`` makes."""
    line, newline, body = bytes(_FRAME.unpacked(data)).partition(b"\n")
    try:
        layer = _layer(json.loads(line), body)
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError, ConfigError) as fault:
        raise _FRAME.damaged(fault) from fault
    if not newline or encode(layer) != data:
        raise _FRAME.damaged("its parts are not as written")
    return layer


def _layer(header: Any, body: bytes) -> LineLayer:
    cell_m, rows = cell(float(header["cell_m"])), [int(count) for count in header["rows"]]
    if len(rows) != len(_COLUMNS) or min(rows) < 0:
        raise ValueError(f"cells of {cell_m} m, tables of {rows} rows")
    if _ITEM * sum(n * (1 + columns) for n, columns in zip(rows, _COLUMNS, strict=True)) != len(body):
        raise ValueError(f"tables of {rows} rows in {len(body)} bytes")
    if header["mapper"] not in _MAPPERS or int(header["observations"]) < 0:
        raise ValueError(f"the mapper {header['mapper']!r} after {header['observations']} observations")
    tables, at = [], 0
    for n, columns in zip(rows, _COLUMNS, strict=True):
        numbers = np.frombuffer(body, "<i8", n * (1 + columns), at).astype(np.int64).reshape(1 + columns, n)
        at += _ITEM * numbers.size
        tables.append(_table(np.cumsum(numbers[0]), np.ascontiguousarray(numbers[1:].T), columns))
    return LineLayer(
        cell_m,
        Evidence(tables[0], tables[1]),
        Evidence(tables[2], tables[3]),
        int(header["observations"]),
        frozenset(map(str, header["sensors"])),
        header["mapper"],
    )


def _table(keys: NDArray[np.int64], counts: Counts, columns: int) -> Table:
    """A table whose rows can be what they are said to be; ValueError otherwise."""
    if len(keys):
        slots = keys & _SLOT_MASK
        wrong_slot = ((slots < 1) | (slots >= SLOTS)).any() if columns == PIECE_COLUMNS else slots.any()
        if (np.diff(keys) <= 0).any() or keys[0] < 0 or keys[-1] >> (2 * INDEX_BITS + SLOT_BITS) or wrong_slot:
            raise ValueError("rows out of order")
        if (counts[:, LOOKS] < 1).any() or (columns == PIECE_COLUMNS and (counts[:, W] < 1).any()):
            raise ValueError("rows without evidence")
    return Table(keys, counts)


def _steps(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.diff(keys, prepend=np.int64(0))
