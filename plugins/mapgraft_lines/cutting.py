"""Layers in parts, for others who have most of them: one with what is said once, and of each few cells their rows."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError
from mapgraft_lines.codec import COLUMNS, header_of, layer_of, tables_of
from mapgraft_lines.kernels.keys import INDEX_BITS, SLOT_BITS
from mapgraft_lines.layer import LineLayer
from mapgraft_lines.table import Table

_HEAD: Final = b"h"
_NAME: Final = struct.Struct(">Bq")  # which table, and the square
_SIDE_BITS: Final = 4  # a square is 16 × 16 cells: 4 m of cells of 0.25 m
_AXIS: Final = ((1 << INDEX_BITS) - 1) >> _SIDE_BITS << _SIDE_BITS
_MASK: Final = (_AXIS << INDEX_BITS | _AXIS) << SLOT_BITS
_ITEM: Final = 8


def cut(layer: LineLayer) -> dict[bytes, bytes]:
    """A layer as parts, little-endian int64: ``h`` the header as ``encode`` writes it, with no rows; and with the
    table's number (own pieces, own space, absorbed pieces, absorbed space) and the square's key for a name, the keys of
    one square's rows and their columns one after the other."""
    parts = {_HEAD: header_of(layer, [0] * len(COLUMNS))}
    for number, table in enumerate(tables_of(layer)):
        for square, rows in _squares(table):
            parts[_NAME.pack(number, square)] = np.ascontiguousarray(rows.T, "<i8").tobytes()
    return parts


def join(parts: Mapping[bytes, bytes]) -> LineLayer:
    """The layer of these parts; raises MapError when they are not exactly what ``cut`` makes of one."""
    try:
        rows: list[list[NDArray[np.int64]]] = [[] for _ in COLUMNS]
        for name in sorted(parts.keys() - {_HEAD}):
            number, _ = _NAME.unpack(name)
            told = np.frombuffer(parts[name], "<i8").reshape(1 + COLUMNS[number], -1).T
            rows[number].append(told.astype(np.int64))
        tables = [
            np.concatenate([*some, np.empty((0, 1 + n), np.int64)]) for some, n in zip(rows, COLUMNS, strict=True)
        ]
        layer = layer_of(json.loads(parts[_HEAD]), [table[np.argsort(table[:, 0], kind="stable")] for table in tables])
    except (ValueError, KeyError, TypeError, IndexError, struct.error, RecursionError) as fault:
        raise MapError(f"the parts of a map of line segments do not hold together ({fault}): send it again") from fault
    if cut(layer) != dict(parts):
        raise MapError("the parts of a map of line segments are not cut as written: send it again")
    return layer


def _squares(table: Table) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """The rows of each square: their keys and counts (n, 1 + columns)."""
    rows = np.column_stack((table.keys, table.counts))
    squares = table.keys & _MASK
    order = np.argsort(squares, kind="stable")
    found, first = np.unique(squares[order], return_index=True)
    yield from zip(found.tolist(), np.split(rows[order], first[1:]), strict=False)
