"""Rows of an SQLite database read page by page, without its trees: what is left when the database cannot be opened.

Source: the SQLite database file format (sqlite.org/fileformat2.html). Rows lie in leaf pages of table trees, and what
does not fit there in chains of overflow pages; both can be told without knowing which table they belong to.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

_HEADER_BYTES = 100  # of the database, on its first page
_TABLE_LEAF = 0x0D
_INTEGER_BYTES = (0, 1, 2, 3, 4, 6, 8)
_MOST_COLUMNS = 64
_MOST_BYTES = 1 << 31  # of a row; SQLite writes none that is larger
_uint16 = struct.Struct(">H").unpack_from
_uint32 = struct.Struct(">I").unpack_from

Value = int | float | str | bytes | None


class Cell(NamedTuple):
    """One row: ``page`` counts from 0, ``begin`` is where its ``size`` bytes of payload begin in the file."""

    page: int
    rowid: int
    begin: int
    size: int


class Pages:
    """The pages of a database, ``view``, which may be cut or damaged. Raises ValueError when its head is broken."""

    def __init__(self, view: memoryview) -> None:
        if len(view) < _HEADER_BYTES:
            raise ValueError("its head is cut off")
        size = int(_uint16(view, 16)[0])
        self.page_bytes = 1 << 16 if size == 1 else size
        if self.page_bytes < 512 or self.page_bytes & (self.page_bytes - 1):
            raise ValueError(f"its pages cannot have {size} bytes")
        self._view = view
        self._usable = self.page_bytes - view[20]
        self._count = len(view) // self.page_bytes

    def cells(self) -> Iterator[Cell]:
        """The rows of all tables, in the order of the file."""
        for page in range(self._count):
            yield from self._cells_of(page)

    def _cells_of(self, page: int) -> Iterator[Cell]:
        start = page * self.page_bytes
        head = start + (0 if page else _HEADER_BYTES)
        if self._view[head] != _TABLE_LEAF:
            return
        (count,) = _uint16(self._view, head + 3)
        if head + 8 + 2 * count > start + self.page_bytes:
            return
        for k in range(count):
            (at,) = _uint16(self._view, head + 8 + 2 * k)
            if head + 8 + 2 * count <= start + at < start + self._usable - 4:
                size, begin = self._varint(start + at)
                rowid, begin = self._varint(begin)
                yield Cell(page, rowid, begin, size)

    def _varint(self, at: int) -> tuple[int, int]:
        """A number of 1 to 9 bytes, and where it ends; 0 behind the end of the file."""
        value = 0
        for k in range(9):
            if at + k >= len(self._view):
                return 0, at
            octet = self._view[at + k]
            if k == 8:
                return value << 8 | octet, at + 9
            value = value << 7 | octet & 0x7F
            if octet < 0x80:
                return value, at + k + 1
        return value, at

    def _local_bytes(self, size: int) -> int:
        """How many bytes of a payload lie on the leaf page itself."""
        most, least = self._usable - 35, (self._usable - 12) * 32 // 255 - 23
        if size <= most:
            return size
        fitting = least + (size - least) % (self._usable - 4)
        return fitting if fitting <= most else least

    def types(self, cell: Cell) -> Sequence[int] | None:
        """The serial types of a row's columns; None when they cannot be."""
        end = (cell.page + 1) * self.page_bytes
        header, at = self._varint(cell.begin)
        stop = cell.begin + header
        if not at < stop <= min(end, cell.begin + self._local_bytes(cell.size)) or cell.size > _MOST_BYTES:
            return None
        found: list[int] = []
        while at < stop and len(found) < _MOST_COLUMNS:
            kind, at = self._varint(at)
            found.append(kind)
        return found if at == stop and header + sum(map(_bytes_of, found)) == cell.size else None

    def payload(self, cell: Cell, most_bytes: int) -> bytes | None:
        """All bytes of a row; None when a part of them is missing, or they are more than ``most_bytes``."""
        local = self._local_bytes(cell.size)
        end = (cell.page + 1) * self.page_bytes
        if cell.size > min(most_bytes, len(self._view)) or cell.begin + local + 4 * (local < cell.size) > end:
            return None
        parts, left = [self._view[cell.begin : cell.begin + local]], cell.size - local
        link = cell.begin + local
        while left > 0:
            page = int(_uint32(self._view, link)[0]) - 1
            if not 0 < page < self._count:
                return None
            link = page * self.page_bytes
            piece = min(left, self._usable - 4)
            parts.append(self._view[link + 4 : link + 4 + piece])
            left -= piece
        return b"".join(parts)

    def values(self, cell: Cell, types: Sequence[int], columns: int, most_bytes: int) -> list[Value] | None:
        """The first few columns of a row; None when they cannot be read."""
        header, _ = self._varint(cell.begin)
        needed = header + sum(map(_bytes_of, types[:columns]))
        local = self._local_bytes(cell.size)
        data: bytes | memoryview | None = self._view[cell.begin : cell.begin + local]
        if needed > local:
            data = self.payload(cell, most_bytes)
        if data is None:
            return None
        found, at = list[Value](), header
        for kind in types[:columns]:
            end = at + _bytes_of(kind)
            found.append(_value(kind, bytes(data[at:end])))
            at = end
        return found


def _bytes_of(kind: int) -> int:
    if kind >= 12:
        return (kind - 12) // 2
    return _INTEGER_BYTES[kind] if kind < 7 else 8 * (kind == 7)


def _value(kind: int, data: bytes) -> Value:
    if kind == 0:
        return None
    if kind >= 12:
        return data.decode(errors="replace") if kind % 2 else data
    if kind == 7:
        return float(struct.unpack(">d", data)[0])
    return kind - 8 if kind >= 8 else int.from_bytes(data, "big", signed=True)
