"""PCD files, the point clouds of PCL: read as ASCII, binary and compressed binary, written as the first two."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from mapgraft.contracts import MapError, Points
from mapgraft_cloud.columns import Columns
from mapgraft_cloud.text_numbers import numbers_in

Encoding = Literal["ascii", "binary"]
SeenFrom = tuple[float, ...] | None  # VIEWPOINT: x, y, z, and the quaternion w, x, y, z; None where it says nothing

_NOWHERE: Final = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # what is written where nobody knows a viewpoint
_KINDS: Final = {"F": "f", "I": "i", "U": "u"}
_NUMBERS: Final = frozenset({("F", "4"), ("F", "8"), *((kind, size) for kind in "IU" for size in "1248")})
_LZF_MOST: Final = 88  # times: three bytes stand for at most 264
_HEADER_LIMIT: Final = 1 << 16  # bytes in which a header must end
_MOST_POINTS: Final = 1 << 31


@dataclass(frozen=True, slots=True)
class _Header:
    """What a PCD says of its points: ``record`` is one point as binary data have it."""

    record: np.dtype[np.void]
    points: int
    data: str
    start: int
    seen_from: SeenFrom

    @property
    def columns(self) -> list[tuple[str, str]]:
        """Name and type of every field of one number."""
        return [(name, self.record[name].str) for name in self.record.names or () if not self.record[name].shape]


def read_pcd(path: Path) -> tuple[Columns, SeenFrom]:
    """The columns of a PCD file, fields of several numbers left out, and where it says that it was seen from.

    Raises MapError when it cannot be read.
    """
    data = _bytes_of(path)
    try:
        header = _header(data)
        return _columns(header, data), header.seen_from
    except (ValueError, KeyError, IndexError, OverflowError, struct.error, UnicodeDecodeError) as error:
        raise MapError(f"{path.name} is no PCD file that can be read: {error}") from error


def _bytes_of(path: Path) -> memoryview:
    try:
        return np.fromfile(path, np.uint8).data
    except OSError as error:
        raise MapError(f"{path.name} cannot be read: {error.strerror or error}") from error


def _header(data: memoryview) -> _Header:
    said: dict[str, list[str]] = {}
    place = 0
    while "DATA" not in said:
        end = bytes(data[place : place + _HEADER_LIMIT]).find(b"\n")
        if end < 0 or place > _HEADER_LIMIT:
            raise ValueError("its header has no line DATA")
        words = bytes(data[place : place + end]).decode("ascii", "strict").split()
        place += end + 1
        if words and not words[0].startswith("#"):
            said[words[0].upper()] = words[1:]
    for name in ("FIELDS", "SIZE", "TYPE"):
        if name not in said:
            raise ValueError(f"its header has no line {name}")
    fields, counts = said["FIELDS"], [int(n) for n in said.get("COUNT", ["1"] * len(said["FIELDS"]))]
    if not len(fields) == len(said["SIZE"]) == len(said["TYPE"]) == len(counts) or min(counts, default=0) < 1:
        raise ValueError("FIELDS, SIZE, TYPE and COUNT are not of one length")
    width, height = int(said.get("WIDTH", ["0"])[0]), int(said.get("HEIGHT", ["1"])[0])
    points = int(said.get("POINTS", [str(width * height)])[0])
    if not 0 <= points <= _MOST_POINTS:
        raise ValueError(f"it announces {points} points")
    for kind, size in zip(said["TYPE"], said["SIZE"], strict=True):
        if (kind.upper(), size) not in _NUMBERS:
            raise ValueError(f"it has numbers of TYPE {kind} and SIZE {size}, which PCD files do not have")
    record = np.dtype(
        [
            (name if name != "_" else f"_padding_{k}", f"<{_KINDS[kind.upper()]}{size}", (n,) if n > 1 else ())
            for k, (name, kind, size, n) in enumerate(zip(fields, said["TYPE"], said["SIZE"], counts, strict=True))
        ]
    )
    viewpoint = tuple(float(word) for word in said.get("VIEWPOINT", []))
    seen_from = viewpoint if len(viewpoint) == len(_NOWHERE) and viewpoint != _NOWHERE else None
    return _Header(record, points, said["DATA"][0].lower(), place, seen_from)


def _columns(header: _Header, data: memoryview) -> Columns:
    if header.data == "ascii":
        return _ascii(header, data)
    if header.data == "binary":
        needed = header.points * header.record.itemsize
        if len(data) - header.start < needed:
            raise ValueError(f"it needs {needed} bytes of points, has {len(data) - header.start}")
        table = np.frombuffer(data, header.record, header.points, header.start)
        return {name: table[name] for name, _ in header.columns}
    if header.data == "binary_compressed":
        return _compressed(header, data)
    raise ValueError(f"its DATA are {header.data!r}, not ascii, binary or binary_compressed")


def _ascii(header: _Header, data: memoryview) -> Columns:
    widths = [max(1, int(np.prod(header.record[name].shape))) for name in header.record.names or ()]
    table = numbers_in(bytes(data[header.start :]), header.points, sum(widths))
    starts = dict(zip(header.record.names or (), np.cumsum([0, *widths[:-1]]).tolist(), strict=True))
    columns: dict[str, NDArray[np.generic]] = {}
    for name, kind in header.columns:
        values = table[:, starts[name]]
        packed = name in ("rgb", "rgba") and kind == "<f4" and bool((np.nan_to_num(values) > 1.0).any())
        columns[name] = values.astype(np.uint32) if packed else values.astype(kind)
    return columns


def _compressed(header: _Header, data: memoryview) -> Columns:
    """All values of the first field, then of the second, and so on; the whole packed by LZF."""
    from mapgraft_cloud.kernels import lzf  # compiles

    packed, unpacked = struct.unpack_from("<II", data, header.start)
    if unpacked != header.points * header.record.itemsize:
        raise ValueError(f"it unpacks to {unpacked} bytes, {header.points} points need others")
    if unpacked > _LZF_MOST * packed:
        raise ValueError(f"it cannot unpack {packed} bytes to {unpacked}")
    source = np.frombuffer(data, np.uint8, packed, header.start + 8)
    out = np.empty(unpacked, np.uint8)
    if lzf.unpack(source, out) != unpacked:
        raise ValueError("its compressed points are broken")
    columns: dict[str, NDArray[np.generic]] = {}
    place = 0
    for name in header.record.names or ():
        kind = header.record[name]
        if not kind.shape:
            columns[name] = np.frombuffer(out, kind, header.points, place)
        place += header.points * kind.itemsize
    return columns


def pcd_bytes(points_m: Points, intensities: NDArray[np.float32] | None = None, encoding: Encoding = "binary") -> bytes:
    """Points (n, 3), and the intensities (n,) where given, as a PCD file."""
    columns: Mapping[str, NDArray[np.floating]] = {axis: points_m[:, i] for i, axis in enumerate("xyz")}
    if intensities is not None:
        columns = {**columns, "intensity": intensities}
    table = np.column_stack(list(columns.values())).astype("<f4").reshape(len(points_m), len(columns))
    ones = " ".join("1" for _ in columns)
    head = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
        f"FIELDS {' '.join(columns)}\nSIZE {ones.replace('1', '4')}\nTYPE {ones.replace('1', 'F')}\nCOUNT {ones}\n"
        f"WIDTH {len(table)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(table)}\nDATA {encoding}\n"
    )
    body = table.tobytes() if encoding == "binary" else lines_of(table)
    return head.encode() + body


def lines_of(table: NDArray[np.float32]) -> bytes:
    """Rows of numbers as text that reads back as the same float32."""
    return "".join(" ".join(f"{value:.9g}" for value in row) + "\n" for row in table.tolist()).encode()
