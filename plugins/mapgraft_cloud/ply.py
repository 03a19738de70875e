"""PLY files: the vertices of ASCII and binary ones, little- or big-endian, and a writer of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Points
from mapgraft_cloud.columns import Columns
from mapgraft_cloud.pcd import Encoding, lines_of
from mapgraft_cloud.text_numbers import numbers_in

_KINDS: Final = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_HEADER_LIMIT: Final = 1 << 16
_MOST_POINTS: Final = 1 << 31


@dataclass(slots=True)
class _Element:
    """A table of a PLY file; ``lists`` tells whether its rows are of different lengths."""

    name: str
    rows: int
    properties: list[tuple[str, str]] = field(default_factory=list)
    lists: bool = False

    def record(self, order: str) -> np.dtype[np.void]:
        return np.dtype([(name, order + kind) for name, kind in self.properties])


def read_ply(path: Path) -> Columns:
    """The columns of a PLY file's vertices; raises MapError when it cannot be read."""
    try:
        data = np.fromfile(path, np.uint8).data
    except OSError as error:
        raise MapError(f"{path.name} cannot be read: {error.strerror or error}") from error
    try:
        order, elements, start = _header(data)
        return _vertices(order, elements, data, start)
    except (ValueError, KeyError, IndexError, OverflowError, UnicodeDecodeError) as error:
        raise MapError(f"{path.name} is no PLY file that can be read: {error}") from error


def _header(data: memoryview) -> tuple[str, list[_Element], int]:
    head = bytes(data[:_HEADER_LIMIT])
    end = head.find(b"end_header")
    if not head.startswith(b"ply") or end < 0:
        raise ValueError("it does not begin with a header from 'ply' to 'end_header'")
    start = head.index(b"\n", end) + 1
    order, elements = "", list[_Element]()
    for line in head[:end].decode("ascii", "replace").splitlines()[1:]:
        words = line.split()
        if words[:1] == ["format"]:
            order = words[1]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2])))
        elif words[:2] == ["property", "list"]:
            elements[-1].lists = True
        elif words[:1] == ["property"]:
            if words[1] not in _KINDS:
                raise ValueError(f"it has a property of type {words[1]!r}, which PLY files do not have")
            elements[-1].properties.append((words[2], _KINDS[words[1]]))
    if order not in _ORDERS:
        raise ValueError(f"its format is {order!r}, not {', '.join(_ORDERS)}")
    return order, elements, start


def _vertices(order: str, elements: list[_Element], data: memoryview, start: int) -> Columns:
    at = next((k for k, element in enumerate(elements) if element.name == "vertex"), None)
    if at is None:
        raise ValueError(f"it has no vertices, only {', '.join(e.name for e in elements) or 'nothing'}")
    vertex, before = elements[at], elements[:at]
    if vertex.lists or any(element.lists for element in before):
        raise ValueError("it has lists in or before its vertices: write the vertices first, without lists")
    if not 0 <= vertex.rows <= _MOST_POINTS:
        raise ValueError(f"it announces {vertex.rows} vertices")
    if order == "ascii":
        skipped = sum(element.rows * len(element.properties) for element in before)
        text = bytes(data[start:])
        if skipped:
            text = text.split(maxsplit=skipped)[-1]
        table = numbers_in(text, vertex.rows, len(vertex.properties))
        return {name: table[:, k].astype(kind) for k, (name, kind) in enumerate(vertex.properties)}
    sign = _ORDERS[order]
    start += sum(element.rows * element.record(sign).itemsize for element in before)
    record = vertex.record(sign)
    if len(data) - start < vertex.rows * record.itemsize:
        raise ValueError(f"it needs {vertex.rows * record.itemsize} bytes of vertices, has {len(data) - start}")
    points = np.frombuffer(data, record, vertex.rows, start)
    return {name: points[name] for name, _ in vertex.properties}


def ply_bytes(points_m: Points, intensities: NDArray[np.float32] | None = None, encoding: Encoding = "binary") -> bytes:
    """Points (n, 3), and the intensities (n,) where given, as a PLY file."""
    columns: Mapping[str, NDArray[np.floating]] = {axis: points_m[:, i] for i, axis in enumerate("xyz")}
    if intensities is not None:
        columns = {**columns, "intensity": intensities}
    table = np.column_stack(list(columns.values())).astype("<f4").reshape(len(points_m), len(columns))
    form = "ascii" if encoding == "ascii" else "binary_little_endian"
    properties = "".join(f"property float {name}\n" for name in columns)
    head = f"ply\nformat {form} 1.0\nelement vertex {len(table)}\n{properties}end_header\n"
    return head.encode() + (lines_of(table) if encoding == "ascii" else table.tobytes())
